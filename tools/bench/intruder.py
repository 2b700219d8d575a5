"""A million random payloads, on a live link and through the decoders: how many are taken for messages.

    python -m tools.bench.intruder            prints the seed and the counts; exit code 1 if any was accepted

The flood is sent without TLS, for with it an intruder does not even get a session (tests/edge/link/test_security.py).
"""

import argparse
import random
import resource
import sys
import time
from collections import Counter
from typing import Final

import msgspec
import zenoh

from edge.common.errors import MessageError
from edge.link.inbox import Received
from edge.link.link import Link
from edge.link.profile import zenoh_config
from edge.link.settings import LinkSettings
from edge.messages import MESSAGES, Backlog, Inventory, Tracks, camera_key, decode, encode

ENDPOINT: Final = "tcp/127.0.0.1:27447"
KEY: Final = camera_key("field", "cam0", "tracks")
HONEST: Final = encode(
    Tracks(
        t_unix_ns=1_700_000_000_000_000_000,
        seq=1,
        epoch=1,
        clock_bound_s=None,
        size_px=(1280, 720),
        readout_s=0.01,
        detections=[],
    )
)


def payload(chance: random.Random) -> bytes:
    """Noise, or an honest message with a hole full of noise: eight bytes or more, for a lucky digit would be honest."""
    noise = chance.randbytes(chance.randrange(8, 200))
    if chance.random() < 0.5:
        return noise
    start = chance.randrange(len(HONEST) - 1)
    return HONEST[:start] + noise + HONEST[start + chance.randrange(1, 40) :]


def through_decoders(count: int, chance: random.Random) -> Counter[str]:
    """Each payload through one decoder after the other."""
    kinds: list[type[msgspec.Struct]] = [*MESSAGES.values(), Backlog, Inventory]
    counts: Counter[str] = Counter()
    for number in range(count):
        try:
            decode(payload(chance), kinds[number % len(kinds)], where="intruder")
        except MessageError:
            counts["refused"] += 1
        else:
            counts["accepted"] += 1
    return counts


def through_link(count: int, chance: random.Random) -> Counter[str]:
    """Each payload sent as fast as it goes to a real link, and what comes out of its inbox decoded."""
    counts: Counter[str] = Counter(accepted=0)
    with Link(LinkSettings(listen=(ENDPOINT,)), name="base") as base:
        inbox = base.subscribe(camera_key("field", "*", "tracks"), 4096)
        with zenoh.open(zenoh_config(LinkSettings(connect=(ENDPOINT,)))) as session:
            publisher = session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
            while not publisher.matching_status.matching:  # type: ignore[attr-defined]
                time.sleep(0.05)
            for number in range(count):
                publisher.put(payload(chance))
                if number % 1000 == 0:
                    _read(inbox.drain(), counts)
        time.sleep(1.0)
        _read(inbox.drain(), counts)
        counts["over_rate"] = base.counters.over_rate
        counts["unread"] = inbox.dropped
    return counts


def _read(items: list[Received], counts: Counter[str]) -> None:
    for item in items:
        try:
            decode(item.payload, Tracks, where=KEY)
        except MessageError:
            counts["refused"] += 1
        else:
            counts["accepted"] += 1


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="A million random payloads: how many are taken for messages.")
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=5)
    options = parser.parse_args()
    print(f"seed {options.seed}, {options.count} payloads each way")
    accepted = 0
    for name, way in (("decoders", through_decoders), ("link", through_link)):
        began = time.monotonic()
        counts = way(options.count, random.Random(options.seed))
        accepted += counts["accepted"]
        print(f"{name}: {dict(counts)} in {time.monotonic() - began:.0f} s")
    print(f"largest memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    return 1 if accepted else 0


if __name__ == "__main__":
    sys.exit(main())

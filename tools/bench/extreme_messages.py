"""A million valid messages with extreme values, of every type, from one camera of four: does anything end, who loses.

    python -m tools.bench.extreme_messages [--messages 1000000] [--first 0] [--each 20]

Scene after scene with the core as it runs, in virtual time: three honest boxes and one that says, for each message of
theirs, `each` messages whose fields are at the ends of their types (tools/doubles/extremes.py), of Tracks, Lens, Fix
and Health. The same scene with the fourth silent says what the three see without it: a second of an object in which
they had a position within five sigma and now have none is lost. Exit code 1 if anything was raised or lost.
"""

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import numpy as np

from calib.station.core.outgoing import OutgoingTarget
from edge.common.units import NS
from edge.messages import Fix, Health, HealthItem, Lens, Tracks, camera_key, encode
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.core_station import station_for
from tools.doubles.extremes import Extremes
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make

LIAR: Final = "cam3"
TYPES: Final[dict[str, type[msgspec.Struct]]] = {"tracks": Tracks, "lens": Lens, "fix": Fix, "health": Health}
SHARES: Final = {"tracks": 0.7, "lens": 0.1, "fix": 0.1, "health": 0.1}
NUMBERED: Final = ("epoch", "seq", "t_unix_ns")  # mostly honest: what leaps in them is refused before all else
HONEST_NUMBERS: Final = 0.98  # of the messages
NEAR_SIGMAS: Final = 5.0
HEALTH: Final = Health(
    t_unix_ns=T0_UNIX_NS,
    epoch=1,
    level="ok",
    items=[HealthItem(name="camera", level="ok", since_unix_ns=0, reason="sends frames")],
    counters={"frames": 1.0},
)

Seconds = set[tuple[int, int]]  # second and object


@dataclass
class Tally:
    """What came of it. raised: by what was raised, how often; said: messages, by type."""

    said: Counter[str] = field(default_factory=Counter)
    raised: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    had: int = 0
    named: Counter[str] = field(default_factory=Counter)


def scene_of(seed: int) -> Scene:
    """A short flight that four cameras see."""
    return make(Spec(cameras=4, uavs=2, duration_s=20.0, rate_hz=15.0, seed=seed))


def sends(scene: Scene, seed: int, each: int, tally: Tally) -> Iterator[Sent]:
    """What the three say and, `each` times as much, what the fourth does; each 0: it is silent."""
    extremes, honest = Extremes(random.Random(seed)), dict[str, Any](health=HEALTH)
    seq = 0
    for sent in messages(scene):
        topic = sent.key.rpartition("/")[2]
        if sent.key == camera_key(SITE, LIAR, topic):
            honest[topic] = msgspec.json.decode(sent.payload, type=TYPES[topic])
            continue
        yield sent
        if "tracks" not in honest or topic != "tracks":
            continue
        for _ in range(each):
            seq += 1
            about = extremes.draw.choices(list(SHARES), list(SHARES.values()))[0]
            base = honest[about]
            if about == "tracks":
                base = msgspec.structs.replace(base, seq=seq)
            said = extremes.of(base, extremes.draw.choice([1, 2, 4]))
            if about == "tracks" and extremes.draw.random() < HONEST_NUMBERS:
                said = msgspec.structs.replace(said, **{name: getattr(base, name) for name in NUMBERED})
            tally.said[about] += 1
            yield Sent(sent.arrival_ns, camera_key(SITE, LIAR, about), encode(said))


def seen(scene: Scene, seed: int, each: int, tally: Tally) -> Seconds:
    """Run a scene: in which seconds of which object there was a true position."""
    station, found = station_for(scene), Seconds()
    adopted = False
    for sent in sends(scene, seed, each, tally):
        if not adopted and sent.key.endswith("/tracks"):
            station.adopt(scene.network)
            adopted = True
        try:
            targets = station.handle(sent.key, sent.payload, sent.arrival_ns)
            targets = targets + station.tick(sent.arrival_ns).targets
        except Exception as error:  # noqa: BLE001  # what is counted here
            tally.raised[f"{type(error).__name__}: {str(error)[:80]}"] += 1
            continue
        places = (_true(scene, target) for target in targets if target.state == "confirmed")
        found.update(place for place in places if place is not None)
    if each:
        tally.named.update(station.calibration.suspects.keys())
    return found


def _true(scene: Scene, target: OutgoingTarget) -> tuple[int, int] | None:
    """The second and the object that a target is of; None if it is of none."""
    off = scene.positions(target.t_unix_ns) - target.position_enu
    nearest = int(np.argmin(np.linalg.norm(off, axis=1)))
    if not np.linalg.norm(off[nearest]) < NEAR_SIGMAS * np.sqrt(np.trace(target.position_covariance_enu)):
        return None
    return (target.t_unix_ns - T0_UNIX_NS) // NS, nearest


def main(arguments: list[str] | None = None) -> int:
    """Print what came of it, scene by scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000, help="with extreme values, at least")
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--each", type=int, default=20, help="messages for each of the others'")
    options: Any = parser.parse_args(arguments)
    tally, seed, began = Tally(), options.first, time.monotonic()
    while tally.said.total() < options.messages:
        scene = scene_of(seed)
        silent, among = seen(scene, seed, 0, tally), seen(scene, seed, options.each, tally)
        tally.had += len(silent)
        tally.lost += len(silent - among)
        print(
            f"seed {seed}: {tally.said.total()} said in {time.monotonic() - began:.0f} s, "
            f"raised {tally.raised.total()}, lost {tally.lost} of {tally.had}",
            flush=True,
        )
        seed += 1
    print(f"\nsaid {dict(tally.said)} from seed {options.first}; raised {dict(tally.raised) or 'nothing'}")
    print(f"seconds of an object that the others saw: {tally.had}, lost {tally.lost}")
    print(f"named at the end: {dict(tally.named)}")
    return int(bool(tally.raised or tally.lost))


if __name__ == "__main__":
    sys.exit(main())

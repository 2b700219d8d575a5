"""One radio of four that stops reading: what the other three lose, how late they get, and how soon the station stops.

`python -m tools.bench.mavlink_stuck`: a real base with three receivers over UDP and one on a serial line (a pseudo-
terminal), whose far end reads, then does not, then does again, and so on, for twenty seconds each: what else the
machine does falls on both alike. Lost is what is missing in MAVLink's own sequence numbers.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from tools.doubles.base import TrackingBase
from tools.doubles.listener import Listener, Position
from tools.doubles.radio import Radio

SETTLE_S: Final = 5.0  # after each change, not measured
PROFILES: Final = ["gcs", "ecef"]
UNCHANGED: Final = 0.2  # of the 99th percentile; more is a change
STOPS_WITHIN_S: Final = 2.5


def delays_ms(positions: Iterable[Position]) -> list[float]:
    """Validity to arrival; a made-up scene has a time of its own, so only differences mean something."""
    return [(one.received_ns - one.time_ns) * 1e-6 for one in positions]


def measured(ears: list[Listener], radio: Radio, rounds: int, seconds: float) -> dict[str, list[list[float]]]:
    """Delays of the positions that each ear got, by whether the radio reads, over all rounds."""
    found: dict[str, list[list[float]]] = {"reads": [[] for _ in ears], "does not": [[] for _ in ears]}
    for _ in range(rounds):
        for how, change in (("reads", radio.read_on), ("does not", radio.stick)):
            change()
            time.sleep(SETTLE_S)
            before = [len(ear.positions) for ear in ears]
            time.sleep(seconds)
            for ear, count, delays in zip(ears, before, found[how], strict=True):
                delays.extend(delays_ms(ear.positions[count:]))
    return found


def report(found: dict[str, list[list[float]]], seconds: float) -> float:
    """Print the rates and percentiles; the largest change of a 99th percentile, as a part of it."""
    soonest = [min(each) for each in found["reads"]]
    p99: dict[str, np.ndarray] = {}
    for how, ears in found.items():
        p50, p99[how] = (
            np.array([np.percentile(each, percent) - least for each, least in zip(ears, soonest, strict=True)])
            for percent in (50, 99)
        )
        rates = [len(each) / seconds for each in ears]
        print(
            f"the radio {how}: {np.round(rates, 2)} positions/s, p50 {p50.round(1)} ms, p99 {p99[how].round(1)} ms"
            " behind the soonest"
        )
    change = p99["does not"] / p99["reads"] - 1
    print(f"p99 changes by {np.round(change * 100, 1)} %")
    return float(change.max())


def main() -> int:
    """Print it; 1 if the others lost anything, got late, or the station was slow to stop."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=2, help="reading and not reading, each so often")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        radio = stack.enter_context(Radio())
        ears = [stack.enter_context(Listener()) for _ in range(3)]
        urls = [*(ear.url for ear in ears), f"serial:{radio.device}:57600"]
        base = TrackingBase(Path(folder), [{"url": url, "profile": PROFILES} for url in urls])
        base.start()
        stack.callback(base.kill)
        base.wait_until_up()
        stack.enter_context(base.boxes())
        if not ears[0].wait(30, 60.0):
            raise SystemExit("no position came")
        print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} processors")
        later = report(measured(ears, radio, options.rounds, options.seconds), options.rounds * options.seconds)
        missing = [ear.missing for ear in ears]
        print(f"lost by the other three: {missing} of {[len(ear.datagrams) for ear in ears]} frames")
        print(f"said of it: {[line for name, line in base.health().items() if 'serial' in name]}")
        began_s = time.monotonic()
        code = base.stop()
        stopped_s = time.monotonic() - began_s
        print(f"SIGTERM while the radio does not read: exit {code} after {stopped_s:.1f} s")
        print(f"load {os.getloadavg()[0]:.2f}")
    return int(any(missing) or later > UNCHANGED or code != 0 or stopped_s > STOPS_WITHIN_S)


if __name__ == "__main__":
    sys.exit(main())

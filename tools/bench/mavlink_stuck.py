"""One radio of four that stops reading: what the other three lose, how late they get, and how soon the station stops.

`python -m tools.bench.mavlink_stuck`: a real base with three receivers over UDP and one on a serial line (a pseudo-
terminal), whose far end reads for three seconds, then does not for three, and so on: what else the machine does falls
on both alike, and of what falls on a few of the times a median over all of them sees little. How far that means
something on this machine is told by the times of reading, the odd ones against the even ones. Lost is what is missing
in MAVLink's own sequence numbers.
"""

import argparse
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tools.doubles.base import SPEC, TrackingBase
from tools.doubles.listener import Listener
from tools.doubles.radio import Radio

SETTLE_S: Final = 1.0  # after each change, not measured
BEGIN_S: Final = 30.0  # until the first position, at most
PROFILES: Final = ["gcs", "ecef"]
UNCHANGED: Final = 0.2  # of the 99th percentile; more is a change
STOPS_WITHIN_S: Final = 2.5

Rounds = list[list[np.ndarray]]  # of each round, each ear's delays in ms


def measured(ears: list[Listener], seconds: float) -> list[np.ndarray]:
    """Each ear's delays from validity to arrival; a made-up scene has a time of its own: only differences count."""
    time.sleep(SETTLE_S)
    before = [len(ear.positions) for ear in ears]
    time.sleep(seconds)
    came = [ear.positions[count:] for ear, count in zip(ears, before, strict=True)]
    return [np.array([(one.received_ns - one.time_ns) * 1e-6 for one in each]) for each in came]


def percentile(rounds: Rounds, percent: float, soonest: np.ndarray) -> np.ndarray:
    """The median over the rounds of each one's percentile, for each ear, behind the soonest."""
    found = np.array([[np.percentile(each, percent) for each in ears] for ears in rounds])
    return np.asarray(np.median(found, axis=0) - soonest)


def report(reads: Rounds, stuck: Rounds, seconds: float) -> float:
    """Print rates and percentiles; the largest change of a 99th percentile, as a part of it."""
    soonest = np.array([np.concatenate(each).min() for each in zip(*reads, strict=True)])
    for how, rounds in (("reads", reads), ("does not", stuck)):
        rates = [sum(map(len, each)) / (len(rounds) * seconds) for each in zip(*rounds, strict=True)]
        p50, p99 = (percentile(rounds, percent, soonest) for percent in (50, 99))
        print(f"the radio {how}: {np.round(rates, 2)} positions/s, p50 {p50.round(1)} ms, p99 {p99.round(1)} ms")
    change, alike = (
        percentile(ones, 99, soonest) / percentile(others, 99, soonest) - 1
        for ones, others in ((stuck, reads), (reads[::2], reads[1::2]))
    )
    print(f"p99 changes by {np.round(change * 100, 1)} %; of reading against reading {np.round(alike * 100, 1)} %")
    return float(change.max())


def main() -> int:
    """Print it; 1 if the others lost anything, got late, or the station was slow to stop."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=40, help="reading and not reading, each so often")
    options = parser.parse_args()
    lasts_s = BEGIN_S + 2 * options.rounds * (SETTLE_S + options.seconds)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        radio = stack.enter_context(Radio())
        ears = [stack.enter_context(Listener()) for _ in range(3)]
        urls = [*(ear.url for ear in ears), f"serial:{radio.device}:57600"]
        endpoints = [{"url": url, "profile": PROFILES} for url in urls]
        base = TrackingBase(Path(folder), endpoints, spec=replace(SPEC, duration_s=lasts_s))
        base.start()
        stack.callback(base.kill)
        base.wait_until_up()
        stack.enter_context(base.boxes())
        if not ears[0].wait(30, BEGIN_S):
            raise SystemExit("no position came")
        print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} processors")
        reads: Rounds = []
        stuck: Rounds = []
        for _ in range(options.rounds):
            radio.read_on()
            reads.append(measured(ears, options.seconds))
            radio.stick()
            stuck.append(measured(ears, options.seconds))
        later = report(reads, stuck, options.seconds)
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

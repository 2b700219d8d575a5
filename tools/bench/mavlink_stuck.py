"""One radio of four that stops reading: what the other three lose, how late they get, and how soon the station stops.

`python -m tools.bench.mavlink_stuck`: a real base with three receivers over UDP and one on a serial line (a pseudo-
terminal), whose far end reads for the first half and then no more.
"""

import argparse
import os
import sys
import tempfile
import threading
import time
import tty
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from tools.doubles.base import TrackingBase
from tools.doubles.listener import Listener

SETTLE_S: Final = 5.0
PROFILES: Final = ["gcs", "ecef"]


class Radio:
    """The far end of a serial line, which reads until it is told to stop."""

    def __init__(self) -> None:
        self._near, far = os.openpty()
        tty.setraw(far)
        os.set_blocking(self._near, False)
        self.device = os.ttyname(far)
        self.reads, self._ended = threading.Event(), threading.Event()
        self.reads.set()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        while not self._ended.wait(0.02):
            try:
                if self.reads.is_set():
                    os.read(self._near, 1 << 16)
            except BlockingIOError:
                continue


def measured(listeners: list[Listener], seconds: float) -> tuple[list[float], list[float]]:
    """Positions a second, and the 99th percentile of their delay behind the soonest, in milliseconds, of each."""
    before = [len(each.positions) for each in listeners]
    time.sleep(seconds)
    came = [each.positions[count:] for each, count in zip(listeners, before, strict=True)]
    delays = [[(one.received_ns - one.time_ns) * 1e-6 for one in each] for each in came]
    delays = [[one - min(each) for one in each] for each in delays]  # a made-up scene has a time of its own
    return [len(each) / seconds for each in came], [float(np.percentile(each, 99)) if each else 0.0 for each in delays]


def main() -> None:
    """Print it; 1 if the others lost anything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each half")
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        radio = Radio()
        ears = [stack.enter_context(Listener()) for _ in range(3)]
        urls = [*(ear.url for ear in ears), f"serial:{radio.device}:57600"]
        base = TrackingBase(Path(folder), [{"url": url, "profile": PROFILES} for url in urls])
        base.start()
        stack.callback(base.kill)
        base.wait_until_up()
        stack.enter_context(base.boxes())
        if not ears[0].wait(30, 60.0):
            raise SystemExit("no position came")
        time.sleep(SETTLE_S)
        rate, late_ms = measured(ears, seconds)
        radio.reads.clear()
        time.sleep(SETTLE_S)
        rate_stuck, late_stuck_ms = measured(ears, seconds)
        print(f"all four read: {np.round(rate, 1)} positions/s, p99 {np.round(late_ms)} ms")
        print(f"the radio does not: {np.round(rate_stuck, 1)} positions/s, p99 {np.round(late_stuck_ms)} ms")
        change = np.array(late_stuck_ms) / np.array(late_ms) - 1
        print(f"p99 changes by {np.round(change * 100)} %")
        print(f"said of it: {[line for name, line in base.health().items() if 'serial' in name]}")
        began_s = time.monotonic()
        code = base.stop()
        stopped_s = time.monotonic() - began_s
        print(f"SIGTERM: exit {code} after {stopped_s:.1f} s")
        kept = min(np.array(rate_stuck) / np.array(rate))
        sys.exit(int(kept < 0.98 or stopped_s > 3.0))


if __name__ == "__main__":
    main()

"""What the page costs: `python -m tools.bench.page` runs a station with ten targets, first unwatched, then watched.

Two real browsers look at the map and at the cameras. Printed, for both halves: what share of a core the station and the
page take, and how long a frame takes from its arrival to MAVLink. Asked: the page under 10 % of a core, and the station
as quick as without it. On a machine that does other things as well, compare the halves and not the numbers.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tools.doubles.base import NOBODY, Base, scene_config
from tools.doubles.browser import browser
from tools.doubles.feed import boxes
from tools.doubles.flight import Spec, make
from tools.doubles.ports import free_endpoint

STARTED_S: Final = 120.0
SETTLED_S: Final = 8.0  # before anything is measured
LOOKS: Final = ("/", "/cameras")


@dataclass(frozen=True)
class Half:
    """What was measured: shares of a core, and milliseconds from arrival to MAVLink (median, 99th percentile)."""

    station: float
    page: float
    latency_ms: tuple[float, float]
    targets: int


def cpu_s(pid: int) -> float:
    """CPU seconds a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def page_of(station: int) -> int | None:
    """The page's process, if it runs."""
    children = Path(f"/proc/{station}/task/{station}/children").read_text().split()
    return next((int(c) for c in children if "calib.station.page" in Path(f"/proc/{c}/cmdline").read_text()), None)


def measure(base: Base, seconds: float) -> Half:
    """One half."""
    station = base.process.pid
    time.sleep(SETTLED_S)
    page = page_of(station)
    before, began = (cpu_s(station), cpu_s(page) if page else 0.0), time.monotonic()
    time.sleep(seconds)
    took = time.monotonic() - began
    after = (cpu_s(station), cpu_s(page) if page else 0.0)
    told = base.status()
    latency, targets = told["latency_ms"], told["targets"]
    assert isinstance(latency, list)
    assert isinstance(targets, list)
    return Half((after[0] - before[0]) / took, (after[1] - before[1]) / took, (latency[0], latency[1]), len(targets))


@contextmanager
def running(folder: Path, spec: Spec) -> Iterator[Base]:
    """A station fed with the scene."""
    scene = make(spec)
    config = scene_config(
        scene,
        free_endpoint(),
        status={"page": True},
        calibration={"resolve_s": 3600},
        mavlink={"endpoint": [NOBODY]},
    )
    base = Base(folder, config, scene.network)
    try:
        base.start()
        base.wait_until_up(STARTED_S)
        with boxes(scene, base.zenoh):
            yield base
        base.stop()
    finally:
        base.kill()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each half (default: 20)")
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--uavs", type=int, default=10)
    parser.add_argument("--rate", type=float, default=10.0, help="frames a second (default: 10)")
    options = parser.parse_args()
    length_s = 2 * (options.seconds + SETTLED_S) + STARTED_S
    spec = Spec(cameras=options.cameras, uavs=options.uavs, rate_hz=options.rate, duration_s=length_s)
    print(f"seed {spec.seed}: {spec.cameras} cameras, {spec.uavs} objects, {spec.rate_hz:g} Hz")
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Path(folder), spec) as base,
        browser() as looking,
    ):
        halves = {"nobody looks": measure(base, options.seconds)}
        for path in LOOKS:
            looking.new_page().goto(base.url + path, timeout=STARTED_S * 1000)
        halves["two browsers"] = measure(base, options.seconds)
    for name, half in halves.items():
        print(
            f"{name}: station {half.station:.1%} of a core, page {half.page:.1%}, {half.targets} targets, "
            f"arrival to MAVLink {half.latency_ms[0]:.1f} ms median, {half.latency_ms[1]:.1f} ms p99"
        )
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return 0


if __name__ == "__main__":
    sys.exit(main())

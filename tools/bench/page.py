"""What the page costs: `python -m tools.bench.page` runs a station with ten targets, first unwatched, then watched.

Two real browsers look at the map and at the cameras. Printed, for both halves: what share of a core the station and the
page take, and how long a frame takes from its arrival to MAVLink. Asked: the page under 10 % of a core, and the station
as quick as without it. On a machine that does other things as well, compare the halves and not the numbers.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calib.station.archive.state_store import StateStore
from tools.doubles.box_messages import SITE
from tools.doubles.browser import browser
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, Spec, make

PORT: Final = 18080
ENDPOINT: Final = "tcp/127.0.0.1:17448"
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


def status() -> dict[str, object]:
    """The station's status."""
    with urllib.request.urlopen(f"http://127.0.0.1:{PORT}/status.json", timeout=STARTED_S) as answer:
        told: dict[str, object] = json.load(answer)
    return told


def measure(station: int, seconds: float) -> Half:
    """One half."""
    time.sleep(SETTLED_S)
    page = page_of(station)
    before, began = (cpu_s(station), cpu_s(page) if page else 0.0), time.monotonic()
    time.sleep(seconds)
    took = time.monotonic() - began
    after = (cpu_s(station), cpu_s(page) if page else 0.0)
    told = status()
    latency, targets = told["latency_ms"], told["targets"]
    assert isinstance(latency, list)
    assert isinstance(targets, list)
    return Half((after[0] - before[0]) / took, (after[1] - before[1]) / took, (latency[0], latency[1]), len(targets))


@contextmanager
def running(folder: Path, spec: Spec) -> Iterator[int]:
    """A station fed with the scene; its process id."""
    scene = make(spec)
    cameras = "".join(f'[[camera]]\nid = "cam{k}"\n' for k in range(spec.cameras))
    (folder / "base.toml").write_text(
        f'state_folder = "state"\n[site]\nname = "{SITE}"\norigin = {list(ORIGIN)}\n{cameras}'
        f'[link]\nlisten = ["{ENDPOINT}"]\n[status]\nport = {PORT}\n[calibration]\nresolve_s = 3600\n'
        '[[mavlink.endpoint]]\nurl = "udp:127.0.0.1:9"\nprofile = ["ecef"]\n'
    )
    (folder / "state").mkdir()
    with StateStore(folder / "state") as keeper:
        keeper.store_network(scene.network)
    command = [sys.executable, "-m", "calib.station.app", "run", "--config", str(folder / "base.toml")]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as station:
        until_up()
        with boxes(scene, ENDPOINT):
            yield station.pid
        station.terminate()


def until_up() -> None:
    """Wait until the station answers."""
    deadline = time.monotonic() + STARTED_S
    while True:
        try:
            status()
            return
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


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
        running(Path(folder), spec) as station,
        browser() as looking,
    ):
        halves = {"nobody looks": measure(station, options.seconds)}
        for path in LOOKS:
            looking.new_page().goto(f"http://127.0.0.1:{PORT}{path}", timeout=STARTED_S * 1000)
        halves["two browsers"] = measure(station, options.seconds)
    for name, half in halves.items():
        print(
            f"{name}: station {half.station:.1%} of a core, page {half.page:.1%}, {half.targets} targets, "
            f"arrival to MAVLink {half.latency_ms[0]:.1f} ms median, {half.latency_ms[1]:.1f} ms p99"
        )
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return 0


if __name__ == "__main__":
    sys.exit(main())

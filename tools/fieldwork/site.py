"""A whole site in network namespaces: boxes, a real base-station process, and what its recordings hold."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from calib.geodesy import ecef_to_enu
from calib.station import recording
from edge.messages import camera_of_key
from tools.fieldwork.air import Air
from tools.fieldwork.box import lap_of

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parents[1]
PORT: Final = 7447
LAP_SETTLES_S: Final = 5.0  # of each lap
QUIET: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class Row(NamedTuple):
    """One Tracks message as the base recorded it. late: by the backlog."""

    camera: str
    epoch: int
    seq: int
    t_unix_ns: int
    t_arrival_ns: int
    late: bool


class Site:
    """Starts, stops, freezes and kills the processes of one site. Hosts: `base`, `cam0`, ..."""

    def __init__(self, air: Air, folder: Path, tracks: Path, *, state: str = "state") -> None:
        self.air, self.folder, self.tracks = air, folder, tracks
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self._logs: dict[str, Path] = {}
        self.start_unix_s = time.time() + 1.0
        self._runs = 0
        (folder / "base.toml").write_text(self._base_toml(state))

    def _base_toml(self, state: str) -> str:
        site = tomllib.loads((self.tracks / "site.toml").read_text())["site"]
        cameras = tomllib.loads((self.tracks / "site.toml").read_text())["camera"]
        lines = [f'state_folder = "{state}"', "[site]", f'name = "{site["name"]}"', f"origin = {site['origin']}"]
        for camera in cameras:
            lines += ["[[camera]]", f'id = "{camera["id"]}"', f"position = {camera['position']}"]
            lines += [f"position_sigma = {camera['position_sigma']}"]
        lines += ["[link]", f'listen = ["tcp/{self.air.address("base")}:{PORT}"]', "insecure = true"]
        lines += ["[recording]", 'folder = "recordings"', "min_free_mb = 1", "[status]", "port = 8080"]
        return "\n".join(lines) + "\n"

    def start(self, host: str) -> None:
        """Start a host's program (again)."""
        self._runs += 1
        log = self.folder / f"{host}-{self._runs}.log"
        self._logs[host] = log
        with log.open("w") as file, (self.folder / f"{host}-{self._runs}.err").open("w") as errors:
            command = [*self.air.inside(host), sys.executable, *self._program(host)]
            self.processes[host] = subprocess.Popen(
                command, stdout=file, stderr=errors, text=True, cwd=ROOT, env={**os.environ, **QUIET}
            )

    def _program(self, host: str) -> list[str]:
        if host == "base":
            return ["-m", "calib.station.app", "run", "--config", str(self.folder / "base.toml")]
        site = tomllib.loads((self.tracks / "site.toml").read_text())["site"]["name"]
        endpoint = f"tcp/{self.air.address('base')}:{PORT}"
        spool = self.folder / f"{host}.sqlite"
        return [str(HERE / "box.py"), endpoint, site, host, str(self.tracks), str(spool), str(self.start_unix_s)]

    def send(self, host: str, number: signal.Signals) -> None:
        """Send a signal to a host's program."""
        self.processes[host].send_signal(number)

    def kill(self, host: str) -> None:
        """kill -9, and bury."""
        self.processes[host].kill()
        self.processes[host].wait(timeout=5)

    def stop(self) -> dict[str, float]:
        """Stop everything in order; how long each took to end, in seconds."""
        took = {}
        for host in sorted(self.processes, key=lambda name: name == "base"):
            process = self.processes[host]
            began = time.monotonic()
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait(timeout=10)
            took[host] = time.monotonic() - began
        return took

    def bury(self) -> None:
        """Kill whatever still runs."""
        for process in self.processes.values():
            process.kill()
            process.wait(timeout=5)

    def made(self) -> set[tuple[str, int, int]]:
        """(camera, epoch, seq) of all that the boxes made, over all their runs."""
        found = set()
        for log in self.folder.glob("cam*.log"):
            camera = log.name.partition("-")[0]
            for line in log.read_text().splitlines(keepends=True):
                if line.endswith("\n"):
                    epoch, seq = line.split()
                    found.add((camera, int(epoch), int(seq)))
        return found

    def recorded(self, since_unix_ns: int = 0) -> list[Row]:
        """Every Tracks message in the base's recordings. Raises RecordingError if one cannot be read.

        since_unix_ns: leave out files that were last written before.
        """
        rows = []
        files = sorted((self.folder / "recordings").glob("*.mcap"))
        for file in [file for file in files if file.stat().st_mtime_ns >= since_unix_ns]:
            for item in recording.read(file):
                topic = item.key.rpartition("/")[2]
                camera = camera_of_key(item.key)
                if camera is not None and topic in ("tracks", "backlog"):
                    message = json.loads(item.payload)
                    about = (message["epoch"], message["seq"], message["t_unix_ns"])
                    rows.append(Row(camera, *about, item.t_arrival_ns, topic == "backlog"))
        return rows

    def misses_m(self) -> "np.ndarray[Any, np.dtype[np.float64]]":
        """How far each confirmed target of the recordings was from the nearest true object, in metres.

        The first seconds of each lap are left out: there the objects jump back to where they began, and no tracker can
        know that.
        """
        origin = tomllib.loads((self.tracks / "site.toml").read_text())["site"]["origin"]
        truths = [np.loadtxt(f, delimiter=",", skiprows=1) for f in sorted((self.tracks / "truth").glob("*.csv"))]
        began_s, lap_s = (ns * 1e-9 for ns in lap_of(self.tracks))
        found = []
        for file in sorted((self.folder / "recordings").glob("*.mcap")):
            for item in recording.read(file):
                if item.key.endswith("/station/targets"):
                    message = json.loads(item.payload)
                    into_lap_s = (message["t_unix_ns"] * 1e-9 - self.start_unix_s) % lap_s
                    if into_lap_s > LAP_SETTLES_S:
                        found += [_miss_m(t, truths, began_s + into_lap_s, origin) for t in _confirmed(message)]
        return np.array(found)

    def status(self) -> dict[str, Any]:
        """The base's /status.json."""
        command = [*self.air.inside("base"), sys.executable, "-c", _FETCH]
        told = subprocess.run(command, capture_output=True, text=True, check=False)
        return dict(json.loads(told.stdout)) if told.returncode == 0 else {}


def _confirmed(message: dict[str, Any]) -> list[dict[str, Any]]:
    return [target for target in message["targets"] if target["state"] == "confirmed"]


def _miss_m(target: dict[str, Any], truths: list[Any], t_s: float, origin: list[float]) -> float:
    position = ecef_to_enu(np.array([target["ecef_m"]]), (origin[0], origin[1], origin[2]))[0]
    apart = []
    for truth in truths:
        there = [np.interp(t_s, truth[:, 0], truth[:, axis]) for axis in (1, 2, 3)]
        apart.append(float(np.linalg.norm(position - there)))
    return min(apart)


_FETCH = """
import sys, urllib.request
sys.stdout.write(urllib.request.urlopen("http://127.0.0.1:8080/status.json", timeout=2).read().decode())
"""


def latency_s(rows: list[Row], begin_unix_s: float, end_unix_s: float) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Latencies of the live messages that were made in a stretch of time; base and boxes share this machine's clock."""
    chosen = [row for row in rows if not row.late and begin_unix_s * 1e9 <= row.t_unix_ns < end_unix_s * 1e9]
    return np.array([(row.t_arrival_ns - row.t_unix_ns) * 1e-9 for row in chosen])


def live_again_after(rows: list[Row], camera: str, since_unix_s: float) -> float:
    """How long after an instant the first live message came that was made after it, in seconds."""
    first = [r.t_arrival_ns for r in rows if r.camera == camera and not r.late and r.t_unix_ns >= since_unix_s * 1e9]
    return min(first) * 1e-9 - since_unix_s if first else float("inf")

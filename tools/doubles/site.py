"""A whole site in network namespaces: boxes, a real base-station process, and a real router if wanted."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import tomli_w

from tools.doubles.air import Air
from tools.doubles.base import base_config
from tools.doubles.heard import Heard, Row
from tools.doubles.truth import Error, Truth

ROOT: Final = Path(__file__).parents[2]
CAMERAS: Final = ("cam0", "cam1", "cam2")  # of the demo's scene
PORT: Final = 7447
STATUS_PORT: Final = 8080  # in the base's own namespace
LOOK_S: Final = 0.1  # between looks at the recording; they cost time that is measured
PATIENCE_S: Final = 60.0  # for a start on a busy machine, and for everything to be in the recording
QUIET: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
COMMIT_ROWS: Final = 20  # in half a second, at 25 Hz and a margin: what kill -9 may cost a box
ROUTER_FIRST: Final = {"router": 2, "base": 1}  # what others lean on stops last

Made = set[tuple[str, int, int]]  # camera, epoch, seq


def wait(condition: Callable[[], bool], within_s: float) -> float:
    """How long it took for a condition to come true, in seconds; infinite if it did not in time."""
    began = time.monotonic()
    while time.monotonic() - began < within_s:
        if condition():
            return time.monotonic() - began
        time.sleep(LOOK_S)
    return float("inf")


def demo_flight(folder: Path) -> Path:
    """The demo's scene as a track folder, made there."""
    command = [sys.executable, "-m", "calib.station.app", "simulate", "demo"]
    subprocess.run([*command, "-o", str(folder)], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    return folder


class Site:
    """Starts, stops, freezes and kills the processes of one site. Hosts: `base`, `cam0`, ..., and perhaps `router`.

    With a host `router`, all others dial it. secure: the production profile, with mutual TLS and access control.
    """

    def __init__(self, air: Air, folder: Path, tracks: Path, *, secure: bool = False) -> None:
        self.air, self.folder, self.tracks = air, folder, tracks
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.start_unix_s = time.time() + 1.0
        self.heard = Heard(folder / "recordings")
        self._runs = 0
        self._secure = secure
        facts = tomllib.loads((tracks / "site.toml").read_text())
        self.name: str = facts["site"]["name"]
        self._listener = "router" if "router" in air.hosts else "base"
        if secure:
            self._certify()
        (folder / "base.toml").write_text(tomli_w.dumps(self._base(facts)))
        router = {"site": self.name, "link": self._link("router") | {"mode": "router"}}
        (folder / "router.toml").write_text(tomli_w.dumps(router))

    # Configuration

    def certs(self, *arguments: str, folder: str = "certs") -> None:
        """`base-station certs` in a folder of this site's."""
        command = [
            sys.executable,
            "-m",
            "calib.station.app",
            "certs",
            "--folder",
            str(self.folder / folder),
            *arguments,
        ]
        subprocess.run(command, check=True, capture_output=True)

    def _certify(self) -> None:
        self.certs("init", self.name)
        for host in self.air.hosts:
            role = {"base": "station", "router": "router"}.get(host, "camera")
            self.certs("issue", host, "--role", role, "--address", self.air.address(host))

    def certificate(self, host: str) -> Path:
        """The folder of a host's certificate."""
        return self.folder / "certs" / "issued" / host

    @property
    def endpoint(self) -> str:
        """Whom the boxes dial."""
        return f"{'tls' if self._secure else 'tcp'}/{self.air.address(self._listener)}:{PORT}"

    def _link(self, host: str) -> dict[str, Any]:
        listens = host == self._listener
        link: dict[str, Any] = {"mode": "client" if self._listener == "router" else "peer"}
        link |= {"listen": [self.endpoint]} if listens else {"connect": [self.endpoint]}
        if not self._secure:
            return link | {"insecure": True}
        own = self.certificate(host)
        tls = {name: str(own / f"{name}.pem") for name in ("authority", "certificate", "key")}
        access = {"access": str(self.folder / "certs" / "access.json")} if listens else {}
        return link | {"tls": tls | access}

    def _base(self, facts: dict[str, Any]) -> dict[str, Any]:
        cameras = [{key: camera[key] for key in ("id", "position", "position_sigma")} for camera in facts["camera"]]
        return base_config(
            self.name,
            (),
            self.endpoint,
            site={"origin": facts["site"]["origin"]},
            camera=cameras,
            link=self._link("base"),
            mavlink={"endpoint": [{"url": "udp:127.0.0.1:14550", "profile": ["ecef"]}]},
            status={"port": STATUS_PORT},
        )

    # Processes

    def start(self, host: str, *words: str) -> None:
        """Start a host's program (again). words: put before it, a namespace of its own for instance."""
        self._runs += 1
        log = self.folder / f"{host}-{self._runs}.log"
        with log.open("w") as file, (self.folder / f"{host}-{self._runs}.err").open("w") as errors:
            command = [*self.air.inside(host), *words, sys.executable, *self._program(host)]
            self.processes[host] = subprocess.Popen(
                command, stdout=file, stderr=errors, text=True, cwd=ROOT, env={**os.environ, **QUIET}
            )

    def _program(self, host: str) -> list[str]:
        if host == "base":
            return ["-m", "calib.station.app", "run", "--config", str(self.folder / "base.toml")]
        if host == "router":
            return ["-m", "calib.station.app", "router", "--config", str(self.folder / "router.toml")]
        spool = self.folder / f"{host}.sqlite"
        link = ["--connect", self.endpoint, "--mode", "client" if self._listener == "router" else "peer"]
        link += ["--certificate", str(self.certificate(host))] if self._secure else []
        flight = ["--tracks", str(self.tracks), "--start", str(self.start_unix_s)]
        return ["-m", "tools.doubles.box", *link, "--site", self.name, "--camera", host, "--spool", str(spool), *flight]

    def settle(self, calm_s: float = 0.0) -> None:
        """Start everything but intruders, wait until the base hears all boxes, and let it run in calm."""
        for host in sorted({*self.air.hosts} - {"evil"}, key=lambda name: (name in CAMERAS, name)):
            self.start(host)
        took_s = wait(lambda: {row.camera for row in self.recorded()} == set(CAMERAS), PATIENCE_S)
        if took_s == float("inf"):
            raise SystemExit(f"the base does not hear its boxes: look at {self.folder}/base-1.err")
        time.sleep(calm_s + 1.0)

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
        for host in sorted(self.processes, key=lambda name: ROUTER_FIRST.get(name, 0)):
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

    # What came of it

    def made(self) -> Made:
        """(camera, epoch, seq) of all that the boxes made, over all their runs."""
        return {(camera, epoch, seq) for camera, epoch, seq, _, _ in self._box_lines()}

    def made_between(self, begin_unix_s: float, end_unix_s: float, of: str) -> Made:
        """As `made`, but only what one camera saw in a stretch of time."""
        lines = [line for line in self._box_lines() if line[0] == of]
        return {(of, epoch, seq) for _, epoch, seq, stamp, _ in lines if begin_unix_s <= stamp * 1e-9 < end_unix_s}

    def lateness_s(self, begin_unix_s: float, end_unix_s: float) -> list[float]:
        """By how much the boxes were late with each frame that was due in a stretch of time."""
        return [late * 1e-9 for *_, stamp, late in self._box_lines() if begin_unix_s <= stamp * 1e-9 < end_unix_s]

    def _box_lines(self) -> Iterator[tuple[str, int, int, int, int]]:
        for log in self.folder.glob("cam*.log"):
            camera = log.name.partition("-")[0]
            for line in log.read_text().splitlines(keepends=True):
                if line.endswith("\n"):  # the last one may be half written
                    epoch, seq, stamp, late = map(int, line.split())
                    yield camera, epoch, seq, stamp, late

    def recorded(self) -> list[Row]:
        """Every Tracks message in the base's recordings."""
        return self.heard.look()

    def lost(self, made: Made) -> Made:
        """Which of these messages no recording has (yet)."""
        self.heard.look()
        return made - self.heard.keys

    def lost_inside(self, made: Made) -> Made:
        """As `lost`, but for the ends of runs: what kill -9 took from memory, or what no base was there to hear."""
        last: dict[tuple[str, int], int] = {}
        for camera, epoch, seq in made:
            last[camera, epoch] = max(seq, last.get((camera, epoch), -1))
        return {(c, e, s) for c, e, s in self.lost(made) if last[c, e] - s > COMMIT_ROWS}

    def errors(self) -> list[Error]:
        """How far, in metres and in its own sigmas, each confirmed target was from the nearest true object."""
        self.heard.look()
        return self._truth.errors(self.heard.sent)

    @cached_property
    def _truth(self) -> Truth:
        return Truth(self.tracks, self.start_unix_s)

    def status(self) -> dict[str, Any]:
        """The base's /status.json; empty if it does not answer."""
        command = [*self.air.inside("base"), sys.executable, "-c", _FETCH]
        told = subprocess.run(command, capture_output=True, text=True, check=False)
        return dict(json.loads(told.stdout)) if told.returncode == 0 else {}


_FETCH = f"""
import sys, urllib.request
sys.stdout.write(urllib.request.urlopen("http://127.0.0.1:{STATUS_PORT}/status.json", timeout=2).read().decode())
"""

"""A real base-station process on this machine, with boxes that are played to it: what benches of its outputs need."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import tomli_w

from calib.station.archive.state_store import StateStore
from tools.demonstration.site import free_port
from tools.doubles.box_messages import SITE
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, Scene, Spec, make

ROOT: Final = Path(__file__).parents[2]
SPEC: Final = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=120.0)
STARTS_WITHIN_S: Final = 60.0  # on a busy machine


def key_of(passphrase: str) -> bytes:
    """The signing key that ground stations make of a passphrase."""
    return hashlib.sha256(passphrase.encode()).digest()


class Base:
    """One base with a stored network and the MAVLink endpoints given; system id 1, as its operator's vehicle."""

    def __init__(self, folder: Path, endpoints: Sequence[dict[str, Any]], *, passphrase: str = "") -> None:
        """endpoints: of base.toml. passphrase: if given, each endpoint signs with its key."""
        self.folder = folder
        self.zenoh = f"tcp/127.0.0.1:{free_port()}"
        self.http = free_port()
        signing = {"signing_key": "mavlink.key"} if passphrase else {}
        config = {
            "state_folder": "disk/state",
            "site": {"name": SITE, "origin": list(ORIGIN), "undulation_m": 47.0},
            "camera": [{"id": f"cam{k}"} for k in range(SPEC.cameras)],
            "link": {"listen": [self.zenoh]},
            "mavlink": {"system_id": 1, "endpoint": [dict(endpoint) | signing for endpoint in endpoints]},
            "recording": {"folder": "disk/recordings", "min_free_mb": 1},
            "status": {"port": self.http, "page": False},
        }
        (folder / "base.toml").write_text(tomli_w.dumps(config))
        if passphrase:
            (folder / "mavlink.key").touch(0o600)
            (folder / "mavlink.key").write_text(key_of(passphrase).hex())
        (folder / "disk" / "state").mkdir(parents=True, exist_ok=True)
        with StateStore(folder / "disk" / "state") as keeper:
            keeper.store_network(make(SPEC).network)
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, *words: str, behind_s: float = 0.0, environment: Mapping[str, str] = os.environ) -> None:
        """Start it (again) and wait until it answers.

        words: put before the command. behind_s: how late its clock is until `set_clock`.
        """
        command = [*words, sys.executable, "-m", "tools.doubles.late_clock", str(behind_s), "run"]
        with (self.folder / "base.log").open("ab") as log:
            self.process = subprocess.Popen(
                [*command, "--config", str(self.folder / "base.toml")], cwd=ROOT, stderr=log, env=environment
            )
        deadline = time.monotonic() + STARTS_WITHIN_S
        while not self.status():
            if time.monotonic() > deadline or self.process.poll() is not None:
                raise SystemExit(f"the base does not come up:\n{(self.folder / 'base.log').read_text()}")
            time.sleep(0.1)

    def set_clock(self) -> None:
        """Set a late clock right."""
        assert self.process is not None
        self.process.send_signal(signal.SIGUSR1)

    def status(self) -> dict[str, Any]:
        """/status.json; empty while there is none."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.http}/status.json", timeout=2) as told:
                return dict(json.load(told))
        except (urllib.error.URLError, OSError, ValueError):
            return {}

    def health(self) -> dict[str, tuple[str, str]]:
        """Level and reason of each of its health lines, by name."""
        items = self.status().get("health", {}).get("items", [])
        return {item["name"]: (item["level"], item["reason"]) for item in items}

    def stop(self) -> int:
        """SIGTERM; its exit code."""
        assert self.process is not None
        self.process.terminate()
        return self.process.wait(10)

    def kill(self) -> None:
        """kill -9, if it runs."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    @contextmanager
    def boxes(self) -> Iterator[Scene]:
        """Boxes that say what the scene's cameras see, in real time, for up to two minutes."""
        scene = make(SPEC)
        with boxes(scene, self.zenoh):
            yield scene

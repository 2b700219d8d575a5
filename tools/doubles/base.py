"""A real base-station process on this machine, and the configuration it is started with."""

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

from calib.network import Network
from calib.station.archive.state_store import StateStore
from tools.doubles.box_messages import SITE
from tools.doubles.feed import boxes
from tools.doubles.flight import ORIGIN, Scene, Spec, make
from tools.doubles.ports import free_endpoint, free_port

ROOT: Final = Path(__file__).parents[2]
SPEC: Final = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=120.0)
STARTS_WITHIN_S: Final = 60.0  # on a busy machine
NOBODY: Final = {"url": "udp:127.0.0.1:9", "profile": ["ecef"]}  # the discard port: sent, and heard by none


def base_config(name: str, cameras: Sequence[str], listen: str, /, **own: Any) -> dict[str, Any]:
    """What base.toml holds: sections of one's own are laid over the usual ones, key by key.

    Relative paths are beside the file; there is no page, and the status is at a free port.
    """
    usual: dict[str, Any] = {
        "state_folder": "state",
        "site": {"name": name},
        "camera": [{"id": camera} for camera in cameras],
        "link": {"listen": [listen]},
        "recording": {"folder": "recordings", "min_free_mb": 1},
        "status": {"port": free_port(), "page": False},
    }
    return usual | {
        key: usual[key] | section if isinstance(usual.get(key), dict) else section for key, section in own.items()
    }


def scene_config(scene: Scene, listen: str, /, **own: Any) -> dict[str, Any]:
    """What base.toml holds for a made-up scene, whose origin and geoid are given."""
    place = {"origin": list(ORIGIN), "undulation_m": 47.0}
    return base_config(SITE, [camera.id for camera in scene.truth], listen, **{"site": place} | own)


def key_of(passphrase: str) -> bytes:
    """The signing key that ground stations make of a passphrase."""
    return hashlib.sha256(passphrase.encode()).digest()


class Base:
    """One base-station in a folder. Whoever starts it kills it."""

    def __init__(self, folder: Path, config: Mapping[str, Any], network: Network | None = None) -> None:
        """network: what an earlier run has left."""
        self.folder = folder
        self.zenoh: str = config["link"]["listen"][0]
        self.url = f"http://127.0.0.1:{config['status']['port']}"
        self.file = folder / "base.toml"
        self.file.write_text(tomli_w.dumps(config), encoding="utf-8")
        if network is not None:
            state = folder / config["state_folder"]
            state.mkdir(parents=True, exist_ok=True)
            with StateStore(state) as store:
                store.store_network(network)
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def process(self) -> "subprocess.Popen[bytes]":
        """Its process. Raises RuntimeError before the first start."""
        if self._process is None:
            raise RuntimeError("the base was never started")
        return self._process

    def start(self, *words: str, behind_s: float = 0.0, environment: Mapping[str, str] = os.environ) -> None:
        """Start it (again), at once back. words: put before the command. behind_s: how late its clock is."""
        late = ["tools.doubles.late_clock", str(behind_s)] if behind_s else ["calib.station.app"]
        command = [*words, sys.executable, "-m", *late, "run", "--config", str(self.file)]
        with (self.folder / "base.log").open("ab") as log:
            self._process = subprocess.Popen(command, cwd=ROOT, stderr=log, env=environment)

    def wait_until_up(self, within_s: float = STARTS_WITHIN_S) -> None:
        """Wait until it answers. Raises SystemExit with its log if it does not."""
        deadline = time.monotonic() + within_s
        while not self.status():
            if time.monotonic() > deadline or self.process.poll() is not None:
                raise SystemExit(f"the base does not come up:\n{self.log()}")
            time.sleep(0.1)

    def set_clock(self) -> None:
        """Set a late clock right."""
        self.process.send_signal(signal.SIGUSR1)

    def log(self) -> str:
        """What it has logged, over all its runs."""
        return (self.folder / "base.log").read_text(encoding="utf-8", errors="replace")

    def status(self) -> dict[str, Any]:
        """/status.json; empty while there is none."""
        try:
            with urllib.request.urlopen(f"{self.url}/status.json", timeout=2) as told:
                return dict(json.load(told))
        except (urllib.error.URLError, OSError, ValueError):
            return {}

    def health(self) -> dict[str, tuple[str, str]]:
        """Level and reason of each of its health lines, by name."""
        items = self.status().get("health", {}).get("items", [])
        return {item["name"]: (item["level"], item["reason"]) for item in items}

    def stop(self, within_s: float = 10.0) -> int:
        """SIGTERM; its exit code."""
        self.process.terminate()
        return self.process.wait(within_s)

    def kill(self) -> None:
        """kill -9, if it runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


class TrackingBase(Base):
    """A base that has the network of a scene (SPEC) and can be told what the scene's boxes see."""

    def __init__(
        self,
        folder: Path,
        endpoints: Sequence[Mapping[str, Any]],
        *,
        passphrase: str = "",
        spec: Spec = SPEC,
        **mavlink: object,
    ) -> None:
        """endpoints: of base.toml, system id 1, as their operator's vehicle. passphrase: each signs with its key.

        mavlink: other keys of [mavlink].
        """
        self._spec = spec
        scene = make(spec)
        signing = {"signing_key": "mavlink.key"} if passphrase else {}
        if passphrase:
            (folder / "mavlink.key").touch(0o600)
            (folder / "mavlink.key").write_text(key_of(passphrase).hex())
        config = scene_config(
            scene,
            free_endpoint(),
            state_folder="disk/state",
            mavlink={"system_id": 1, "endpoint": [{**endpoint, **signing} for endpoint in endpoints]} | mavlink,
            recording={"folder": "disk/recordings"},
        )
        super().__init__(folder, config, scene.network)

    @contextmanager
    def boxes(self) -> Iterator[Scene]:
        """Boxes that say what the scene's cameras see, in real time, for as long as the scene (SPEC: two minutes)."""
        scene = make(self._spec)
        with boxes(scene, self.zenoh):
            yield scene

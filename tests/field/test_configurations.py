"""Both programs start on the configurations that a user is given, as they are, and find one another.

What is changed is what this machine has not: a camera (a video stands in for it), a receiver, the right to write to
/var/lib and /etc, and the port, which another base may hold.
"""

import json
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from calib.station.app import main
from tests.edge.footage import flight, sky, write_video
from tests.places import DEPLOY, ROOT

SIZE: Final = (320, 240)
LENS: Final = (
    'model = "radtan"\nintrinsics = [300.0, 300.0, 159.5, 119.5]\ndistortion = [0, 0, 0, 0]\nsize_px = [320, 240]\n'
)
WITHIN_S: Final = 90.0  # 5 s on a quiet machine: the imports of two programs
ENDS_WITHIN_S: Final = 30.0
CLOCK: Final = '\n[clock]\nsource = "assumed"\n'  # whether this machine keeps UTC is not what is asked


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    chance = np.random.default_rng(8)
    pictures = [sky(SIZE, [place], chance) for place in flight(90)]
    return write_video(tmp_path_factory.mktemp("video") / "flight.mp4", pictures, 30)


def changed(text: str, pairs: dict[str, str]) -> str:
    for old, new in pairs.items():
        assert old in text, old
        text = text.replace(old, new)
    return text


def without(text: str, section: str) -> str:
    """The text without one [section]; it is there."""
    begin = text.index(f"\n[{section}]")
    end = text.find("\n[", begin + 1)
    return text[:begin] + (text[end:] if end >= 0 else "")


@contextmanager
def program(*words: str, log: Path) -> Iterator["subprocess.Popen[bytes]"]:
    with log.open("wb") as told:
        process = subprocess.Popen([sys.executable, "-m", *words], stderr=told, stdout=told, cwd=ROOT)
    try:
        yield process
        process.terminate()
        assert process.wait(ENDS_WITHIN_S) == 0, log.read_text()
    finally:
        process.kill()
        process.wait()


def cameras(port: int) -> dict[str, dict[str, Any]]:
    """What the station says of its cameras; nothing while it does not answer."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/status.json", timeout=5) as answer:
            return {camera["id"]: camera for camera in json.load(answer)["cameras"]}
    except (urllib.error.URLError, TimeoutError, ValueError):
        return {}


def assert_they_find_one_another(folder: Path, base_text: str, edge_text: str, status_port: int) -> None:
    """Start both; the base hears frames of cam0."""
    (folder / "base.toml").write_text(base_text)
    (folder / "edge.toml").write_text(edge_text)
    (folder / "cam0.lens.toml").write_text(LENS)
    logs = folder / "base.log", folder / "edge.log"
    station = ("calib.station.app", "run", "--config", str(folder / "base.toml"))
    box = ("edge.app", "run", "--config", str(folder / "edge.toml"))
    with program(*station, log=logs[0]) as base, program(*box, log=logs[1]) as edge:
        deadline = time.monotonic() + WITHIN_S
        while not (heard := cameras(status_port).get("cam0", {}).get("online")) and time.monotonic() < deadline:
            assert (base.poll(), edge.poll()) == (None, None), "\n".join(log.read_text() for log in logs)
            time.sleep(0.2)
        assert heard, "\n".join(log.read_text() for log in logs)


def source(video: Path) -> dict[str, str]:
    return {'path = "/dev/video0"': f'path = "{video}"\nrealtime = true\nloop = true\nbound_s = 0.01'}


def test_the_examples_fit(tmp_path: Path, video: Path) -> None:
    port, status_port = free_port(), free_port()
    base = changed(
        (DEPLOY / "base.example.toml").read_text(),
        {
            "127.0.0.1:7447": f"127.0.0.1:{port}",
            '# state_folder = "/var/lib/skyfix"': 'state_folder = "state"',
            "# port = 8080": f"port = {status_port}",
        },
    )
    edge = changed((DEPLOY / "edge.example.toml").read_text(), {"127.0.0.1:7447": f"127.0.0.1:{port}"} | source(video))
    edge = without(without(without(edge, "gnss"), "spool"), "clock") + CLOCK
    assert_they_find_one_another(tmp_path, base, edge, status_port)


def test_what_init_writes_for_a_bench_fits(tmp_path: Path, video: Path) -> None:
    port, status_port = free_port(), free_port()
    assert main(["init", "bench", "-o", str(tmp_path / "made")]) == 0
    here = {"127.0.0.1:7447": f"127.0.0.1:{port}"}
    base = changed((tmp_path / "made" / "base.toml").read_text(), here) + f"\n[status]\nport = {status_port}\n"
    edge = changed((tmp_path / "made" / "cam0" / "edge.toml").read_text(), here | source(video)) + CLOCK
    assert_they_find_one_another(tmp_path, base, edge, status_port)


def test_what_init_writes_for_a_field_fits(tmp_path: Path, video: Path) -> None:
    """With certificates, made by the commands it names."""
    port, status_port = free_port(), free_port()
    certs = tmp_path / "certs"
    assert main(["init", "hill", "--base", "127.0.0.1", "-o", str(tmp_path / "made")]) == 0
    for words in (
        ["init", "hill"],
        ["issue", "base", "--role", "station", "--address", "127.0.0.1"],
        ["issue", "cam0"],
    ):
        assert main(["certs", "--folder", str(certs), *words]) == 0
    here = {":7447": f":{port}", "/var/lib/skyfix": str(tmp_path / "state")}
    base = changed(
        (tmp_path / "made" / "base.toml").read_text(),
        here | {"/etc/skyfix/certs/access.json": str(certs / "access.json")},
    )
    base = changed(base, {"/etc/skyfix/certs": str(certs / "issued" / "base")}) + f"\n[status]\nport = {status_port}\n"
    edge = changed(
        (tmp_path / "made" / "cam0" / "edge.toml").read_text(),
        here | source(video) | {"/etc/skyfix/certs": str(certs / "issued" / "cam0")},
    )
    assert_they_find_one_another(tmp_path, base, edge + CLOCK, status_port)

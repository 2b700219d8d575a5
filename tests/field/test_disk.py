"""A disk that is full or read-only costs a health line and nothing else: no crash, no wait, well again by itself."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Health, camera_key, decode
from tests.field import boxes
from tools.doubles.base import TrackingBase
from tools.doubles.disks import filler_of, on_full_disk, on_read_only_disk, possible

pytestmark = pytest.mark.program("unshare")
WITHIN_S = 40.0  # on a busy machine; seconds elsewhere


@pytest.fixture(autouse=True)
def _needs_mounts() -> None:
    if reason := possible():
        pytest.skip(reason)


@pytest.fixture
def ended() -> Iterator[list["subprocess.Popen[bytes]"]]:
    """Processes that are gone after the test."""
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for process in started:
        process.kill()
        process.wait()


def becomes(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.2)
    return False


@pytest.mark.parametrize("words", [on_read_only_disk, on_full_disk], ids=["read-only", "full"])
def test_a_base_goes_on_without_its_disk(tmp_path: Path, words: Callable[[Path], list[str]]) -> None:
    disk = tmp_path / "disk"
    base = TrackingBase(tmp_path, [])
    with ExitStack() as stack:
        stack.callback(base.kill)
        base.start(*words(disk))
        base.wait_until_up()
        stack.enter_context(base.boxes())
        assert becomes(lambda: bool(base.status().get("targets"))), "it tracks, disk or not"
        assert becomes(lambda: base.health().get("recording", ("",))[0] == "warn"), base.health()
        assert base.health()["disk"][0] == "warn", "what it wants to remember"
        if words is on_full_disk:
            filler_of(base.process, disk).unlink()
            assert becomes(lambda: base.status().get("recording") is not None)
            assert becomes(lambda: "recording" not in base.health()), "it records again, with no help"
        assert base.stop() == 0
    assert "Traceback" not in base.log()


@pytest.mark.parametrize("words", [on_read_only_disk, on_full_disk], ids=["read-only", "full"])
def test_a_box_goes_on_without_its_disk(
    tmp_path: Path, endpoint: str, words: Callable[[Path], list[str]], ended: list["subprocess.Popen[bytes]"]
) -> None:
    file, disk = boxes.prepare(tmp_path, endpoint), tmp_path / "disk"
    with Link(LinkSettings(listen=(endpoint,)), name="base") as link:
        told = link.subscribe(camera_key("test", "cam1", "health"))
        seen = link.subscribe(camera_key("test", "cam1", "tracks"))
        ended.append(boxes.start(file, *words(disk)))
        assert becomes(lambda: spool_level(told) == "warn"), (tmp_path / "box.log").read_text()
        before = seen.received
        assert becomes(lambda: seen.received > before + 30), "it measures and sends, disk or not"
        if words is on_full_disk:
            filler_of(ended[0], disk).unlink()
            assert becomes(lambda: spool_level(told) == "ok"), "it keeps again, with no help"
        ended[0].terminate()
        assert ended[0].wait(10) == 0
    assert "Traceback" not in (tmp_path / "box.log").read_text()


def spool_level(told: Inbox[Received]) -> str:
    """How the newest health message says the spool is; empty if none came."""
    messages = [decode(item.payload, Health, where=item.key) for item in told.drain()]
    return next((item.level for item in messages[-1].items if item.name == "spool"), "") if messages else ""

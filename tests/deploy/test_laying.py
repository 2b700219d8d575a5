"""A version is laid whole or not at all, with what it needs asked for first, and by one installer at a time."""

import errno
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

import pytest

from deploy.installer import machine, programs, services, unpacking
from deploy.installer.places import Places
from deploy.installer.programs import MB, SPARE_B, check_space
from deploy.installer.source import SUMS, Source
from deploy.installer.telling import RefusedError
from deploy.installer.versions import Versions
from deploy.installer.wheelhouse import Wheel
from tests.places import ROOT


class Usage:
    """What a disk has left."""

    def __init__(self, free: int) -> None:
        self.free = free


@pytest.mark.parametrize("needed_mb", [1, 96, 278, 473])
def test_as_much_is_asked_for_as_is_needed_and_no_more(
    needed_mb: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    enough = needed_mb * MB + SPARE_B
    monkeypatch.setattr(programs.shutil, "disk_usage", lambda _: Usage(enough))
    check_space(tmp_path, needed_mb * MB)
    monkeypatch.setattr(programs.shutil, "disk_usage", lambda _: Usage(enough - MB))
    said = f"{enough // MB} MB are needed in {tmp_path}, {enough // MB - 1} MB are free"
    with pytest.raises(RefusedError, match=f"{said}; .*nothing was changed"):
        check_space(tmp_path, needed_mb * MB)


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Source:
    """One wheel, for any role."""
    tree = tmp_path / "bundle"
    (tree / "wheels").mkdir(parents=True)
    wheel = tree / "wheels/room-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("room.py", "x = 1\n")
    for name in ("deploy/installer", "systemd"):
        (tree / name).mkdir(parents=True)
    (tree / "deploy/installer/loading.py").write_text("")
    (tree / "README.md").write_text("")
    (tree / SUMS).write_text("sums")
    monkeypatch.setattr(programs.wheelhouse, "needed", lambda *_: [Wheel(wheel)])
    return Source(tree, True, "1.0")


def test_it_has_its_name_once_it_is_whole(bundle: Source, tmp_path: Path) -> None:
    versions = Versions(tmp_path / "opt")
    versions.prefix.mkdir()
    laid = programs.lay(bundle, frozenset({"edge"}), versions)
    assert laid == versions.prefix / "1.0"
    assert (laid / "bin/edge-node").read_text().startswith(f"#!{laid}/bin/python\n")
    assert programs.lay(bundle, frozenset({"edge"}), versions) == laid  # the same: nothing is laid over what runs
    assert programs.lay(bundle, frozenset({"base", "edge"}), versions).name == "1.0.2"


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), zipfile.BadZipFile("cut")])
def test_a_disk_that_is_full_half_way_leaves_nothing(
    fault: Exception, bundle: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    versions = Versions(tmp_path / "opt")
    versions.prefix.mkdir()
    before = programs.lay(bundle, frozenset({"edge"}), versions)

    def full(*_: object) -> None:
        raise fault

    monkeypatch.setattr(unpacking, "unpack_wheel", full)
    with pytest.raises(RefusedError, match=r"1\.0\.2 could not be laid .*nothing was changed"):
        programs.lay(bundle, frozenset({"base"}), versions)
    assert [*versions.prefix.iterdir()] == [before]


def test_a_second_installer_waits_for_the_first_and_says_so(tmp_path: Path) -> None:
    hold = (
        "import sys, time; from pathlib import Path; from deploy.installer import machine, places\n"
        f"with machine.alone(places.Places(Path({str(tmp_path)!r}))): print('in', flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", hold]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as first:
        assert first.stdout is not None
        assert first.stdin is not None
        assert first.stdout.readline() == "in\n"
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as second:
            assert second.stdout is not None
            assert second.stdin is not None
            assert "another installation is going on: waiting for it" in second.stdout.readline()
            first.stdin.close()
            assert second.stdout.readline() == "in\n"
            second.stdin.close()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(self))

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(
        RefusedError, match=r"cannot be written \(Read-only file system\); its disk is mounted read-only"
    ):
        machine.check_writable(Places(tmp_path))


def test_a_service_that_has_failed_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 2, at first installation or upgrade: known at once, not after a minute."""
    said = {"ActiveState": "failed", "SubState": "failed", "ExecMainStatus": "2", "Result": "exit-code"}
    monkeypatch.setattr(services, "show", lambda _, *names: [said.get(name, "0") for name in names])
    began_s = time.monotonic()
    assert services.come_up(["edge-node"], 40.0) == {"edge-node": "failed (exit-code, exit code 2)"}
    assert time.monotonic() - began_s < 10 * services.POLL_S


def test_one_before_it_that_had_to_be_killed_is_not_its_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """A version that hangs when it is told to end is killed after ten seconds: failed, its start still to come."""
    hung = {"ActiveState": "failed", "SubState": "failed", "ExecMainStatus": "9", "Result": "timeout", "Job": "41"}
    up = {"ActiveState": "active", "SubState": "running", "MainPID": "7", "NRestarts": "0", "Job": "0"}
    told = [hung]
    monkeypatch.setattr(services, "show", lambda _, *names: [told[-1].get(name, "0") for name in names])
    timer = threading.Timer(1.2, told.append, [up])
    timer.start()
    assert services.come_up(["edge-node"], 1.0) == {}
    timer.join()


def test_one_that_dies_while_it_is_watched_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    up = {"ActiveState": "active", "SubState": "running", "MainPID": "7", "NRestarts": "0", "Result": "success"}
    died = up | {"ActiveState": "activating", "SubState": "auto-restart", "MainPID": "0"}
    told = [up]
    monkeypatch.setattr(services, "show", lambda _, *names: [told[-1].get(name, "0") for name in names])
    timer = threading.Timer(1.2, told.append, [died])
    timer.start()
    assert services.come_up(["base-station"], 40.0) == {"base-station": "died 1 times since it was started"}
    timer.join()

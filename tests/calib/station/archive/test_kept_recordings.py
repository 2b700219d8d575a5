"""When room runs out the oldest recording goes, never the one that is written, and what is finished is made small."""

import os
import shutil
import time
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import pytest

from calib.station.archive import kept_recordings
from calib.station.archive.compressing import is_compressed
from calib.station.archive.kept_recordings import KeptRecordings
from calib.station.archive.recording import Recorder, read
from calib.station.config import RecordingSection

T = 1_800_000_000 * 10**9
MB = 10**6
Until = Callable[..., bool]


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_recordings, "LOOK_AGAIN_S", 0.05)


def made(folder: Path, *names: str, size: int = 1000) -> list[Path]:
    files = [folder / name for name in names]
    for file in files:
        file.write_bytes(b"x" * size)
    return files


def test_the_oldest_go_until_the_limit_is_kept(tmp_path: Path, until: Until) -> None:
    files = made(tmp_path, *(f"hill-2026010{day}T120000.mcap" for day in range(1, 8)), size=3 * MB)
    others = made(tmp_path, "lake-20250101T000000.mcap", "hill-notes.txt", "hill-20250101T000000.mcap.bak")
    options = RecordingSection(folder="x", max_total_mb=10, compress=False)
    with KeptRecordings(tmp_path, "hill", options, lambda: files[-1]) as kept:
        assert until(lambda: kept.removed == 4)
        time.sleep(0.3)
        assert kept.removed == 4
        assert kept.check().level == "warn"
        assert files[3].name in kept.check().reason
        assert kept.counters["recordings_removed"] == 4
    assert [file.exists() for file in files] == [False] * 4 + [True] * 3
    assert all(other.exists() for other in others)


Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize(("when_full", "left"), [("oldest_out", 2), ("stop", 4)])
def test_a_disk_that_fills_loses_the_oldest_or_nothing_as_configured(
    tmp_path: Path, until: Until, monkeypatch: pytest.MonkeyPatch, when_full: str, left: int
) -> None:
    files = made(tmp_path, *(f"hill-2026010{day}T120000.mcap" for day in range(1, 5)), size=60 * MB)

    def usage(_folder: Path) -> Usage:
        used = sum(file.stat().st_size for file in tmp_path.iterdir())
        return Usage(810 * MB, used, 810 * MB - used)  # 570 free of a wanted 500 and 100 of headroom

    monkeypatch.setattr(shutil, "disk_usage", usage)
    options = RecordingSection(folder="x", min_free_mb=590, when_full=when_full, compress=False)  # type: ignore[arg-type]
    with KeptRecordings(tmp_path, "hill", options, lambda: files[-1]) as kept:
        until(lambda: kept.removed == 4 - left, within_s=2.0)
        time.sleep(0.3)
    assert sum(file.exists() for file in files) == left
    assert files[-1].exists()


def test_the_file_that_is_written_is_never_removed(tmp_path: Path) -> None:
    (only,) = made(tmp_path, "hill-20260101T120000.mcap", size=12 * MB)
    options = RecordingSection(folder="x", max_total_mb=10, compress=False)
    with KeptRecordings(tmp_path, "hill", options, lambda: only):
        time.sleep(0.3)
    assert only.exists()


def test_what_is_finished_is_compressed_and_what_is_written_is_not(tmp_path: Path, until: Until) -> None:
    recorder = Recorder(tmp_path, "hill", max_file_mb=1, min_free_mb=1)
    for k in range(30):
        recorder.write("skyfix/1/s/cam/cam0/tracks", b'"' + b"x" * 100_000 + b'"', T + k * 10**9)
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) == 3
    past_s = time.time() - 60
    for file in files:
        os.utime(file, (past_s, past_s))
    (broken,) = made(tmp_path, "hill-20260101T120000.mcap")
    os.utime(broken, (past_s, past_s))
    with KeptRecordings(tmp_path, "hill", RecordingSection(folder="x"), lambda: recorder.current) as kept:
        assert until(lambda: kept.compressed == 2, within_s=30.0)
    assert [is_compressed(file) for file in files] == [True, True, False]
    assert broken.read_bytes() == b"x" * 1000
    recorder.close()
    assert sum(len(list(read(file))) for file in files) == 30


def test_it_stops_at_once_in_the_middle_of_compressing_and_leaves_no_part(tmp_path: Path, until: Until) -> None:
    recorder = Recorder(tmp_path, "hill", min_free_mb=1)
    for k in range(60_000):
        recorder.write("skyfix/1/s/cam/cam0/tracks", b'{"n":%d}' % k, T + k)
    recorder.close()
    assert recorder.path is not None
    os.utime(recorder.path, (0, 0))
    options = RecordingSection(folder="x")
    with KeptRecordings(tmp_path, "hill", options, lambda: None) as kept:
        assert until(lambda: kept._child is not None)
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 2.0
    with KeptRecordings(tmp_path, "hill", options, lambda: None) as kept:
        assert until(lambda: kept.compressed == 1, within_s=30.0)
    assert list(tmp_path.glob("*.part")) == []
    assert sum(1 for _ in read(recorder.path)) == 60_000


def test_a_folder_that_is_not_there_yet_is_no_fault(tmp_path: Path) -> None:
    with KeptRecordings(tmp_path / "none", "hill", RecordingSection(folder="x"), lambda: None) as kept:
        time.sleep(0.2)
        assert kept.check().level == "ok"

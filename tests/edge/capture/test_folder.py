"""Folders of images give every picture its honest time, and every failure its name."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.capture.folder import ImageFolder
from edge.common.errors import SourceError
from tests.edge.capture.sources import MS, T0, frames_of


def test_folder_in_order_of_names_with_stamps_from_names(tmp_path: Path) -> None:
    for k in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"cam_{T0 + k * 50 * MS}.png"), np.full((12, 16), k, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=5, bound_s=0.0, fps=30))
    assert [frame.t_unix_ns for frame in frames] == [T0, T0 + 50 * MS, T0 + 100 * MS]
    assert [int(frame.image[0, 0]) for frame in frames] == [0, 1, 2]


def test_folder_without_stamps_counts(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.zeros((12, 16), np.uint8))
    frames = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20))
    assert [frame.t_unix_ns - T0 for frame in frames] == [0, 50 * MS, 100 * MS]


def test_folder_that_grows(tmp_path: Path, until) -> None:
    stop, seen = threading.Event(), []
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, follow=True, stop=stop)
    thread = threading.Thread(target=lambda: seen.extend(iter(source.read, None)))
    thread.start()
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), np.full((12, 16), k, np.uint8))
        assert until(lambda k=k: len(seen) >= k)  # the newest may still be written to
    source.close()
    thread.join(2)
    assert [int(frame.image[0, 0]) for frame in seen] == [0, 1, 2]


def test_broken_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no")
    with pytest.raises(SourceError, match=r"a\.png.*no image"):
        ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20).read()


def write(path: Path, level: int) -> Path:
    cv2.imwrite(str(path), np.full((48, 64), level, np.uint8))
    return path


def test_names_without_zeros_come_in_order_and_numbers_keep_their_gaps(tmp_path: Path) -> None:
    for k in (1, 2, 3, 9, 10, 11, 20):
        write(tmp_path / f"{k}.png", k)
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.001, fps=10)
    frames = frames_of(source)
    assert [int(frame.image[0, 0]) for frame in frames] == [1, 2, 3, 9, 10, 11, 20]
    assert [(frame.t_unix_ns - T0) // (100 * MS) for frame in frames] == [0, 1, 2, 8, 9, 10, 19]
    assert "no time that is understood" in source.remarks[0].what


def test_a_rate_that_nobody_said_has_no_bound(tmp_path: Path) -> None:
    write(tmp_path / "1.png", 1)
    assert frames_of(ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.001, fps=None))[0].bound_s is None


def test_a_growing_folder_whose_numbers_gain_a_digit(tmp_path: Path) -> None:
    stop = threading.Event()
    for k in range(7, 13):
        write(tmp_path / f"img{k}.png", k)
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, follow=True, stop=stop)
    seen = [int(source.read().image[0, 0]) for _ in range(5)]
    stop.set()
    assert [*seen, int(source.read().image[0, 0])] == [7, 8, 9, 10, 11, 12]


def test_cut_off_and_hidden_pictures_are_left_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.jpg"), rng.integers(0, 255, (64, 64), np.uint8))
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, (64, 64), np.uint8))
    for name in ("1.jpg", "2.png"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    (tmp_path / "._0.jpg").write_bytes(b"not a picture")
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20)
    assert len(frames_of(source)) == 4
    assert any("2 files are cut off" in remark.what for remark in source.remarks)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".bmp", ".webp"])
@pytest.mark.parametrize("damage", ["empty", "half", "another"])
def test_a_file_that_is_no_whole_picture_ends_nothing(tmp_path: Path, suffix: str, damage: str) -> None:
    rng = np.random.default_rng(181)
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}{suffix}"), rng.integers(0, 255, (64, 64), np.uint8))
    whole = (tmp_path / f"1{suffix}").read_bytes()
    (tmp_path / f"1{suffix}").write_bytes(
        {"empty": b"", "half": whole[: len(whole) // 2], "another": b"<html>"}[damage]
    )
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, loop=True)
    stamps = [source.read().t_unix_ns - T0 for _ in range(6)]
    assert stamps == [k * 50 * MS for k in (0, 2, 3, 4, 6, 7)]
    assert [remark.what for remark in source.remarks][1:] == [
        f"2 files are cut off or no pictures and left out, 1{suffix} the last of them"
    ]


@pytest.mark.parametrize("stray", ["snapshot", "cover", "_thumbnail"])
@pytest.mark.parametrize("follow", [False, True])
def test_a_name_of_another_kind_is_left_out_and_never_dated(tmp_path: Path, stray: str, follow: bool) -> None:
    for k in range(10):
        write(tmp_path / f"{(T0 + k * 40 * MS) // MS}.png", k)
    stop = threading.Event()
    source = ImageFolder(str(tmp_path), t0_unix_ns=5, bound_s=0.01, fps=None, follow=follow, stop=stop)
    first = source.read()
    write(tmp_path / f"{stray}.png", 99)  # it comes while the folder is read, or was there
    write(tmp_path / f"{(T0 + 400 * MS) // MS}.png", 10)
    if not follow:
        source = ImageFolder(str(tmp_path), t0_unix_ns=5, bound_s=0.01, fps=None)
        first = source.read()
    stop.set()
    frames = [first, *frames_of(source)]
    assert {frame.t_unix_ns: int(frame.image[0, 0]) for frame in frames} == {
        T0 + k * 40 * MS: k for k in range(len(frames))
    }
    assert len(frames) >= 10
    (said,) = (remark for remark in source.remarks if f"{stray}.png" in remark.what)
    assert "name them as the others" in said.action


def test_a_folder_that_goes_away_or_is_empty_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    with pytest.raises(SourceError, match="holds no picture"):
        ImageFolder(str(tmp_path / "in"), t0_unix_ns=T0, bound_s=0.0, fps=20)
    for k in range(3):
        write(tmp_path / "in" / f"{k}.png", k)
    source = ImageFolder(str(tmp_path / "in"), t0_unix_ns=T0, bound_s=0.0, fps=20, follow=True)
    source.read()
    (tmp_path / "in").rename(tmp_path / "gone")
    with pytest.raises(SourceError, match="is gone"):
        frames_of(source)


def test_a_folder_plays_again_in_time(tmp_path: Path) -> None:
    for k in range(3):
        write(tmp_path / f"{k}.png", k)
    source = ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20, loop=True)
    frames = [source.read() for _ in range(8)]
    assert [frame.t_unix_ns - T0 for frame in frames] == [50 * MS * k for k in range(8)]
    assert [frame.segment for frame in frames] == [0, 0, 0, 1, 1, 1, 2, 2]


def test_sixteen_bits_are_stretched_by_contrast(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    scene = rng.normal(8000, 60, (60, 80))
    scene[20:24, 30:34] += 700  # what flies is warmer
    cv2.imwrite(str(tmp_path / "1.tiff"), scene.astype(np.uint16))
    image = frames_of(ImageFolder(str(tmp_path), t0_unix_ns=T0, bound_s=0.0, fps=20))[0].image
    assert image.dtype == np.uint8
    assert image[21, 31] - np.median(image) > 60
    assert image.astype(float).std() > 5

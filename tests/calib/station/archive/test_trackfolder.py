"""Tracks of other programs: what is a measurement is kept, what is not is dropped, what is unreadable is named."""

import logging
from pathlib import Path

import numpy as np
import pytest

from calib.observations import Observations
from calib.station.archive import trackfolder
from calib.station.archive.replay_source import play_back
from edge.common.errors import ConfigError, SkyfixError

T_NS = 1_800_000_000 * 10**9
STEP_NS = 10**8
HEADER = "t_unix_ns,u_px,v_px,track,status"
SITE = '[site]\nname = "hill"\n' + "".join(
    f'[[camera]]\nid = "cam{k}"\nsize_px = [1920, 1080]\nlens = "radtan"\nintrinsics = [1300.0, 1300.0, 960.0, 540.0]\n'
    f"distortion = [0.0, 0.0, 0.0, 0.0]\nposition = [47.0, 8.0, {500 + k}.0]\n"
    for k in range(3)
)


def folder_of(path: Path, **rows: list[str]) -> Path:
    """A track folder with these rows by camera; a camera that is not given has forty good ones."""
    (path / "tracks").mkdir(parents=True)
    (path / "site.toml").write_text(SITE)
    for camera in ("cam0", "cam1", "cam2"):
        lines = rows.get(camera, [good(k) for k in range(40)])
        (path / "tracks" / f"{camera}.csv").write_text("\n".join([HEADER, *lines, ""]))
    return path


def good(k: int, *, u: object = 900.0, track: object = 1, status: str = "confirmed", t_ns: int = T_NS) -> str:
    return f"{t_ns + k * STEP_NS},{u},540.0,{track},{status}"


def read(path: Path) -> Observations:
    return play_back(path).scene.observations["cam0"]


@pytest.mark.parametrize(
    ("bad", "kept"),
    [
        (good(40, u="nan"), 40),
        (good(40, u="inf"), 40),
        (good(40, u=1e9), 40),
        (good(40, u=1920 * 1.07), 40),
        (good(40, u=1920 * 1.04), 41),
        (good(40, status="interpolated"), 40),
        (good(40, status=""), 41),
        ("12345,900.0,540.0,1,confirmed", 40),
        (good(40, track=-1), 41),
        (good(40, track=""), 41),
    ],
)
def test_a_row_that_is_no_measurement_is_not_used(bad: str, kept: int, tmp_path: Path) -> None:
    seen = read(folder_of(tmp_path / "f", cam0=[*(good(k) for k in range(40)), bad]))
    assert len(seen) == kept
    assert np.isfinite(seen.pixels).all()


def test_what_is_dropped_is_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rows = [*(good(k) for k in range(40)), good(40, u="nan"), good(41, u=4000.0), good(42, u=4000.0)]
    with caplog.at_level(logging.WARNING):
        played = play_back(folder_of(tmp_path / "f", cam0=rows))
    assert "1 rows whose pixel is none" in caplog.text
    (refusal,) = played.refused
    assert (refusal.camera, refusal.count) == ("cam0", 2)
    assert "outside its 1920 x 1080 image" in refusal.reason


def test_rows_in_any_order_are_sorted_and_tracks_kept_apart(tmp_path: Path) -> None:
    rows = [good(k, track=[-1, 0, 7][k % 3]) for k in reversed(range(30))]
    seen = read(folder_of(tmp_path / "f", cam0=rows))
    assert np.all(np.diff(seen.t_unix_ns) == STEP_NS)
    assert len(np.unique(seen.track)) == 3


def test_several_rows_of_one_frame_are_all_kept(tmp_path: Path) -> None:
    rows = [good(k, u=u, track=track) for k in range(30) for track, u in ((1, 100.0), (2, 200.0))]
    assert len(read(folder_of(tmp_path / "f", cam0=rows))) == 60


def test_cameras_that_nobody_synchronised_are_kept_in_whole(tmp_path: Path) -> None:
    """25 s and two hours apart, as films from people's own cameras are: only the solver can say by how much."""
    rows = {
        f"cam{k}": [good(j, t_ns=T_NS + shift_s * 10**9) for j in range(40)] for k, shift_s in enumerate((0, 25, -7200))
    }
    played = play_back(folder_of(tmp_path / "f", **rows))
    assert [len(seen) for seen in played.scene.observations.values()] == [40, 40, 40]
    assert played.refused == ()


def test_what_is_known_of_a_camera_arrives(tmp_path: Path) -> None:
    path = folder_of(tmp_path / "f")
    more = (
        "clock_bound_s = 0.001\nreadout_s = 0.0\nup_cam = [0.0, -1.0, 0.0]\nup_sigma_deg = 1.0\nfocal_sigma_px = 3.0\n"
    )
    (path / "site.toml").write_text(SITE + more)
    first, _, last = play_back(path).scene.cameras
    assert (last.clock_bound_s, last.readout_s, last.up_sigma_deg, last.lens.focal_sigma_px) == (0.001, 0.0, 1.0, 3.0)
    assert last.up_cam is not None
    assert last.up_cam.tolist() == [0.0, -1.0, 0.0]
    assert (first.clock_bound_s, first.readout_s, first.up_cam) == (None, None, None), "not known, and not zero"
    assert first.position_covariance is not None


@pytest.mark.parametrize(
    ("rows", "named"),
    [
        (["x,1,2,3,"], ["cam0.csv", "t_unix_ns", "whole nanoseconds"]),
        ([good(0, u="left")], ["cam0.csv, line 2", "u_px", "give numbers"]),
        ([good(0), "1,2"], ["cam0.csv, line 3", "has 2 of 5 columns"]),
        ([good(0), "", "# a remark", good(1, u="left")], ["cam0.csv, line 5", "'left' is no number"]),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(rows: list[str], named: list[str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        trackfolder.read(folder_of(tmp_path / "f", cam0=rows))
    for words in named:
        assert words in str(caught.value)


def test_a_folder_without_rows_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SkyfixError, match="no row"):
        play_back(folder_of(tmp_path / "f", cam0=[], cam1=[], cam2=[]))


def walk(*, size_px: tuple[float, float], every: int = 1) -> list[str]:
    """A flight over a whole picture, there and back in both directions."""
    t = np.arange(0, 400, every)
    u = size_px[0] * (0.5 + 0.45 * np.sin(t / 23))
    v = size_px[1] * (0.5 + 0.45 * np.sin(t / 31))
    return [f"{T_NS + k * STEP_NS},{a:.2f},{b:.2f},1," for k, a, b in zip(t.tolist(), u, v, strict=True)]


@pytest.mark.parametrize(("size", "turned"), [((1080, 1920), True), ((3840, 2160), False)])
def test_tracks_of_another_picture_than_the_lens_are_named(size: tuple[int, int], turned: bool, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cam0\.csv: \d+ rows lie outside the 1920 x 1080 picture") as caught:
        trackfolder.read(folder_of(tmp_path / "f", cam0=walk(size_px=size)))
    assert ("a picture that is turned" in str(caught.value)) == turned


def test_a_trackers_guesses_beyond_the_edge_are_dropped_as_ever(tmp_path: Path) -> None:
    """It goes on in a straight line for a second wherever the object left the picture, and at 0, 0 when it gives up."""
    rows = walk(size_px=(1920, 1080))
    beyond = [good(400 + k, u=2030 + 30 * (k % 10)) for k in range(60)]
    unseen = [good(500 + k, u=-999.0) for k in range(100)]
    seen = read(folder_of(tmp_path / "f", cam0=[*rows, *beyond, *unseen]))
    assert len(seen) == 400


def test_names_that_differ_by_case_only_are_named(tmp_path: Path) -> None:
    path = folder_of(tmp_path / "f")
    (path / "tracks" / "cam0.csv").rename(path / "tracks" / "Cam0.csv")
    with pytest.raises(ConfigError, match=r"Cam0\.csv: is no camera's, .* camera cam0 .* by case") as caught:
        trackfolder.read(path)
    assert caught.value.action == "rename it to cam0.csv"


def test_a_suffix_in_capitals_is_a_track_file(tmp_path: Path) -> None:
    path = folder_of(tmp_path / "f")
    (path / "tracks" / "cam0.csv").rename(path / "tracks" / "cam0.CSV")
    assert len(read(path)) == 40


def test_a_pixel_that_is_not_said_is_no_measurement(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rows = [good(k, u="" if k % 4 == 0 else 900.0) for k in range(40)]
    assert len(read(folder_of(tmp_path / "f", cam0=rows))) == 30
    assert "10 rows whose pixel is none, the first in line 2" in caplog.text

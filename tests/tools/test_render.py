"""Footage is truth for whoever trains or measures on it: the object must be where and when its label says."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.simulation.description import CameraSpec, ObjectSpec, Simulation, Weather
from calib.simulation.simulation import watch
from tools import render as program
from tools.rendering.footage import Frame, footage
from tools.rendering.silhouette import FLAP_PHASES, draw, shape

CLEAR = Weather(clouds=0.0, foliage=0.0, sun=False, sensor_noise=0.0)
SKYWARDS = {"size_px": (320, 240), "intrinsics": (300.0, 300.0, 159.5, 119.5), "centre_enu": (0.0, 0.0, 0.0)}


def scene(weather: Weather = CLEAR, **changes: object) -> Simulation:
    """A drone that crosses the picture of one small camera in a second."""
    drone = ObjectSpec(waypoints_enu=((-4.0, 30.0, 20.0), (4.0, 30.0, 22.0)), step_s=1.0, width_m=1.2, height_m=0.5)
    camera = CameraSpec(id="cam0", **(SKYWARDS | {"look_at_enu": (0.0, 30.0, 21.0), "frame_rate_hz": 20.0} | changes))  # type: ignore[arg-type]
    return Simulation(seed=4, object=(drone,), camera=(camera,), weather=weather)


def frames(simulation: Simulation) -> list[Frame]:
    return list(footage(watch(simulation), 0))


def centre_of_darkness(frame: Frame, empty: np.ndarray) -> np.ndarray:
    """Mean position (u, v) of what an object took from the light of an empty sky."""
    dark = empty.astype(float).sum(axis=2) - frame.image.astype(float).sum(axis=2)
    dark[dark < 6] = 0  # rounding of three channels
    v, u = np.mgrid[: dark.shape[0], : dark.shape[1]]
    return np.array([(u * dark).sum(), (v * dark).sum()]) / dark.sum()


@pytest.mark.parametrize("kind", ["drone", "bird", "aeroplane", "helicopter"])
@pytest.mark.parametrize("width_px", [4.0, 11.3, 70.0])
def test_a_shape_is_drawn_where_it_is_asked_for(kind: str, width_px: float) -> None:
    for phase in range(0, FLAP_PHASES, 5) if kind == "bird" else [0]:
        outline = shape(kind, 0.5, phase)
        for centre in ([20.0, 30.0], [20.37, 29.81]):
            drawn = draw(outline, width_px, np.eye(2), np.array([centre]))
            v, u = np.mgrid[: drawn.matte.shape[0], : drawn.matte.shape[1]]
            found = np.array([(u * drawn.matte).sum(), (v * drawn.matte).sum()]) / drawn.matte.sum()
            # Averaging into pixels after a blur of 0.55 px leaves less than 0.01 px of their grid.
            found += (drawn.x, drawn.y)
            assert found == pytest.approx(centre, abs=0.02)


def test_the_object_is_where_its_label_says() -> None:
    drawn = frames(scene())
    background = np.maximum.reduce([frame.image for frame in drawn])
    assert background.shape == (240, 320, 3)
    assert len(drawn) == 21
    for frame in drawn[3:-3]:
        (label,) = frame.labels
        assert centre_of_darkness(frame, background) == pytest.approx(label.centre_px, abs=0.25)  # 12 px wide
        left, top, width, height = label.box_px
        dark = np.argwhere(background[:, :, 0].astype(int) - frame.image[:, :, 0] > 12)
        assert dark.min(axis=0) == pytest.approx([top, left], abs=1.5)
        assert dark.max(axis=0) == pytest.approx([top + height, left + width], abs=1.5)


def test_motion_blur_widens_and_does_not_move() -> None:
    sharp, blurred = (frames(scene(exposure_s=exposure))[10].labels[0] for exposure in (0.0, 0.05))
    assert sharp.centre_px == pytest.approx(blurred.centre_px)
    # 8 m/s at 36.6 m and 300 px is 66 px/s: 3.3 px in 0.05 s, less half a sub-exposure at either end.
    assert blurred.box_px[2] - sharp.box_px[2] == pytest.approx(3.3, abs=0.6)


def test_rolling_shutter_shows_the_object_when_its_row_is_read() -> None:
    still, rolling = (frames(scene(readout_s=readout))[10].labels[0].centre_px for readout in (0.0, 0.04))
    delay_s = 0.04 * rolling[1] / 240
    assert rolling[0] - still[0] == pytest.approx(66 * delay_s, abs=0.1)


def test_the_same_scene_gives_the_same_frames_and_weather_moves() -> None:
    stormy = scene(Weather(clouds=0.6, foliage=1.0, sensor_noise=0.0), look_at_enu=(0.0, 30.0, 5.0))
    first, again = frames(stormy), frames(stormy)
    assert all(np.array_equal(a.image, b.image) for a, b in zip(first, again, strict=True))
    change = np.abs(first[0].image.astype(int) - first[10].image).sum(axis=2).max(axis=1)
    green = np.argmax(first[0].image.mean(axis=1), axis=1) == 1
    assert green.any()
    assert (change[green] > 50).sum() > 10  # leaves; the ground below them stands
    assert 0 < np.median(change[~green]) < 50  # clouds


def test_sensor_noise_has_the_sigma_asked_for() -> None:
    weathers = [Weather(clouds=0, foliage=0, sun=False, sensor_noise=sigma) for sigma in (0.0, 3.0)]
    quiet, noisy = (frames(scene(weather))[0].image.astype(float) for weather in weathers)
    assert np.std(noisy - quiet) == pytest.approx(3.0, rel=0.03)


def test_an_object_behind_trees_is_labelled_hidden() -> None:
    low = ObjectSpec(waypoints_enu=((-3.0, 30.0, -3.0), (3.0, 30.0, -3.0)), step_s=1.0)
    wooded = Weather(clouds=0.0, foliage=0.0, sun=False, sensor_noise=0.0)
    camera = scene(look_at_enu=(0.0, 30.0, 0.0)).camera[0]
    drawn = frames(Simulation(seed=1, object=(low,), camera=(camera,), weather=wooded))
    assert all(label.visible < 0.01 for frame in drawn for label in frame.labels)


def test_program_writes_video_and_labels_of_the_same_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = """
seed = 4
[weather]
clouds = 0.3
[[object]]
waypoints_enu = [[-4.0, 30.0, 20.0], [4.0, 30.0, 22.0]]
width_m = 1.2
[[camera]]
id = "cam0"
size_px = [320, 240]
intrinsics = [300.0, 300.0, 159.5, 119.5]
centre_enu = [0.0, 0.0, 0.0]
look_at_enu = [0.0, 30.0, 21.0]
frame_rate_hz = 25.0
"""
    (tmp_path / "scene.toml").write_text(text)
    assert program.main([str(tmp_path / "scene.toml"), "-o", str(tmp_path)]) == 0
    assert "cam0.mp4" in capsys.readouterr().out
    video = cv2.VideoCapture(str(tmp_path / "cam0.mp4"))
    stamps_ms = []
    while video.grab():
        stamps_ms.append(video.get(cv2.CAP_PROP_POS_MSEC))
    assert stamps_ms == pytest.approx(40.0 * np.arange(26))
    table = np.loadtxt(tmp_path / "cam0.csv", delimiter=",", skiprows=1, usecols=range(7))
    assert len(table) == 26
    assert table[:, 5] == pytest.approx(table[:, 1] + table[:, 3] / 2, abs=2.0)


def test_a_scene_that_cannot_be_read_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main([str(tmp_path / "none.toml"), "-o", str(tmp_path)]) == 2
    assert "none.toml" in capsys.readouterr().err

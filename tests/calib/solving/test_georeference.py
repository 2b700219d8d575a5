"""A scaffold laid on its survey: two positions exchanged, one wrong, pictures mirrored, and sites too alike to tell."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.observations import SiteCamera
from calib.solving.doubts import Claim
from calib.solving.georeference import Georeference, georeference
from calib.solving.scaffold import Pose, Scaffold
from edge.common.arrays import Array
from tests.calib.solving.claims import LENS_MODEL

IRREGULAR = np.array([[-70.0, -60.0, 1.0], [75.0, -55.0, 2.0], [5.0, 85.0, 0.0], [-80.0, 60.0, 3.0], [30.0, 20.0, 8.0]])
SQUARE = 100.0 * np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
TRIANGLE = 100.0 * np.array([[np.sin(a), np.cos(a), 0.0] for a in 2 * np.pi * np.arange(3) / 3])
FLOWN = np.random.default_rng(1).uniform([-30.0, -30.0, 20.0], [30.0, 30.0, 60.0], (50, 3))
SIGMA_M = 0.02


def looking_at(centre: Array, target: Array) -> Array:
    ahead = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(ahead, right), ahead])


def scaffold(places: Array, seed: int = 2, mirror: Array | None = None) -> Scaffold:
    """Cameras at these places in a frame of its own, as two-view geometry finds them."""
    rng = np.random.default_rng(seed)
    turn, scale, shift = rotation(rng.normal(size=3).tolist()), rng.uniform(0.005, 0.02), rng.normal(0, 3, 3)
    flip = np.eye(3) if mirror is None else mirror

    def own(points: Array) -> Array:
        return (scale * (points @ turn.T) + shift) @ flip

    poses = {
        f"cam{k}": Pose(flip @ looking_at(place, np.array([0.0, 0.0, 40.0])) @ turn.T @ flip, own(place[None])[0], 1.0)
        for k, place in enumerate(places)
    }
    return Scaffold(("cam0", "cam1"), poses, np.zeros(len(FLOWN)), own(FLOWN), np.zeros(len(FLOWN), np.int64))


def sites(surveyed: Array, **up_cam: Array) -> dict[str, SiteCamera]:
    return {
        f"cam{k}": SiteCamera(
            f"cam{k}", LENS_MODEL, place, np.eye(3) * SIGMA_M**2, up_cam=up_cam.get(f"cam{k}"), up_sigma_deg=1.0
        )
        for k, place in enumerate(surveyed)
    }


def exchanged(places: Array, one: int, two: int) -> Array:
    order = np.arange(len(places))
    order[[one, two]] = two, one
    return places[order]


def believed(places: Array, surveyed: Array) -> Georeference:
    """Georeferenced; the flight is where it was."""
    built = scaffold(places)
    found = georeference(built, sites(surveyed))
    assert found.similarity.apply(built.points) == pytest.approx(FLOWN, abs=1.0)
    return found


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), count=st.integers(3, 5))
def test_a_good_survey_is_taken_as_it_is_in_any_frame(seed: int, count: int) -> None:
    built = scaffold(IRREGULAR[:count], seed)
    found = georeference(built, sites(IRREGULAR[:count]))
    assert found.doubts == ()
    assert found.similarity.apply(built.points) == pytest.approx(FLOWN, abs=1e-6)


@pytest.mark.parametrize("pair", [(0, 1), (1, 3), (2, 4), (0, 4)])
def test_two_positions_exchanged_are_gone_on_with_the_other_way_and_doubted(pair: tuple[int, int]) -> None:
    found = believed(IRREGULAR, exchanged(IRREGULAR, *pair))
    assert {one.doubt.cameras for one in found.doubts} == {(f"cam{k}",) for k in pair}
    assert {one.doubt.claim for one in found.doubts} == {Claim.POSITION}


@pytest.mark.parametrize("off_m", [(60.0, 0.0, 0.0), (0.0, -150.0, 30.0), (1000.0, 0.0, 0.0)])
@pytest.mark.parametrize("who", [0, 2])
def test_a_position_far_off_is_where_to_start_without(who: int, off_m: tuple[float, float, float]) -> None:
    wrong = IRREGULAR.copy()
    wrong[who] += off_m
    found = believed(IRREGULAR, wrong)
    assert [one.doubt.cameras for one in found.doubts] == [(f"cam{who}",)]


def test_metres_are_left_to_the_adjustment() -> None:
    wrong = IRREGULAR.copy()
    wrong[1] += [2.0, 0.0, 0.0]
    assert believed(IRREGULAR, wrong).doubts == ()


@pytest.mark.parametrize("places", [SQUARE, TRIANGLE])
def test_a_world_turned_over_for_several_reasons_is_refused_with_all_of_them(places: Array) -> None:
    """Across a square's diagonal, in a triangle of equal sides: another pair or mirrored pictures would do as well."""
    with pytest.raises(CalibrationError, match=r"upside down.*cam0 and cam2.*mirrored.*cannot be told apart"):
        georeference(scaffold(places), sites(exchanged(places, 0, 2)))


def test_neighbours_of_a_square_exchanged_are_named() -> None:
    """Two are left: too few to hold the frame, and enough to say who it is."""
    with pytest.raises(CalibrationError, match=r"positions of cam0 and cam1 are exchanged; correct it"):
        georeference(scaffold(SQUARE), sites(exchanged(SQUARE, 0, 1)))


@pytest.mark.parametrize(
    ("mirror", "words"),
    [(np.diag([-1.0, 1.0, 1.0]), "all pictures are mirrored"), (np.diag([1.0, -1.0, 1.0]), "v is counted upwards")],
)
def test_pictures_counted_from_the_wrong_side_are_refused_as_such(mirror: Array, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        georeference(scaffold(SQUARE, mirror=mirror), sites(SQUARE))


def test_cameras_that_hang_are_refused_unless_one_says_so() -> None:
    hanging = scaffold(SQUARE)
    roll = np.diag([-1.0, -1.0, 1.0])
    poses = {name: replace(pose, R=roll @ pose.R) for name, pose in hanging.poses.items()}
    hanging = replace(hanging, poses=poses)
    with pytest.raises(CalibrationError, match=r"upside down.*up_cam"):
        georeference(hanging, sites(SQUARE))
    up = roll @ looking_at(SQUARE[0], np.array([0.0, 0.0, 40.0]))[:, 2]
    found = georeference(hanging, sites(SQUARE, cam0=up))
    assert found.similarity.apply(hanging.points) == pytest.approx(FLOWN, abs=1e-6)


def test_too_few_positions_or_in_a_line_are_refused_with_what_would_help() -> None:
    with pytest.raises(CalibrationError, match=r"2 calibrated cameras.*three must.*up"):
        georeference(scaffold(SQUARE[:2]), sites(SQUARE[:2]))
    line = np.array([[-80.0, 0.0, 1.0], [0.0, 0.1, 1.0], [80.0, 0.0, 1.0]])
    with pytest.raises(CalibrationError, match=r"in a line.*up_cam"):
        georeference(scaffold(line), sites(line))


def test_a_line_with_a_level_is_taken() -> None:
    line = np.array([[-80.0, 0.0, 1.0], [0.0, 0.1, 1.0], [80.0, 0.0, 1.0]])
    built = scaffold(line)
    up = looking_at(line[0], np.array([0.0, 0.0, 40.0]))[:, 2]
    found = georeference(built, sites(line, cam0=up))
    assert found.similarity.apply(built.points) == pytest.approx(FLOWN, abs=0.2)

"""What people get wrong about a site: named where one explanation is left, covered by sigma or refused where not."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.observations import Scene
from calib.simulation.description import CameraSpec, LensFault, ObjectSpec, Roam, Simulation
from calib.simulation.simulation import Simulated
from calib.solving.found import Cause
from calib.solving.solve import SolveOptions, solve
from edge.common.arrays import Array
from tests.synthetic.solving import Solved, assert_right, solved
from tools.doubles.hazards.kinds import draw

FOCAL_PX, SIZE_PX = 1000.0, (1920, 1080)
TRUE = (FOCAL_PX, FOCAL_PX, 960.0, 540.0)
MEAN_SEA_LEVEL_M = -47.6  # a height above it where one above the ellipsoid is asked, in the middle of Europe
Key = Callable[[int], Any]


def around(count: int, seed: int = 0, radius_m: float = 100.0, **each: Key | Any) -> Simulation:
    """A regular site about a drone that roams in its middle: the cameras' own errors as large as their files claim.

    each: keys of the cameras, or functions of their number.
    """
    cameras = []
    for k in range(count):
        bearing = 2 * np.pi * k / count + (np.pi / 4 if count == 4 else 0)
        known: dict[str, Any] = {
            "id": f"cam{k}",
            "centre_enu": (radius_m * np.sin(bearing), radius_m * np.cos(bearing), 1.0 + 0.5 * (k % 2)),
            "look_at_enu": (0.0, 0.0, 40.0),
            "frame_rate_hz": 10.0,
            "phase_s": 0.011 * k,
            "noise_px": 0.7,
            "survey_error": "gaussian",
            "clock_bound_s": 0.005,
            "intrinsics": TRUE,
            "lens_error": LensFault(focal=0.01, centre_px=5.0, k1=0.005),
        }
        known |= {key: value(k) if callable(value) else value for key, value in each.items()}
        cameras.append(CameraSpec(**known))
    flight = ObjectSpec(roam=Roam(home_enu=(0.0, 0.0, 45.0)))
    return Simulation(seed=seed, duration_s=60.0, object=(flight,), camera=tuple(cameras))


def of_one(value: Any, otherwise: Any, who: int = 1) -> Key:
    return lambda k: value if k == who else otherwise


def exchanged(count: int, *order: int) -> Simulation:
    """Each camera surveyed where the one stands that `order` has in its place."""
    places = [camera.centre_enu for camera in around(count).camera]
    return around(count, survey_error_m=lambda k: tuple(np.subtract(places[order[k]], places[k]).tolist()))


def flipped(*, v: bool) -> Callable[[Simulated], Scene]:
    """All pictures counted from the wrong side: u from the right, or v upwards."""

    def change(simulated: Simulated) -> Scene:
        def pixels(seen: Array) -> Array:
            away = np.array(SIZE_PX) - 1 - seen
            return np.column_stack([seen[:, 0], away[:, 1]] if v else [away[:, 0], seen[:, 1]])

        seen = simulated.scene.observations
        return replace(
            simulated.scene, observations={name: replace(o, pixels=pixels(o.pixels)) for name, o in seen.items()}
        )

    return change


def named(found: Solved) -> set[tuple[Cause, tuple[str, ...]]]:
    return {(one.cause, one.cameras) for one in found.solution.report.findings if not one.undecided}


def accused(found: Solved) -> set[str]:
    return {name for one in found.solution.report.findings if not one.undecided for name in one.cameras}


# Positions


@pytest.mark.parametrize("seed", [0, 1])
def test_a_height_above_the_sea_in_one_of_three_is_refused_and_nobody_innocent_named(seed: int) -> None:
    height = of_one((0.0, 0.0, MEAN_SEA_LEVEL_M), (0.0, 0.0, 0.0))
    with pytest.raises(CalibrationError, match="contradicts what the cameras saw") as refused:
        solved(around(3, seed, survey_error_m=height))
    words = str(refused.value)
    among = "nobody can tell where" in words or "cannot be told apart" in words
    assert among or "the surveyed height of cam1 is off;" in words


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_height_that_leaves_the_shape_of_three_is_found_by_how_level_the_pictures_are(seed: int) -> None:
    """24 m in a triangle of 170 m: two sides are 1 % longer, which lens files of 1 % explain, and the world leans."""
    described = around(3, seed, survey_error_m=of_one((0.0, 0.0, -24.0), (0.0, 0.0, 0.0)))
    try:
        found = solved(described)
    except CalibrationError as refusal:
        assert "of cam1 is off" in str(refusal)  # noqa: PT017 - one of the two is right, and the seed decides
        return
    assert (Cause.POSITION, ("cam1",)) in {(one.cause, one.cameras) for one in found.solution.report.findings}
    assert_right(found)


@pytest.mark.parametrize("seed", [0, 1])
def test_where_pictures_are_askew_anyway_they_accuse_nobody(seed: int) -> None:
    found = solved(around(3, seed, roll_deg=lambda k: (-12.0, 7.0, 9.0)[k]))
    assert found.solution.report.findings == ()
    assert_right(found)


def test_a_survey_that_makes_an_innocent_camera_look_wrong_is_doubted_before_the_camera() -> None:
    """29 m too low, cam1 bends three cameras so that cam0 fits them no more, as it did before the survey came in."""
    scene = draw("height_msl_one_of_4", "choose", 0, 2).simulated.scene
    solution = solve(scene, SolveOptions())
    assert {camera.id for camera in solution.network.cameras} == {"cam0", "cam1", "cam2", "cam3"}
    found = [(one.cause, one.cameras) for one in solution.report.findings]
    assert found == [(Cause.POSITION, ("cam1",))]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_height_above_the_sea_in_one_of_four_is_named(seed: int) -> None:
    found = solved(around(4, seed, survey_error_m=of_one((0.0, 0.0, MEAN_SEA_LEVEL_M), (0.0, 0.0, 0.0))))
    assert named(found) == {(Cause.POSITION, ("cam1",))}
    assert_right(found)


def test_positions_rounded_to_four_decimals_are_covered() -> None:
    """To 11 m in latitude, 7.5 m in longitude, though 5 cm are claimed."""
    step = np.array([7.55, 11.1])

    def error(k: int) -> tuple[float, float, float]:
        place = np.array(around(4).camera[k].centre_enu)
        east, north = (np.round(place[:2] / step) * step - place[:2]).tolist()
        return east, north, float(np.round(place[2]) - place[2])

    found = solved(around(4, survey_error_m=error, survey_sigma_m=(0.05, 0.05, 0.05)))
    assert found.sigma_m() > 1.0
    assert len(accused(found)) in (0, 4)
    assert_right(found)


@pytest.mark.parametrize(
    ("count", "order", "words"),
    [
        (3, (1, 0, 2), r"cam0 and cam1 are exchanged.*mirrored.*cannot be told apart"),
        (4, (2, 1, 0, 3), r"cam0 and cam2 are exchanged.*cam1 and cam3 are exchanged.*cannot be told apart"),
        (4, (1, 0, 2, 3), r"cam0 and cam1 are exchanged"),
        (4, (1, 2, 0, 3), r"exchanged"),  # in a circle: in a square that is two exchanged and a quarter turn of all
        (6, (1, 4, 2, 3, 0, 5), r"the positions of cam0, cam1 and cam4 are exchanged in a circle"),
    ],
)
def test_tripods_exchanged_in_a_regular_site_are_refused_with_all_that_it_may_be(
    count: int, order: tuple[int, ...], words: str
) -> None:
    with pytest.raises(CalibrationError, match=words):
        solved(exchanged(count, *order))


def test_three_files_renamed_in_a_circle_are_named_in_a_site_that_is_not_regular() -> None:
    """The misfit of the right order is a hundredth of that of any other."""
    places = ((60.0, 80.0, 1.0), (110.0, -40.0, 2.0), (-90.0, -60.0, 1.5))
    moved = [np.subtract(places[(k + 1) % 3], places[k]) for k in range(3)]
    described = around(3, centre_enu=lambda k: places[k], survey_error_m=lambda k: tuple(moved[k].tolist()))
    with pytest.raises(CalibrationError, match="the positions of cam0, cam1 and cam2 are exchanged in a circle"):
        solved(described)


# Lens files


def test_a_guessed_focal_length_in_all_lens_files_is_named_and_covered() -> None:
    found = solved(around(4, published_intrinsics=(1.1 * FOCAL_PX, 1.1 * FOCAL_PX, 960.0, 540.0)))
    assert named(found) == {(Cause.LENS, ("cam0", "cam1", "cam2", "cam3"))}
    assert_right(found)


def test_another_zoom_in_one_lens_file_is_named_and_covered() -> None:
    found = solved(around(4, published_intrinsics=of_one((1.1 * FOCAL_PX, 1.1 * FOCAL_PX, 960.0, 540.0), None)))
    assert named(found) == {(Cause.LENS, ("cam1",))}
    assert_right(found)


def test_distortion_left_out_of_all_lens_files_is_named_and_covered() -> None:
    found = solved(around(4, distortion=(-0.25, 0.05, 0.0, 0.0), published_distortion=(0.0, 0.0, 0.0, 0.0)))
    assert named(found) == {(Cause.LENS, ("cam0", "cam1", "cam2", "cam3"))}
    assert_right(found)


# Which way is up


@pytest.mark.parametrize(("v", "words"), [(False, "all pictures are mirrored"), (True, "v is counted upwards")])
def test_pictures_counted_from_the_wrong_side_are_refused_as_such(v: bool, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        solved(around(4), change=flipped(v=v))


def with_level(simulated: Simulated) -> Scene:
    """The scene with one camera that knows where up is, to a degree."""
    first, *others = simulated.scene.cameras
    known = simulated.network.camera(first.id)
    assert known is not None
    return replace(simulated.scene, cameras=(replace(first, up_cam=known.R_cam_enu[:, 2], up_sigma_deg=1.0), *others))


def cliff() -> Simulation:
    """Four cameras on the edge of a cliff, 60 m above what flies."""
    high = around(4, centre_enu=lambda k: (40.0 * k - 60.0, -70.0 - 5.0 * (k % 2), 90.0 + 6.0 * (k in (1, 2))))
    cameras = tuple(msgspec.structs.replace(camera, look_at_enu=(0.0, 0.0, 30.0)) for camera in high.camera)
    return msgspec.structs.replace(high, camera=cameras, object=(ObjectSpec(roam=Roam(home_enu=(0.0, 0.0, 30.0))),))


@pytest.mark.parametrize("described", [around(4, roll_deg=180.0), cliff()], ids=["ceiling", "cliff"])
def test_under_a_ceiling_or_on_a_cliff_one_camera_has_to_say_where_up_is(described: Simulation) -> None:
    with pytest.raises(CalibrationError, match="up_cam"):
        solved(described)
    found = solved(described, change=with_level)
    assert len(found.names) == 4
    assert accused(found) == set()
    assert_right(found)


# Nothing


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_site_as_claimed_accuses_nobody(count: int) -> None:
    found = solved(around(count))
    assert found.solution.report.findings == ()
    assert_right(found)

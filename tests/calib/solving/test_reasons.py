"""A camera without a pose: the cause that people bring is found by trying, and named with what to do."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.observations import Scene
from calib.simulation.description import Blind
from calib.simulation.simulation import simulate
from calib.solving.found import Cause
from calib.solving.inputs import prepare
from calib.solving.scaffold import Scaffold, build
from calib.solving.solve import solve
from calib.solving.unposed import Unposed, Why, why_without_pose
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, with_rows
from tools.doubles.hazards.kinds import draw

OTHER_ZOOM = {"published_intrinsics": (1500.0, 1500.0, 960.0, 540.0)}


def scaffolded(scene: Scene) -> Scaffold:
    inputs = prepare(scene)
    return build(inputs.tracks, dict.fromkeys(inputs.tracks, 0.0))


def why(brought: Brought, name: str) -> Why:
    """Why that camera has no pose in the others' scaffold."""
    scene = brought.simulated.scene
    others = {other: seen for other, seen in scene.observations.items() if other != name}
    scaffold = scaffolded(Scene(scene.site, scene.origin, scene.cameras, others))
    whole = prepare(scene)
    camera = Unposed(whole.sites[name], scene.observations[name], whole.tracks[name], 0.0)
    return why_without_pose(scaffold.known, camera)


def of_four(seed: int, **keys: object) -> Brought:
    """A usual site of four, of which cam1 is not as its keys say."""
    simulation = scenery.usual(np.random.default_rng(seed), 4)
    return Brought(simulate(scenery.changed(simulation, {"cam1": keys})))


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize(
    ("kind", "cause", "says"),
    [
        ("mirrored_u_one", Cause.TRACKS, "mirrored"),
        ("lens_of_4k_one", Cause.LENS, "fit a picture of 1920 x 1080, and not of 3840 x 2160"),
        ("portrait_one", Cause.LENS, "fit a picture of 1080 x 1920, and not of 1920 x 1080"),
    ],
)
def test_what_makes_its_rows_fit_is_the_reason(kind: str, cause: Cause, says: str, number: int) -> None:
    brought = draw(kind, "choose", 3, number)
    (name,) = brought.faults[0].cameras
    found = why(brought, name)
    assert (found.cause, found.camera, found.shown) == (cause, name, True)
    assert says in found.what


@pytest.mark.parametrize("seed", range(3))
def test_another_zooms_lens_file_is_told_with_the_focal_length_that_fits(seed: int) -> None:
    found = why(of_four(seed, **OTHER_ZOOM), "cam1")
    assert found.cause is Cause.LENS
    # Focal lengths are tried 9 % apart, and the true one is 1000 px.
    assert any(f"about {focal} px" in found.what for focal in range(940, 1061))


def test_a_camera_that_follows_something_else_is_not_told_that_its_lens_is_wrong() -> None:
    brought = draw("other_object_one", "choose", 3, 0)
    (name,) = brought.faults[0].cameras
    found = why(brought, name)
    assert (found.cause, found.shown) == (Cause.TRACKS, False)
    assert "nor with another focal length" in found.what


def test_a_camera_that_looked_elsewhere_has_no_fault() -> None:
    found = why(of_four(0, blind=(Blind(from_s=4.0, to_s=200.0),)), "cam1")
    assert found.cause is Cause.VIEWS
    assert "hardly ever saw" in found.what


@pytest.mark.parametrize("number", range(2))
def test_lens_files_that_are_all_of_another_picture_size_are_refused_as_such(number: int) -> None:
    scene = draw("lens_of_4k_all", "choose", 3, number).simulated.scene
    with pytest.raises(CalibrationError, match="rows of all fit a picture of 1920 x 1080") as refused:
        solve(scene)
    assert "the lens file of the picture size" in refused.value.action


def mirrored(brought: Brought, name: str) -> Brought:
    rows = brought.simulated.rows[name]
    pixels = rows.pixels * (-1.0, 1.0) + (1919.0, 0.0)
    spoiled = type(rows)(rows.t_unix_ns, pixels, rows.track, rows.source, rows.size_px)
    return Brought(with_rows(brought.simulated, {name: spoiled}))


def test_one_of_three_without_a_pose_is_why_a_site_is_refused_and_nobody_is_sent_to_survey() -> None:
    scene = mirrored(Brought(simulate(scenery.usual(np.random.default_rng(5), 3))), "cam2").simulated.scene
    with pytest.raises(CalibrationError, match="mirrored") as refused:
        solve(scene)
    assert "2 of 3 surveyed cameras have a pose" in refused.value.what
    assert "cam2" in refused.value.action
    assert "survey" not in refused.value.action


@pytest.mark.parametrize("kind", ["pairs_two_drones", "pairs_take_turns"])
def test_two_pairs_that_share_nothing_are_well_and_told_what_lacks_between_them(kind: str) -> None:
    with pytest.raises(CalibrationError, match="fit one another and so do") as refused:
        solve(draw(kind, "choose", 3, 0).simulated.scene)
    assert refused.value.action.startswith("fly one object where all of them see it")


def test_where_hardly_a_camera_can_take_part_each_is_told_why() -> None:
    scene = draw("healthy_usual", "choose", 3, 0).simulated.scene
    first = scene.cameras[0].id
    still = {
        name: replace(seen, pixels=np.zeros_like(seen.pixels) + 500.0) if name != first else seen
        for name, seen in scene.observations.items()
    }
    with pytest.raises(CalibrationError, match=r"1 of \d cameras can take part, two must") as refused:
        solve(replace(scene, observations=still))
    assert "does not move" in refused.value.what

"""The clocks of a site from the tracks of all its cameras, and what is said of those that have none."""

from dataclasses import replace
from math import cos, pi, sin

import pytest

from calib.observations import Observations
from calib.simulation.description import CameraSpec, ObjectSpec, Simulation
from calib.simulation.simulation import simulate
from calib.solving.common_time import on_one_time
from calib.solving.inputs import Inputs, prepare
from calib.solving.site_clocks import CameraClock, Origin, site_clocks
from tests.calib.flights import CAMERAS, site
from tools.doubles.hazards.kinds import draw

ALIGNED_S = 0.03  # two candidates of a hundredth each, and the noise's part


def prepared(simulation: Simulation, behind_s: dict[str, float] | None = None) -> Inputs:
    """behind_s: taken off the stamps of the cameras named."""
    scene = simulate(simulation).scene
    rows: dict[str, Observations] = {
        name: replace(own, t_unix_ns=own.t_unix_ns - round((behind_s or {}).get(name, 0.0) * 1e9))
        for name, own in scene.observations.items()
    }
    return prepare(replace(scene, observations=rows))


def clocks_of(inputs: Inputs) -> dict[str, CameraClock]:
    return site_clocks(inputs.tracks, inputs.sites)


def test_all_cameras_are_tied_together() -> None:
    found = clocks_of(prepared(site(offsets_s=(0.0, 1.71, -2.2), noise_px=0.7)))
    relative = [found[name].clock.offset_s - found["cam1"].clock.offset_s for name in ("cam2", "cam3")]
    assert relative == pytest.approx([1.71, -2.2], abs=ALIGNED_S)
    assert {own.origin for own in found.values()} == {Origin.FOUND}


def test_stamps_that_are_vouched_for_stand() -> None:
    vouched = {"cam1": {"clock_bound_s": 1e-3}, "cam2": {"clock_bound_s": 1e-3}}
    found = clocks_of(prepared(site(offsets_s=(0.0, 0.0, 1.3), noise_px=3.0, special=vouched)))
    assert found["cam1"].clock.offset_s == found["cam2"].clock.offset_s == 0.0
    assert found["cam1"].origin is Origin.STATED
    assert found["cam3"].clock.offset_s == pytest.approx(1.3, abs=2 * ALIGNED_S)  # of a noise four times as large


@pytest.mark.parametrize("behind_s", [-3600.0, 18.0, 37.0])
@pytest.mark.parametrize("cameras", [3, 4])
def test_a_clock_far_off_is_found_although_its_box_vouches_for_it(behind_s: float, cameras: int) -> None:
    vouched = {"clock_bound_s": 5e-3}
    found = clocks_of(prepared(site(offsets_s=(0.0,) * cameras, each=vouched), {"cam2": behind_s}))
    assert found["cam2"].origin is Origin.FOUND
    assert found["cam2"].clock.offset_s == pytest.approx(behind_s, abs=ALIGNED_S)
    assert all(own.origin is Origin.STATED for name, own in found.items() if name != "cam2")


@pytest.mark.parametrize("odd", ["cam1", "cam2", "cam3"])
def test_where_nobody_vouches_the_time_of_most_is_the_sites(odd: str) -> None:
    """Whichever of them counts leap seconds, and whatever the paces: these are alike to what a flight tells."""
    found = clocks_of(prepared(site(offsets_s=(0.0,) * 3), {odd: 18.0}))
    expected = {name: 18.0 if name == odd else 0.0 for name in found}
    assert {name: own.clock.offset_s for name, own in found.items()} == pytest.approx(expected, abs=2 * ALIGNED_S)


def test_of_two_boxes_that_contradict_each_other_the_one_of_smaller_bound_is_the_sites() -> None:
    vouched = {"cam1": {"clock_bound_s": 1e-2}, "cam2": {"clock_bound_s": 1e-4}}
    found = clocks_of(prepared(site(offsets_s=(0.0, 0.0), special=vouched), {"cam1": 18.0}))
    assert found["cam2"].clock.offset_s == 0.0
    assert found["cam1"].clock.offset_s == pytest.approx(18.0, abs=ALIGNED_S)


def test_stamps_hours_off_are_moved_and_put_back() -> None:
    timed = on_one_time(prepared(site(offsets_s=(0.0,) * 4), {"cam3": 7200.0}))
    assert timed.moved_s["cam3"] == pytest.approx(7200.0, abs=ALIGNED_S)
    assert abs(timed.clocks["cam3"].offset_s) < ALIGNED_S
    spread = max(own[0].t_s[0] for own in timed.inputs.tracks.values()) - min(
        own[0].t_s[0] for own in timed.inputs.tracks.values()
    )
    assert spread < 1.0


@pytest.mark.parametrize("seed", [5, 10, 12, 33, 34])
def test_a_regular_orbit_says_nothing_of_the_clocks_and_the_stamps_stand(seed: int) -> None:
    angle = [k * pi / 12 for k in range(93)]
    around = tuple((40 * cos(a), 40 * sin(a), 45 + 4 * sin(2 * a)) for a in angle)
    cameras = tuple(
        CameraSpec(id=f"cam{k}", centre_enu=CAMERAS[k], look_at_enu=(0.0, 0.0, 40.0), frame_rate_hz=10.0, noise_px=0.7)
        for k in range(4)
    )
    found = clocks_of(
        prepared(Simulation(seed=seed, object=(ObjectSpec(waypoints_enu=around),), camera=cameras, duration_s=90.0))
    )
    assert {own.origin for own in found.values()} == {Origin.ASSUMED}


@pytest.mark.parametrize(("seed", "number"), [(0, 4), (0, 5), (0, 8), (0, 10), (174, 3), (176, 3), (176, 4)])
def test_where_an_orbit_repeats_itself_and_nothing_fits_better_the_stamps_stand(seed: int, number: int) -> None:
    """Half a metre up and down, and nobody vouches: each pair fits as stamped, and nearly as well some laps later."""
    inputs = prepare(draw("orbit_no_bound", "choose", seed, number).simulated.scene)
    found = clocks_of(inputs)
    assert {own.origin for own in found.values()} <= {Origin.FOUND, Origin.ASSUMED}
    assert max(abs(own.clock.offset_s) for own in found.values()) < 0.1


@pytest.mark.parametrize("number", [0, 1, 6])
def test_of_phones_seconds_apart_in_an_orbit_the_stamps_are_nobodys_word(number: int) -> None:
    inputs = prepare(draw("orbit_phones", "choose", 0, number).simulated.scene)
    assert all(own.origin is not Origin.ASSUMED for own in clocks_of(inputs).values())


def test_a_camera_that_filmed_something_else_has_no_clock_and_is_told_so() -> None:
    inputs = prepared(site(offsets_s=(0.0,) * 4))
    other = prepared(site(offsets_s=(0.0,) * 4, seed=2))
    found = site_clocks({**inputs.tracks, "cam2": other.tracks["cam2"]}, inputs.sites)
    assert found["cam2"].origin is Origin.UNKNOWN
    assert "no offset and no rate" in found["cam2"].tested
    assert all(own.origin is Origin.FOUND for name, own in found.items() if name != "cam2")


@pytest.mark.parametrize(("kind", "seed", "number"), [("healthy_hovering", 6, 2), ("healthy_hovering_whole_px", 11, 0)])
def test_an_object_that_hovers_contradicts_no_clock(kind: str, seed: int, number: int) -> None:
    """A point fits every epipolar geometry for as long as it stands: a clock good to 5 ms was put 62 s off by it."""
    scene = draw(kind, "choose", seed, number).simulated.scene
    found = clocks_of(prepare(scene))
    assert {own.origin for own in found.values()} == {Origin.STATED}

"""The guard: who is knocked is named in seconds, who is not is left alone, and no target estimate is asked."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import calib.guarding.monitor
from calib.guarding.monitor import Guard
from calib.observations import Frame
from tools.doubles.faults import FAULTS, VICTIM, CameraFault, faulty_frames, findings
from tools.doubles.flight import T0_UNIX_NS, Spec, frames, make
from tools.doubles.guard_scenes import EVENT_S as DRAWN_EVENT_S
from tools.doubles.guard_scenes import draw

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=18.0)
EVENT_S = 8.0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_camera_at_fault_is_the_first_to_be_named(fault) -> None:  # type: ignore[no-untyped-def]
    scene = make(SPEC)
    found = findings(scene, faulty_frames(scene, fault, EVENT_S))
    assert found, fault.name
    at_s, first = found[0]
    assert first.camera == "cam2"
    assert EVENT_S < at_s < EVENT_S + 7.5
    assert first.since_unix_ns < T0_UNIX_NS + at_s * 1e9


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_of_three_cameras_none_is_named_and_that_they_disagree_is_said(fault) -> None:  # type: ignore[no-untyped-def]
    scene = make(replace(SPEC, cameras=3))
    found = findings(scene, faulty_frames(scene, fault, EVENT_S))
    at_s, first = found[0]
    assert first.camera is None
    assert first.among == ("cam0", "cam1", "cam2")
    assert first.reason == "these cameras disagree: cam0, cam1, cam2"
    assert EVENT_S < at_s < EVENT_S + 7.5
    assert EVENT_S - 2.0 < (first.since_unix_ns - T0_UNIX_NS) * 1e-9 < at_s


@pytest.mark.parametrize("bound_s", [0.2, 1e6])
@pytest.mark.parametrize("fault", [CameraFault("knocked", turn_deg=1.0), CameraFault("stepped", step_s=0.2)], ids=str)
def test_whatever_it_states_of_its_clock_the_camera_at_fault_is_named_as_soon(
    fault: CameraFault, bound_s: float
) -> None:
    """A stated bound of a second and more had the guard wait for twelve seconds, and then blame all four."""
    scene = make(SPEC)
    found = findings(scene, faulty_frames(scene, fault, EVENT_S), said_s={VICTIM: bound_s})
    at_s, first = found[0]
    assert first.camera == VICTIM
    assert EVENT_S < at_s < EVENT_S + 4.0


@pytest.mark.parametrize("number", range(24, 48))
def test_random_scenes_name_no_innocent_and_cry_no_wolf(number: int) -> None:
    drawn = draw(number)
    for at_s, finding in findings(drawn.scene, drawn.stream(), drawn.bound_s):
        assert drawn.kind not in ("none", "box"), drawn.name
        assert at_s > DRAWN_EVENT_S, drawn.name
        assert finding.camera in ((drawn.victim,) if drawn.scene.spec.cameras > 3 else (None,)), drawn.name


def test_nothing_is_found_where_nothing_happens() -> None:
    scene = make(replace(SPEC, birds=4, dropout=0.2, clutter=1.0))
    assert findings(scene, frames(scene)) == []


@pytest.mark.parametrize(("cameras", "seed"), [(3, 1), (3, 3), (3, 5), (4, 0), (4, 1), (6, 1), (6, 3), (6, 5)])
def test_half_a_second_of_something_else_in_one_camera_is_nothing(cameras: int, seed: int) -> None:
    """A bird takes over a drone's track. It stays in the guard's memory for seconds, and was heard in every round."""
    scene = make(replace(SPEC, cameras=cameras, uavs=1, duration_s=14.0, seed=seed))
    rng = np.random.default_rng(seed)
    away_px, going_px_s, long_s = rng.uniform(-60, 60, 2), rng.uniform(-300, 300, 2), rng.uniform(0.3, 0.7)

    def with_a_bird() -> Iterator[tuple[int, Frame]]:
        for arrival_ns, frame in frames(scene):
            late_s = (arrival_ns - T0_UNIX_NS) * 1e-9 - EVENT_S
            if frame.camera == "cam2" and 0 < late_s < long_s:
                frame = replace(frame, pixels=frame.pixels + away_px + going_px_s * late_s)  # noqa: PLW2901
            yield arrival_ns, frame

    assert findings(scene, with_a_bird(), None) == []


def test_calibration_errors_that_are_declared_are_no_knock() -> None:
    scene = make(replace(SPEC, sigma_attitude_rad=1e-3, seed=5))
    assert findings(scene, frames(scene)) == []


def test_a_frozen_picture_is_noticed_and_a_hovering_drone_is_not() -> None:
    scene = make(replace(SPEC, duration_s=6.0))
    last = {}

    def frozen():  # type: ignore[no-untyped-def]
        for arrival, frame in frames(scene):
            if frame.camera == "cam1" and "cam1" in last:
                frame = replace(frame, pixels=last["cam1"].pixels, label=last["cam1"].label)  # noqa: PLW2901
                frame = replace(frame, sigma_px=last["cam1"].sigma_px)  # noqa: PLW2901
            elif len(frame.pixels):
                last[frame.camera] = frame
            yield arrival, frame

    assert {(f.camera, f.reason) for _, f in findings(scene, frozen())} >= {("cam1", "its picture is frozen")}


def test_the_guard_asks_no_estimate() -> None:
    """It may not even import the tracker's estimates or filters: it guards them."""
    names = set(vars(calib.guarding.monitor))
    assert names.isdisjoint({"Tracker", "Estimate", "FilterBank"})


@pytest.mark.parametrize("right", [True, False])
def test_a_stored_network_is_accepted_only_if_rays_agree(right: bool) -> None:
    scene = make(replace(SPEC, duration_s=8.0))
    other = make(replace(SPEC, seed=9)).network
    guard, verdict = Guard(), None
    network = scene.network if right else other
    for _, frame in frames(scene):
        guard.observe(frame)
        verdict = guard.agrees(network, frame.t_unix_ns) if verdict is None else verdict
    assert verdict is right

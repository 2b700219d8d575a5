"""What changed since an instant, told from what always was: by a fit of all unknowns at once, and by scenes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from calib.guarding.diagnosis import ExpectedErrors, GuardVerdict, judge
from calib.guarding.evidence import FAULT_SIZE, UNKNOWNS
from calib.guarding.memory import Slice
from calib.guarding.sums import DRIFTS_PER_S, JUMPS, Remembered, summed
from calib.network import POSE_SIZE
from calib.observations import Frame
from tests.calib.guarding.slices import SLICE_NS, expected_of, slices_of
from tools.doubles.faults import CameraFault, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Spec, frames, make

SPEC = Spec(cameras=4, uavs=1, rate_hz=15.0, duration_s=10.0, noise_px=0.6, seed=3)
EVENT_S = 6.0
APART_NS = SLICE_NS // 2


def remembered(slices: list[Slice]) -> Remembered:
    found = Remembered(slices, SPEC.cameras)
    list(found.prepare())
    return found


def judged(slices: list[Slice], at_ns: int, expected: ExpectedErrors) -> GuardVerdict:
    after, every = [one for one in slices if one.t_unix_ns > at_ns], remembered(slices)
    return judge(after, every.since(at_ns, APART_NS), expected, every.until(at_ns - APART_NS))


def test_one_stretch_is_the_fit_of_errors_changes_and_offsets_all_at_once() -> None:
    scene = make(SPEC)
    slices = slices_of(scene, frames(scene))[-5:]  # within one stretch
    at_ns = slices[1].t_unix_ns
    sums = remembered(slices).since(at_ns, APART_NS)
    used = [slices[0], *slices[2:]]  # what ended with the change is of both times
    size, count = 4 * FAULT_SIZE, 8
    normal, right = np.zeros((2 * size + 3 * count,) * 2), np.zeros(2 * size + 3 * count)
    for one in used:
        (_, found), *_ = one.objects
        assert found.cameras.tolist() == [0, 1, 2, 3]
        after = float(one.t_unix_ns > at_ns)
        ago_s = (slices[-1].t_unix_ns - one.t_unix_ns) * 1e-9
        kept = np.zeros((4 * UNKNOWNS, 2 * size + 3 * count))  # this slice's unknowns, by those of the fit
        for k in range(4):
            for j in range(FAULT_SIZE):
                kept[k * UNKNOWNS + j, [k * FAULT_SIZE + j, size + k * FAULT_SIZE + j]] = 1.0, after
            for j in range(2):
                column = 2 * size + 2 * k + j
                kept[k * UNKNOWNS + FAULT_SIZE + j, [column, column + count, column + 2 * count]] = (
                    1.0,
                    1.5 - ago_s,
                    after,
                )
        normal += kept.T @ found.normal.reshape(4 * UNKNOWNS, -1) @ kept
        right += kept.T @ found.right.ravel()
    lasting = np.repeat(found.lasting_px, 2)
    prior = np.concatenate([lasting, lasting * DRIFTS_PER_S, lasting * JUMPS]) ** -2.0
    gone = np.arange(2 * size, len(right))
    normal[gone, gone] += prior
    kept_at = np.arange(2 * size)
    solved = np.linalg.solve(normal[np.ix_(gone, gone)], normal[np.ix_(gone, kept_at)])
    left = normal[np.ix_(kept_at, kept_at)] - normal[np.ix_(kept_at, gone)] @ solved
    scale = np.abs(left).max()
    # Two orders of elimination in double precision.
    np.testing.assert_allclose(sums.normal, left[:size, :size], atol=1e-9 * scale)
    np.testing.assert_allclose(sums.cross, left[:size, size:], atol=1e-9 * scale)
    np.testing.assert_allclose(sums.change, left[size:, size:], atol=1e-9 * scale)
    rights = right[kept_at] - solved.T @ right[gone]
    np.testing.assert_allclose(sums.right, rights[:size], atol=1e-9 * np.abs(rights).max())
    np.testing.assert_allclose(sums.right_change, rights[size:], atol=1e-9 * np.abs(rights).max())


def test_before_everything_there_is_no_before() -> None:
    scene = make(SPEC)
    slices = slices_of(scene, frames(scene))
    whole, always = remembered(slices).since(0, APART_NS), summed(slices, 4)
    for name in ("normal", "cross", "change", "right", "right_change"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(always, name))


@pytest.mark.parametrize("seed", range(4))
def test_a_step_of_a_clock_that_states_no_bound_is_told_by_what_was_before(seed: int) -> None:
    """By the rays since alone it may always have been off so much: nobody vouches for it."""
    scene = make(replace(SPEC, seed=seed))
    slices = slices_of(scene, faulty_frames(scene, CameraFault("stepped", step_s=0.08), EVENT_S))
    at_ns = T0_UNIX_NS + round((EVENT_S + 0.5) * 1e9)
    expected = expected_of(scene, None)
    after = [one for one in slices if one.t_unix_ns > at_ns]
    assert not judge(after, summed(after, SPEC.cameras), expected).named
    verdict = judged(slices, at_ns, expected)
    assert verdict.named
    assert verdict.worst.camera == 2
    # What is stamped late was seen earlier; the tolerance is three sigma.
    assert -verdict.worst.step_s == pytest.approx(0.08, abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_calibration_was_always_off_by_is_no_change(seed: int) -> None:
    scene = make(replace(SPEC, seed=seed))
    slices = slices_of(scene, faulty_frames(scene, CameraFault("always", turn_deg=0.5), 0.0))
    expected = expected_of(scene, 0.001)
    half_a_degree = np.diag(np.tile([1e4] * POSE_SIZE + [1e5], SPEC.cameras))
    assert not judged(slices, slices[-7].t_unix_ns, replace(expected, inverse=half_a_degree)).astray


@pytest.mark.parametrize("seed", range(4))
def test_half_a_second_of_something_else_is_no_knock(seed: int) -> None:
    """A bird that takes over a track for half a second: what no turn and no step explains is not put down to one."""
    scene = make(replace(SPEC, seed=seed, noise_px=1.0))
    away = np.random.default_rng(seed)

    def with_a_bird() -> Iterator[tuple[int, Frame]]:
        for arrival_ns, frame in frames(scene):
            if frame.camera == "cam2" and abs((arrival_ns - T0_UNIX_NS) * 1e-9 - EVENT_S - 0.25) < 0.25:
                frame = replace(frame, pixels=frame.pixels + away.uniform(-60, 60, frame.pixels.shape))  # noqa: PLW2901
            yield arrival_ns, frame

    slices = slices_of(scene, with_a_bird())
    for k in range(3, len(slices) - 1):
        for end in range(k + 2, min(k + 5, len(slices)) + 1):
            verdict = judged(slices[:end], slices[k].t_unix_ns, expected_of(scene, None))
            assert not verdict.named, (slices[k].t_unix_ns - T0_UNIX_NS, end - k, verdict)


def test_a_knock_gives_no_speed_to_what_the_knocked_camera_sees() -> None:
    """A camera's rows jump when it is knocked; taken for movement, the jump looks like a clock that has stepped."""
    scene = make(replace(SPEC, duration_s=8.0))
    slices = slices_of(scene, faulty_frames(scene, CameraFault("turned", turn_deg=1.0), EVENT_S))
    quiet = slices_of(scene, frames(scene))
    for one, other in zip(slices, quiet, strict=True):
        for (_, found), (_, honest) in zip(one.objects, other.objects, strict=True):
            # 1 degree is 23 px; five instants within half a second tell a speed to some px / s.
            np.testing.assert_allclose(found.speed_px_s, honest.speed_px_s, atol=12.0)

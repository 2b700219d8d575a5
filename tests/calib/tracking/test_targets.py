"""Targets from single rays: where they are, how sure that is, and what must never be one."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib.observations import Frame
from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.targets import Tracker
from tools.doubles.faults import VICTIM, CameraFault, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=6.0)


def track(scene: Scene, stream: Iterator[tuple[int, Frame]] | None = None) -> tuple[Tracker, list[TargetEstimate]]:
    """A tracker fed with a scene, and all it said on the way."""
    tracker, said = Tracker(scene.network), []
    for _, frame in stream or frames(scene):
        moved = tracker.observe(frame)
        said += tracker.advance(tracker.newest_s)
        said += tracker.estimates(tracker.newest_s, set(moved))
    return tracker, said


def at(estimate: TargetEstimate, t_unix_ns: int) -> np.ndarray:
    """(3,) an estimate's position moved on, or back, to an instant near its own."""
    return estimate.position_enu + estimate.velocity_enu * (t_unix_ns - estimate.t_unix_ns) * 1e-9


def error_m(scene: Scene, estimate: TargetEstimate) -> float:
    return float(np.linalg.norm(scene.positions(estimate.t_unix_ns) - estimate.position_enu, axis=1).min())


def test_two_objects_are_two_targets_within_a_second_and_stay_them() -> None:
    scene = make(SPEC)
    tracker, said = track(scene)
    assert {e.track for e in said} == {1, 2}
    assert said[0].t_unix_ns < T0_UNIX_NS + 1.5e9
    assert max(error_m(scene, e) for e in said) < 0.5
    assert (tracker.confirmed, tracker.tentative) == (2, 0)


def test_errors_that_all_rays_share_do_not_average_away() -> None:
    """A thousand rays of cameras that are all 0.1 degrees unsure leave the target as unsure as one ray of each."""
    sure = make(replace(SPEC, sigma_attitude_rad=0.0, sigma_centre_m=0.0))
    unsure = make(replace(SPEC, sigma_attitude_rad=np.radians(0.1), sigma_centre_m=0.0))
    last = [track(scene)[1][-1] for scene in (sure, unsure)]
    small, large = (float(np.sqrt(np.trace(e.covariance[:3, :3]))) for e in last)
    # One ray is wrong by 0.1 degrees at 120 m: 0.21 m an axis; four cameras share half of the error.
    assert small < 0.1  # a second of four cameras at 15 Hz, 0.09 m a ray, in three axes
    assert 0.12 < large < 0.4


def test_the_covariance_is_true_over_many_networks() -> None:
    """Each seed draws another calibration error from the network's covariance: nothing may be overconfident."""
    errors = []
    for seed in range(12):
        scene = make(replace(SPEC, seed=seed, duration_s=4.0, sigma_attitude_rad=1e-3))
        _, said = track(scene)
        e = said[-1]
        error = scene.positions(e.t_unix_ns) - e.position_enu
        error = error[np.linalg.norm(error, axis=1).argmin()]
        errors.append(error @ np.linalg.solve(e.covariance[:3, :3], error))
    # 12 scenes, 3 degrees of freedom each: the mean stays below its 99.9 % bound; caution is no fault, and seen below.
    assert np.mean(errors) < chi2.ppf(0.999, 36) / 12
    assert np.mean(errors) > 0.5


def test_out_of_sequence_measurements_count_where_they_belong() -> None:
    """The same frames in another order within the horizon give the same targets, to a fraction of their sigma.

    Which of the two got which number is no matter: it hangs on which was initiated first.
    """
    scene = make(SPEC)
    stream = list(frames(scene))
    late = sorted(stream, key=lambda item: item[0] + (300_000_000 if item[1].camera == "cam2" else 0))
    in_order, shuffled = (track(scene, iter(s))[0].estimates(5.8) for s in (stream, late))
    assert len(in_order) == len(shuffled) == 2
    beside = [min(shuffled, key=lambda b: float(np.linalg.norm(b.position_enu - at(a, b.t_unix_ns)))) for a in in_order]
    assert beside[0].track != beside[1].track
    for a, b in zip(in_order, beside, strict=True):
        assert np.all(np.abs(at(a, b.t_unix_ns) - b.position_enu) < 2 * np.sqrt(np.diag(a.covariance)[:3]))


@pytest.mark.parametrize("after_s", [-0.02, 0.0, 0.05])
def test_a_prediction_is_of_the_instant_asked_for_also_where_a_frame_is_stamped_after_it(after_s: float) -> None:
    """At some 5 m/s, 20 ms are a sigma: a position of another instant than the one it is sent under is wrong."""
    scene = make(SPEC)
    tracker, _ = track(scene)
    now_s = tracker.newest_s + after_s
    for e in tracker.predicted(now_s):
        assert abs(e.t_unix_ns - T0_UNIX_NS - now_s * 1e9) < 1000
        (last,) = (own for own in tracker.estimates(tracker.newest_s) if own.track == e.track)
        # Within the 0.1 s at most between the two, an acceleration of 4 m/s^2 moves it by 2 cm off its tangent.
        np.testing.assert_allclose(e.position_enu, at(last, e.t_unix_ns), atol=0.02)
        # Ahead it grows; a little back, where position and velocity err together, it need not.
        assert after_s < 0 or np.trace(e.covariance) >= np.trace(last.covariance)


def test_rays_later_than_the_horizon_move_nothing() -> None:
    scene = make(SPEC)
    tracker, _ = track(scene)
    before = tracker.estimates(6.0)
    frame = replace(next(frames(scene))[1], t_unix_ns=T0_UNIX_NS + 10**9)
    assert tracker.observe(frame) == []
    assert tracker.counters["late"] == 1
    np.testing.assert_array_equal(before[0].position_enu, tracker.estimates(6.0)[0].position_enu)


@pytest.mark.parametrize("ahead_s", [0.3, 0.6, 1.0, 1.9])
@pytest.mark.parametrize("sees", [True, False])
def test_one_camera_ahead_of_the_others_does_not_make_them_late(ahead_s: float, sees: bool) -> None:
    """Not even one that sees nothing: every position stopped, of cameras that nothing was wrong with."""
    scene = make(SPEC)
    tracker, said = Tracker(scene.network), []
    for _, honest in frames(scene):
        frame = honest
        if frame.camera == "cam0":
            seen = frame if sees else blinded(frame)
            frame = replace(seen, t_unix_ns=frame.t_unix_ns + round(ahead_s * 1e9))
        moved = tracker.observe(frame)
        said += tracker.advance(tracker.newest_s)
        said += tracker.estimates(tracker.newest_s, set(moved))
    assert tracker.counters["late"] == 0
    later = [e for e in said if e.t_unix_ns > T0_UNIX_NS + 2e9]
    # Three cameras at 15 Hz, 4 s, 2 objects, one update a frame.
    assert len(later) > 200
    if not sees:
        assert max(error_m(scene, e) for e in later) < 0.5


def blinded(frame: Frame) -> Frame:
    """The frame of a camera that sees nothing."""
    none = np.zeros(0)
    return replace(frame, pixels=np.zeros((0, 2)), label=np.zeros(0, np.int64), sigma_px=none, width_px=none)


def test_cameras_whose_pictures_come_late_are_used_with_one_whose_do_not() -> None:
    """Two streams through a recorder, 0.8 s late, and one camera at the base: the majority's pace is the site's."""
    scene = make(SPEC)
    stream = sorted(frames(scene), key=lambda item: item[0] + (0 if item[1].camera == "cam0" else 800_000_000))
    tracker, said = track(scene, iter(stream))
    # Until the others have spoken for the first time, the prompt one's pace is all there is: 0.3 s of three at 15 Hz.
    assert tracker.counters["late"] <= 15
    assert {e.track for e in said} == {1, 2}
    assert any("cam0" in e.cameras for e in said)


def test_identity_survives_a_gap_of_two_seconds() -> None:
    scene = make(replace(SPEC, duration_s=9.0))
    blind = ((a, f) for a, f in frames(scene) if not 3e9 < f.t_unix_ns - T0_UNIX_NS < 5e9)
    _, said = track(scene, blind)
    assert {e.track for e in said} == {1, 2}


def test_a_target_nobody_sees_coasts_grows_unsure_and_is_lost_once() -> None:
    scene = make(SPEC)
    tracker, _ = track(scene)
    states, sigmas, lost = [], [], []
    for t_s in np.arange(6.0, 10.0, 0.2):
        lost += tracker.advance(float(t_s))
        for e in tracker.estimates(float(t_s))[:1]:
            states.append(e.state)
            sigmas.append(float(np.trace(e.covariance[:3, :3])))
    assert states[0] is TargetState.CONFIRMED
    assert states[-1] is TargetState.COASTING
    assert sigmas[-1] > 10 * sigmas[0]
    assert [e.state for e in lost] == [TargetState.LOST] * 2
    assert tracker.confirmed == 0


def test_one_camera_alone_never_makes_a_target() -> None:
    scene = make(SPEC)
    assert track(scene, (item for item in frames(scene) if item[1].camera == "cam0"))[1] == []


def test_clutter_never_makes_a_target() -> None:
    scene = make(replace(SPEC, uavs=0, clutter=5.0, duration_s=10.0))
    assert track(scene)[1] == []


def test_a_ghost_of_two_objects_is_refused_by_the_third_camera() -> None:
    """Two cameras see one object each; where their rays meet for a while, cam2 and cam3 see nothing."""
    scene = make(replace(SPEC, uavs=1, duration_s=5.0))

    def ghosts() -> Iterator[tuple[int, Frame]]:
        for arrival, frame in frames(scene):
            nothing = replace(frame, pixels=frame.pixels[:0], label=frame.label[:0], sigma_px=frame.sigma_px[:0])
            yield arrival, frame if frame.camera in {"cam0", "cam1"} else nothing

    assert track(scene, ghosts())[1] == []


def test_two_cameras_are_enough_where_no_third_could_see() -> None:
    scene = make(replace(SPEC, duration_s=5.0))
    _, said = track(scene, (item for item in frames(scene) if item[1].camera in {"cam0", "cam1"}))
    assert {e.track for e in said} == {1, 2}


def test_a_new_network_moves_targets_with_it_and_loses_none() -> None:
    """Half-way the calibration is replaced by a better one: no target is lost, and all are nearer the truth."""
    scene = make(replace(SPEC, sigma_attitude_rad=2e-3, duration_s=6.0, seed=3))
    true = replace(scene.network, cameras=scene.truth, covariance=scene.network.covariance * 1e-6)
    tracker = Tracker(scene.network)
    before: list[TargetEstimate] = []
    for _, frame in frames(scene):
        if not before and frame.t_unix_ns > T0_UNIX_NS + 3e9:
            before = tracker.estimates(tracker.newest_s)
            tracker.exchange(true)
            after = tracker.estimates(tracker.newest_s)
        tracker.observe(frame)
        tracker.advance(tracker.newest_s)
    assert [e.track for e in after] == [e.track for e in before] == [1, 2]
    assert np.mean([error_m(scene, e) for e in after]) < np.mean([error_m(scene, e) for e in before])
    assert [e.track for e in tracker.estimates(tracker.newest_s)] == [1, 2]
    assert all(
        np.trace(a.covariance[:3, :3]) < np.trace(b.covariance[:3, :3]) for a, b in zip(after, before, strict=True)
    )


def test_a_network_with_another_epoch_and_one_camera_less_keeps_targets() -> None:
    scene = make(SPEC)
    tracker, _ = track(scene)
    before = tracker.estimates(tracker.newest_s)
    size = 18
    network = replace(
        scene.network,
        cameras=scene.network.cameras[:3],
        covariance=scene.network.covariance[:size, :size],
        t_mid_unix_ns=T0_UNIX_NS + 5 * 10**9,
    )
    tracker.exchange(network)
    after = tracker.estimates(tracker.newest_s)
    for a, b in zip(after, before, strict=True):
        assert abs(a.t_unix_ns - b.t_unix_ns) < 1000
        np.testing.assert_allclose(a.position_enu, b.position_enu, atol=1e-6)


def test_the_same_frames_give_the_same_bytes() -> None:
    scene = make(SPEC)
    one, other = (track(scene)[1] for _ in range(2))
    assert [e.position_enu.tobytes() for e in one] == [e.position_enu.tobytes() for e in other]


def test_a_camera_that_misled_widens_its_targets_at_once_and_the_others_bring_them_back() -> None:
    scene = make(replace(SPEC, duration_s=8.0))
    tracker, misled_m, after = Tracker(scene.network), 0.0, []
    for arrival_ns, frame in faulty_frames(scene, CameraFault("turned", turn_deg=0.15), 5.0):
        at_s = (arrival_ns - T0_UNIX_NS) * 1e-9
        if frame.camera == VICTIM and at_s > 6.5:
            if not misled_m:
                misled_m = max(error_m(scene, e) for e in tracker.estimates(tracker.newest_s))
                assert tracker.distrust(VICTIM, np.radians(0.15)) == [], "the others hold both"
                for e in tracker.estimates(tracker.newest_s):
                    assert VICTIM not in e.cameras
                    # What the camera was off at its distance, 0.3 m at 120 m, is in sigma now.
                    assert error_m(scene, e) < 4 * np.sqrt(np.trace(e.covariance[:3, :3]))
            continue
        tracker.observe(frame)
        tracker.advance(tracker.newest_s)
        if at_s > 7.5:
            after += tracker.estimates(tracker.newest_s)
    assert misled_m > 0.15, "else nothing was on trial: six centimetres are usual"
    assert max(error_m(scene, e) for e in after) < 0.3


def test_targets_that_hung_on_a_camera_and_one_other_end_with_it() -> None:
    scene = make(replace(SPEC, uavs=1, duration_s=4.0))
    stream = ((at, frame) for at, frame in frames(scene) if frame.camera in ("cam1", VICTIM))
    tracker, _ = track(scene, stream)
    held = tracker.confirmed
    ended = tracker.distrust(VICTIM, 0.01)
    assert [e.state for e in ended] == [TargetState.LOST] * held
    assert tracker.confirmed == 0


def test_all_targets_end_where_nothing_is_believed() -> None:
    tracker, _ = track(make(SPEC))
    assert [(e.track, e.state) for e in tracker.dismiss()] == [(1, TargetState.LOST), (2, TargetState.LOST)]
    assert (tracker.confirmed, tracker.tentative, tracker.next_track) == (0, 0, 3)

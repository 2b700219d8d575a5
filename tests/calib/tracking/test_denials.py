"""Two rays are two rays: what one camera invents about the range of an object is marked, or ends.

The kind: an object that one honest camera sees, cam1; the liar, cam0, says where along that ray it is; what the others
do not see lies in their pictures, or not. Beside it an object flies that all see, and which must not suffer.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib.observations import Frame
from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.targets import Tracker
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make

NS = 10**9
BEGINS_S = 6.0  # of the lie: all cameras know their pictures by then
LASTS_S = 8.0  # of the lie: a target that one camera denies is confirmed after five seconds
SPEC = Spec(uavs=2, rate_hz=10.0, duration_s=BEGINS_S + LASTS_S)

Seen = Callable[[Frame, float], Frame]


def told(scene: Scene, seen: Seen) -> list[TargetEstimate]:
    """All that a tracker says of a scene as it is seen, the final states last."""
    tracker, said = Tracker(scene.network), []
    for _, frame in frames(scene):
        moved = tracker.observe(seen(frame, (frame.t_unix_ns - T0_UNIX_NS) / NS))
        said += tracker.advance(tracker.newest_s)
        said += tracker.estimates(tracker.newest_s, set(moved))
    return said + tracker.estimates(tracker.newest_s)


def without(scene: Scene, frame: Frame, number: int) -> Frame:
    """A frame that lacks one object."""
    camera = next(c for c in scene.truth if c.id == frame.camera)
    there = camera.project(scene.positions(frame.t_unix_ns)[number : number + 1])
    kept = np.linalg.norm(frame.pixels - there, axis=1) > 6.0  # px: noise is one
    width = None if frame.width_px is None else frame.width_px[kept]
    return replace(
        frame, pixels=frame.pixels[kept], label=frame.label[kept], sigma_px=frame.sigma_px[kept], width_px=width
    )


def ghost(scene: Scene, factor: float, witnesses: tuple[str, ...] = ()) -> Seen:
    """Object 0 is seen by cam1 alone, and cam0 says that it is `factor` times as far. witnesses: see nothing at all."""
    one, liar = scene.truth[1], scene.truth[0]

    def seen(frame: Frame, t_s: float) -> Frame:
        if t_s < BEGINS_S or frame.camera == "cam1":
            return frame
        rest = without(scene, frame, 0)
        if frame.camera in witnesses:
            return replace(
                rest, pixels=rest.pixels[:0], label=rest.label[:0], sigma_px=rest.sigma_px[:0], width_px=None
            )
        if frame.camera != "cam0":
            return rest
        away = scene.positions(frame.t_unix_ns)[0] - one.centre_enu
        pixel = liar.project(one.centre_enu + factor * away[None])
        if not (np.isfinite(pixel).all() and (pixel >= 0).all() and (pixel < liar.lens.size_px).all()):
            return rest
        return replace(
            rest,
            pixels=np.vstack([rest.pixels, pixel]),
            label=np.append(rest.label, 77),
            sigma_px=np.append(rest.sigma_px, 1.0),
            width_px=None,
        )

    return seen


def beyond(scene: Scene, estimate: TargetEstimate) -> bool:
    """Whether it is outside of what it claims of every true object."""
    off = scene.positions(estimate.t_unix_ns) - estimate.position_enu
    inverse = np.linalg.inv(estimate.covariance[:3, :3])
    return float(np.einsum("ni,ij,nj->n", off, inverse, off).min()) > 16.3  # 99.9 %, 3 degrees of freedom


@pytest.mark.parametrize(
    ("cameras", "factor", "seed"), [(3, 0.6, 1), (3, 1.4, 2), (4, 1.4, 3), (4, 1.8, 4), (6, 0.6, 5)]
)
def test_an_invented_range_is_never_said_as_whole(cameras: int, factor: float, seed: int) -> None:
    """With three cameras it is marked; with more, those who should see it and do not keep it from being a target."""
    scene = make(replace(SPEC, cameras=cameras, seed=seed))
    said = told(scene, ghost(scene, factor))
    late = [e for e in said if e.state is TargetState.CONFIRMED and e.t_unix_ns > T0_UNIX_NS + (BEGINS_S + 2) * NS]
    whole = [e for e in late if len(e.cameras) >= 3]
    assert not any(beyond(scene, e) for e in whole)
    assert len(whole) > 100, "the other object goes on"
    if cameras > 3:
        assert not any(beyond(scene, e) for e in late)


def test_where_the_third_camera_sees_something_else_it_is_named() -> None:
    scene = make(replace(SPEC, cameras=3, seed=2))
    seen = ghost(scene, 1.0)  # where it truly is: cam2 knows that part of its picture
    late = [e for e in told(scene, seen) if e.t_unix_ns > T0_UNIX_NS + (BEGINS_S + 3) * NS and len(e.cameras) == 2]
    denied = [e.denied_by for e in late if e.denied_by]
    assert set(denied) == {("cam2",)}
    assert len(denied) > len(late) / 2, "some of its picture it does not know yet"


def test_two_that_speak_against_two_end_it() -> None:
    """An object that all saw, and then two alone report: of two and two, either may be the liars."""
    scene = make(replace(SPEC, cameras=4, seed=8))  # whose objects fly where all have seen them before
    said = told(scene, ghost(scene, 1.0))
    assert not [e for e in said if len(e.cameras) == 2 and e.t_unix_ns > T0_UNIX_NS + (BEGINS_S + 4) * NS]
    assert [e for e in said if e.state is TargetState.LOST]


@pytest.mark.parametrize("cameras", [3, 4])
def test_cameras_that_see_nothing_at_all_speak_against_nothing(cameras: int) -> None:
    """A dead detector, fog, the sun: what two honest cameras go on seeing does not vanish for it."""
    scene = make(replace(SPEC, cameras=cameras, seed=5))
    said = told(scene, ghost(scene, 1.0, tuple(f"cam{k}" for k in range(2, cameras))))
    last = [e for e in said if e.t_unix_ns > T0_UNIX_NS + (BEGINS_S + LASTS_S - 0.5) * NS]
    assert {e.track for e in last} == {1, 2}
    assert not any(e.denied_by for e in last)


def test_where_a_camera_has_never_seen_anything_it_does_not_speak() -> None:
    """A mask, a tree, a hill: the base knows of none, but that nothing was ever seen there."""
    scene = make(replace(SPEC, cameras=4, seed=6))
    middle = scene.truth[2].lens.size_px[0] / 2

    def seen(frame: Frame, t_s: float) -> Frame:
        if frame.camera not in ("cam2", "cam3"):
            return frame
        kept = frame.pixels[:, 0] < middle
        return replace(
            frame, pixels=frame.pixels[kept], label=frame.label[kept], sigma_px=frame.sigma_px[kept], width_px=None
        )

    said = told(scene, seen)
    assert not [e for e in said if e.state is TargetState.LOST]
    assert len([e for e in said if e.denied_by]) < 0.02 * len(said), "at the mask's very edge only"


@pytest.mark.parametrize("seed", range(3))
def test_healthy_objects_are_denied_by_nobody(seed: int) -> None:
    """Detectors miss a fifth of what they see, and see what is not there."""
    scene = make(replace(SPEC, cameras=3 + seed % 3, uavs=3, dropout=0.2, clutter=0.5, seed=seed))
    tracker = Tracker(scene.network)
    for _, frame in frames(scene):
        tracker.observe(frame)
        tracker.advance(tracker.newest_s)
        assert tracker.refused().contested is None
    assert tracker.counters["outvoted"] == 0

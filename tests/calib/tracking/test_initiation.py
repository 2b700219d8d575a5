"""Track initiation: two cameras that agree begin a track, what a third contradicts comes last, one ray serves once."""

import numpy as np

from calib.tracking.initiation import initiate
from calib.tracking.options import Limits, TrackerOptions
from calib.tracking.searches import STRAIGHT
from calib.tracking.tracklets import LooseRay, NewTrack, tracklets
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=0.6, sigma_attitude_rad=1e-4, sigma_centre_m=0.0)
LIMITS = Limits()


def loose(scene: Scene, cameras: set[int]) -> list[LooseRay]:
    """Every detection of some cameras: nothing has been associated yet."""
    rays = []
    for _, frame in frames(scene):
        camera = int(frame.camera.removeprefix("cam"))
        if camera in cameras:
            t_s = (frame.t_unix_ns - T0_UNIX_NS) * 1e-9
            for label, (u, v) in zip(frame.label.tolist(), frame.pixels.tolist(), strict=True):
                rays.append(LooseRay(camera, label, t_s, u, v, SPEC.noise_px))
    return rays


def initiated(scene: Scene, cameras: set[int], limits: Limits = LIMITS) -> list[NewTrack]:
    found = tracklets(loose(scene, cameras), scene.network, STRAIGHT, SPEC.duration_s)
    return initiate(found, scene.network, TrackerOptions(limits=limits), STRAIGHT, SPEC.duration_s)


def test_each_object_begins_one_track_where_it_is_with_every_camera_that_saw_it() -> None:
    scene = make(SPEC)
    tracks = initiated(scene, {0, 1, 2, 3})
    assert len(tracks) == 2
    for track in tracks:
        error = scene.positions(T0_UNIX_NS + round(track.t_s * 1e9)) - track.state[:3]
        error = error[np.linalg.norm(error, axis=1).argmin()]
        # Three degrees of freedom: 22 is exceeded once in 10 000 draws.
        assert error @ np.linalg.solve(track.covariance[:3, :3], error) < 22.0
        assert len({camera for camera, _ in track.seen_by}) == len(track.seen_by) == 4


def test_a_track_of_a_camera_serves_one_new_target_only() -> None:
    tracks = initiated(make(SPEC), {0, 1})
    used = [member for track in tracks for member in track.seen_by]
    assert len(used) == len(set(used))


def test_one_camera_alone_initiates_nothing() -> None:
    assert initiated(make(SPEC), {2}) == []


def test_what_lies_beyond_the_limits_is_no_target() -> None:
    scene = make(SPEC)
    assert initiated(scene, {0, 1, 2, 3}, Limits(max_range_m=20.0)) == []
    assert initiated(scene, {0, 1, 2, 3}, Limits(max_speed_m_s=0.01)) == []

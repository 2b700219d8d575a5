"""Where raw tracks of two cameras meet: the right partners, and none for a camera that was knocked."""

from dataclasses import replace

import numpy as np

from calib.guarding.meetings import median_low, meetings
from calib.guarding.raytracks import RayTracks
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make, perturbed

SPEC = Spec(cameras=3, uavs=3, rate_hz=15.0, duration_s=1.0, noise_px=0.5, sigma_attitude_rad=1e-5, sigma_centre_m=0.0)


def seen(scene: Scene) -> RayTracks:
    tracks = RayTracks()
    for _, frame in frames(scene):
        tracks.add(frame)
    return tracks


def test_tracks_meet_where_the_objects_are() -> None:
    scene = make(SPEC)
    met, possible = meetings(scene.network, ("cam0", "cam1"), seen(scene), T0_UNIX_NS)
    assert possible
    assert met is not None
    assert len(met.points) == 3
    for times, points in zip(met.t_s, met.points, strict=True):
        truth = np.array([scene.positions(T0_UNIX_NS + round(t * 1e9)) for t in times.tolist()])
        off = np.linalg.norm(truth - points[:, None], axis=2)
        # Half a pixel at 120 m and f = 1300 is 5 cm across; a wrong partner is off by metres.
        assert np.median(off, axis=0).min() < 0.5
    assert len({tuple(np.round(points[0], 3)) for points in met.points}) == 3, "each track has one partner"


def test_a_camera_that_is_turned_by_a_degree_meets_nobody_but_could_have() -> None:
    scene = make(replace(SPEC, uavs=1))
    cameras = (perturbed(scene.network.cameras[0], np.r_[np.radians([1.0, 0, 0]), 0, 0, 0]), *scene.network.cameras[1:])
    met, possible = meetings(replace(scene.network, cameras=cameras), ("cam0", "cam1"), seen(scene), T0_UNIX_NS)
    assert met is None
    assert possible


def test_the_lower_median_leaves_out_what_is_missing() -> None:
    values = np.array([[3.0, 1.0, np.nan, 2.0], [np.nan] * 4, [4.0, 1.0, np.nan, np.nan]])
    np.testing.assert_array_equal(median_low(values), [2.0, np.nan, 1.0])

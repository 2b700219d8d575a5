"""Scenes of benches and tests: the network that is handed out is as wrong as it says, and nothing else differs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calib.network import POSE_SIZE, Camera
from tools.doubles.faults import KNOCKED, VICTIM, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Spec, frames, make

SPEC = Spec(cameras=3, uavs=1, birds=1, rate_hz=10.0, duration_s=4.0)


def error(estimated: Camera, true: Camera) -> np.ndarray:
    """(6,) by which an estimated pose is off: a rotation vector in the camera frame, and metres."""
    turn = Rotation.from_matrix(estimated.R_cam_enu @ true.R_cam_enu.T).as_rotvec()
    return np.concatenate([turn, estimated.centre_enu - true.centre_enu])


def test_the_network_is_as_wrong_as_its_covariance_says() -> None:
    scenes = [make(replace(SPEC, duration_s=1.0, seed=seed)) for seed in range(40)]
    distances2 = []
    for scene in scenes:
        off = np.concatenate([error(e, t) for e, t in zip(scene.network.cameras, scene.truth, strict=True)])
        distances2.append(off @ np.linalg.solve(scene.network.covariance, off))
    freedom = 40 * 3 * POSE_SIZE
    # 99.9 % of true covariances lie between: neither too sure nor too careful.
    assert chi2.ppf(0.0005, freedom) < sum(distances2) < chi2.ppf(0.9995, freedom)


def test_a_spec_is_a_scene() -> None:
    one, again = make(SPEC), make(SPEC)
    for (arrival_ns, frame), (other_ns, other) in zip(frames(one), frames(again), strict=True):
        assert (arrival_ns, frame.camera, frame.t_unix_ns) == (other_ns, other.camera, other.t_unix_ns)
        assert np.array_equal(frame.pixels, other.pixels)
        assert np.array_equal(frame.label, other.label)
    assert np.array_equal(one.network.cameras[0].R_cam_enu, again.network.cameras[0].R_cam_enu)


def test_every_camera_sends_every_frame_in_the_order_of_arrival() -> None:
    sent = list(frames(make(replace(SPEC, uavs=0, birds=0))))
    assert len(sent) == 3 * 40
    assert [arrival_ns for arrival_ns, _ in sent] == sorted(arrival_ns for arrival_ns, _ in sent)
    assert all(0.02 <= (arrival_ns - frame.t_unix_ns) * 1e-9 <= 0.06 for arrival_ns, frame in sent)


def test_what_is_seen_is_where_the_truth_is() -> None:
    scene = make(replace(SPEC, noise_px=0.5, birds=0))
    true = {camera.id: camera for camera in scene.truth}
    off = np.concatenate(
        [frame.pixels - true[frame.camera].project(scene.positions(frame.t_unix_ns)) for _, frame in frames(scene)
         if len(frame.pixels)]
    )  # fmt: skip
    assert len(off) > 60
    # A standard deviation of N draws is off by 1 / sqrt(2 N) of itself; four of those.
    assert np.std(off) == pytest.approx(0.5, rel=4 / np.sqrt(2 * off.size))


def test_a_knock_changes_the_knocked_camera_from_then_on_and_no_error_of_anybody() -> None:
    scene, event_s = make(SPEC), 2.0
    changed = 0
    for (_, frame), (_, other) in zip(frames(scene), faulty_frames(scene, KNOCKED, event_s), strict=True):
        if frame.camera != VICTIM or frame.t_unix_ns < T0_UNIX_NS + 1.9e9:
            np.testing.assert_allclose(frame.pixels, other.pixels, atol=1e-9)  # summed in another order
        elif len(frame.pixels) and frame.pixels.shape == other.pixels.shape:
            # 0.3 degrees of a lens of 1300 px are 6.8 px in its middle, and a little else towards its edge.
            changed += np.linalg.norm(frame.pixels - other.pixels, axis=1).max() > 4.0
    assert changed >= 15  # of 20 frames; the object may leave the image

"""Normal equations of a slice: the objects' places are free, noise is what is left, a turn pulls as it should."""

from dataclasses import replace

import numpy as np
import pytest

from calib.guarding.evidence import evidence
from calib.guarding.raytracks import RayTracks
from calib.network import Camera
from tests.calib.guarding.slices import looks_of, objects_of, slices_of
from tools.doubles.flight import Scene, Spec, frames, make, perturbed

EXACT = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=2.0, noise_px=0.3, sigma_attitude_rad=1e-7, sigma_centre_m=0.0)


def scene_seen_with(camera: Camera) -> Scene:
    """The exact scene, its third camera believed to stand otherwise."""
    scene = make(EXACT)
    cameras = (*scene.network.cameras[:2], camera, *scene.network.cameras[3:])
    return replace(scene, network=replace(scene.network, cameras=cameras))


def test_what_is_left_over_is_noise() -> None:
    scene = make(replace(EXACT, duration_s=20.0, noise_px=1.0))
    found = [one for part in slices_of(scene, frames(scene)) for _, one in part.objects]
    ratio = sum(one.squares for one in found) / sum(one.freedom for one in found)
    # A pixel between two rows has less noise than a row, and rows far from the middle count less: somewhat under one.
    assert 0.4 < ratio < 1.2
    assert np.median([one.spread_px2 for one in found]) < 0.2


@pytest.mark.parametrize("axis", [0, 1])
def test_a_turned_camera_alone_is_pulled_back_by_as_much(axis: int) -> None:
    turn = np.zeros(6)
    turn[axis] = 2e-3
    scene = scene_seen_with(perturbed(make(EXACT).network.cameras[2], turn))
    tracks = RayTracks()
    for _, frame in frames(scene):
        tracks.add(frame)
    looks = looks_of(scene, tracks, min(tracks.newest_ns.values()))
    found = [evidence(looks, seen) for seen in objects_of(looks)]
    pulled = 0
    for one in found:
        if 2 in one.cameras:
            at = one.cameras.tolist().index(2)
            value = np.linalg.solve(one.normal[at, :3, at, :3] + np.eye(3), one.right[at, :3])
            # The others' points give way a little, and there is a third of a pixel of noise in a few rays.
            assert value[axis] == pytest.approx(-2e-3, abs=6e-4)
            pulled += 1
    assert pulled


def test_points_are_free() -> None:
    """Moving every point with every camera's centre changes nothing: that change has no weight."""
    scene = make(EXACT)
    for part in slices_of(scene, frames(scene)):
        for _, one in part.objects:
            shift = np.zeros(one.right.shape)
            shift[:, 3:6] = (0.3, -0.2, 0.1)
            weight = np.einsum("ca,cadb,db->", shift, one.normal, shift)
            alone = sum(shift[k] @ one.normal[k, :, k] @ shift[k] for k in range(len(shift)))
            # Double precision, and the loose prior of the points.
            assert abs(weight) < 1e-5 * alone

"""Normal equations of a slice: the objects' places are free, noise is what is left, a turn pulls as it should."""

from dataclasses import replace

import numpy as np
import pytest

from calib.guarding.evidence import evidence, without_camera
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


@pytest.mark.parametrize("gone", [0, 2])
@pytest.mark.parametrize("turned_rad", [0.0, 1e-3, 5e-3])
def test_without_a_camera_it_is_as_if_that_had_seen_nothing(gone: int, turned_rad: float) -> None:
    """Whatever the camera is off by: one that is turned leaves no trace in what the others say of each other."""
    base = make(EXACT)
    turn = np.array([turned_rad, turned_rad / 2, 0.0, 0.0, 0.0, 0.0])
    cameras = [perturbed(one, turn) if k == gone else one for k, one in enumerate(base.network.cameras)]
    scene = replace(base, network=replace(base.network, cameras=tuple(cameras)))
    tracks, others = RayTracks(), RayTracks()
    for _, frame in frames(scene):
        tracks.add(frame)
        if frame.camera != f"cam{gone}":
            others.add(frame)
    end_ns = min(tracks.newest_ns.values())
    seen = next(one for one in objects_of(looks_of(base, tracks, end_ns)) if len(one.members) == 4)
    rest = [(member, agree) for member, agree in zip(seen.members, seen.agree, strict=True) if member[0] != gone]
    alone = replace(seen, members=tuple(m for m, _ in rest), agree=tuple(a for _, a in rest))
    whole, truth = evidence(looks_of(scene, tracks, end_ns), seen), evidence(looks_of(scene, others, end_ns), alone)
    left = without_camera(whole, gone)
    assert left is not None
    assert left.cameras.tolist() == [k for k in range(4) if k != gone]
    assert left.squares < 1.5 * left.freedom
    if turned_rad < 2e-3:  # beyond, an instant that deviates counts less in the whole already
        assert np.linalg.norm(left.normal - truth.normal) < 0.05 * np.linalg.norm(truth.normal)
    assert without_camera(left, gone) is left
    two = without_camera(left, left.cameras[0])
    assert two is not None
    assert without_camera(two, two.cameras[0]) is None

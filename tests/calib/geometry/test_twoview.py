"""Two cameras: what is projected is triangulated, what is seen gives the pose, noise and clutter notwithstanding."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geometry.rotation import rotation
from calib.geometry.twoview import (
    decompose,
    essential_by_svd,
    essential_robust,
    relative_poses,
    reprojection,
    triangulate,
)

POINTS = np.random.default_rng(7).uniform([-20, -15, 30], [20, 15, 90], (120, 3))
R = rotation([0.1, -0.7, 0.05])
CENTRE = np.array([40.0, 3.0, 12.0])

angles = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
places = st.tuples(st.floats(5, 60), st.floats(-10, 10), st.floats(-10, 10))


def rays_of(points: np.ndarray, R: np.ndarray, centre: np.ndarray) -> np.ndarray:
    in_camera = (points - centre) @ R.T
    return in_camera[:, :2] / in_camera[:, 2:]


def seen() -> tuple[np.ndarray, np.ndarray]:
    return rays_of(POINTS, np.eye(3), np.zeros(3)), rays_of(POINTS, R, CENTRE)


def turned_by(one: np.ndarray, two: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(one @ two.T) - 1) / 2, -1, 1)))


@given(vector=angles, centre=places, seed=st.integers(0, 10**6))
def test_triangulate_after_project_is_identity(vector: tuple[float, ...], centre: tuple[float, ...], seed: int) -> None:
    points = np.random.default_rng(seed).uniform([-20, -15, 30], [20, 15, 90], (20, 3))
    rotations, centres = [np.eye(3), rotation(vector), rotation([0.0, 0.2, 0.0])], [
        np.zeros(3), np.array(centre), np.array([-30.0, 0.0, 0.0]),
    ]  # fmt: skip
    rays = [rays_of(points, R, c) for R, c in zip(rotations, centres, strict=True)]
    # Rounding 1e-16, magnified by depth / baseline (up to 20) and by depth (up to 100 m), squared by the SVD's gap.
    assert triangulate(rays, rotations, centres) == pytest.approx(points, abs=1e-8)
    assert triangulate(rays[:2], rotations[:2], centres[:2]) == pytest.approx(points, abs=1e-7)


def test_a_missing_ray_is_left_out_of_its_point() -> None:
    one, two = seen()
    third = rays_of(POINTS, np.eye(3), np.array([-30.0, 0, 0]))
    third[::3] = np.nan
    found = triangulate([one, two, third], [np.eye(3), R, np.eye(3)], [np.zeros(3), CENTRE, np.array([-30.0, 0, 0])])
    assert found == pytest.approx(POINTS, abs=1e-8)


def test_essential_matrix_by_svd_is_the_poses_own() -> None:
    E = essential_by_svd(*seen())
    t = -R @ CENTRE / np.linalg.norm(CENTRE)
    truth = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]) @ R
    # Known up to sign; both have unit singular values.
    assert min(np.abs(E - truth).max(), np.abs(E + truth).max()) < 1e-10
    assert np.linalg.svd(E, compute_uv=False) == pytest.approx([1, 1, 0], abs=1e-12)


def test_one_of_the_four_decompositions_is_the_pose_and_all_are_rotations() -> None:
    four = decompose(essential_by_svd(*seen()))
    assert len(four) == 4
    for rotation_, t in four:
        assert np.linalg.det(rotation_) == pytest.approx(1.0)
        assert np.linalg.norm(t) == pytest.approx(1.0)
    t = -R @ CENTRE / np.linalg.norm(CENTRE)
    assert min(turned_by(rotation_, R) + np.linalg.norm(tt - t) for rotation_, tt in four) < 1e-7


def test_robust_pose_survives_forty_per_cent_of_clutter() -> None:
    one, two = seen()
    rng = np.random.default_rng(3)
    wrong = rng.permutation(len(POINTS))[: int(0.4 * len(POINTS))]
    two[wrong] = rng.uniform(-0.6, 0.6, (len(wrong), 2))
    essentials, inlier = essential_robust(one, two, 1e-3)
    assert essentials
    assert not inlier[wrong].mean() > 0.1  # a wrong ray may lie on its epipolar line by chance
    best = relative_poses(one, two, 1e-3)[0]
    assert turned_by(best.R, R) < 1e-6
    assert best.t == pytest.approx(-R @ CENTRE / np.linalg.norm(CENTRE), abs=1e-6)


def test_same_rays_same_bytes() -> None:
    first, second = relative_poses(*seen(), 1e-3), relative_poses(*seen(), 1e-3)
    assert [p.R.tobytes() + p.t.tobytes() for p in first] == [p.R.tobytes() + p.t.tobytes() for p in second]


def test_too_few_rays_give_no_pose() -> None:
    one, two = seen()
    assert essential_robust(one[:5], two[:5], 1e-3)[0] == []
    assert relative_poses(one[:5], two[:5], 1e-3) == []


def test_behind_the_camera_is_infinitely_far_off() -> None:
    behind = np.array([[0.0, 0.0, -5.0]])
    assert np.isinf(reprojection(behind, np.zeros((1, 2)), np.eye(3), np.zeros(3))[0])


OBJECTS = 4  # in the air at once, each seen by both cameras at 25 instants


def combinations_of_four(order: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every object of the first camera (one after the other in POINTS) beside every one of the second's."""
    one, two = (rays[:100].reshape(OBJECTS, 25, 2) for rays in seen())
    first, second = (index.ravel() for index in np.meshgrid(range(OBJECTS), range(OBJECTS), indexing="ij"))
    label = np.repeat(first * OBJECTS + second, 25)
    return one[first].reshape(-1, 2), two[order][second].reshape(-1, 2), label


@pytest.mark.parametrize("seed", range(8))
def test_four_objects_are_told_apart_where_each_combination_is_drawn_from_by_itself(seed: int) -> None:
    """Three rows in four are wrong by construction. Of all rows alone, one pair of cameras in three had no pose."""
    random = np.random.default_rng(seed)
    one, two, label = combinations_of_four(random.permutation(OBJECTS))
    two = two + random.normal(0, 2e-4, two.shape)
    best = relative_poses(one, two, 2e-3, label)[0]
    # a fifth of a milliradian over 25 rays and a field of 0.5 rad: some tenths of a milliradian; four of them
    assert turned_by(best.R, R) < 2e-3

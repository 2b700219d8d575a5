"""EPnP in RANSAC: the pose from points, with a third of them wrong; the share tells whether a camera belongs."""

import numpy as np
import pytest

from calib.geometry.resection import resect
from calib.geometry.rotation import rotation

RNG = np.random.default_rng(11)
POINTS = RNG.uniform([-30, -30, 20], [30, 30, 60], (150, 3)) + np.array([400.0, -300.0, 0.0])
R = rotation([1.2, 0.2, -0.3])
CENTRE = POINTS.mean(0) - 120 * R[2]


def rays() -> np.ndarray:
    in_camera = (POINTS - CENTRE) @ R.T
    return in_camera[:, :2] / in_camera[:, 2:]


def test_exact_rays_give_the_exact_pose() -> None:
    found = resect(POINTS, rays(), 1e-3)
    assert found is not None
    assert pytest.approx(R, abs=1e-7) == found.R
    assert found.centre == pytest.approx(CENTRE, abs=1e-5)
    assert found.share == 1.0


def test_a_third_of_outliers_does_not_move_it() -> None:
    seen = rays()
    wrong = RNG.permutation(150)[:50]
    seen[wrong] = RNG.uniform(-0.5, 0.5, (50, 2))
    found = resect(POINTS, seen, 2e-3)
    assert found is not None
    assert pytest.approx(R, abs=1e-6) == found.R
    assert found.centre == pytest.approx(CENTRE, abs=1e-4)
    assert 100 <= found.inlier.sum() <= 103  # of 50 wrong ones a few fall within 2 mrad by chance


def test_noise_is_averaged() -> None:
    sigma = 1e-3
    seen = rays() + np.random.default_rng(5).normal(0, sigma, (150, 2))
    found = resect(POINTS, seen, 5 * sigma)
    assert found is not None
    assert found.rms_ray == pytest.approx(sigma * np.sqrt(2), rel=0.2)
    # A seventh of a milliradian of attitude, magnified by distance over the points' size: centimetres; 4 sigma.
    assert np.linalg.norm(found.centre - CENTRE) < 4 * sigma * 120 * 120 / 25 / np.sqrt(150)


def test_rays_of_another_world_are_explained_by_no_pose() -> None:
    found = resect(POINTS, np.random.default_rng(1).uniform(-0.5, 0.5, (150, 2)), 5e-3)
    assert found is None or found.share < 0.2


def test_fewer_than_six_points_are_no_pose() -> None:
    assert resect(POINTS[:5], rays()[:5], 1e-3) is None


def test_same_input_same_bytes() -> None:
    seen = rays() + np.random.default_rng(5).normal(0, 1e-3, (150, 2))
    one, two = resect(POINTS, seen, 5e-3), resect(POINTS, seen, 5e-3)
    assert one is not None
    assert two is not None
    assert one.R.tobytes() + one.centre.tobytes() == two.R.tobytes() + two.centre.tobytes()


@pytest.mark.parametrize("seed", range(8))
def test_a_camera_that_sees_six_objects_is_placed_though_nobody_knows_which_is_which(seed: int) -> None:
    """Five rows in six are wrong by construction, and four are right together once in 1296 draws."""
    random = np.random.default_rng(seed)
    objects, tracks = POINTS.reshape(6, 25, 3), rays().reshape(6, 25, 2)[random.permutation(6)]
    first, second = (index.ravel() for index in np.meshgrid(range(6), range(6), indexing="ij"))
    rows = objects[first].reshape(-1, 3), tracks[second].reshape(-1, 2)
    found = resect(*rows, 2e-3, np.repeat(6 * first + second, 25))
    assert found is not None
    assert pytest.approx(R, abs=1e-6) == found.R
    assert 150 <= found.inlier.sum() <= 160  # of 750 wrong ones a few fall within 2 mrad by chance

"""Networks of tripods drawn at random, and surveys of them of which one position is wrong: what a survey check is fed.

To first order (camera attitudes, centres and the flight's points are all unknown), with a pixel of noise.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.solving.survey_check import NetworkCheck, check_survey
from edge.common.arrays import Array

SIGMA_RAY: Final = 1.0 / 1500.0  # a pixel at 1500 px focal length
POINTS: Final = 600  # independent ones of a flight: what is left of thousands of correlated detections
SURVEY_SIGMA_M: Final = np.array([0.008, 0.008, 0.016])  # two occupations of network RTK
HEIGHTS_M: Final = (40.0, 150.0)


@dataclass(frozen=True)
class Drawn:
    """A network's geometry: centres (n, 3), and what the cameras alone know of them: information (3 n, 3 n)."""

    centres_m: Array
    information: Array


def trial(drawn: Drawn, wrong_m: float, rng: np.random.Generator) -> tuple[NetworkCheck, str]:
    """The verdict on one survey of a network, and the camera whose position is wrong in it."""
    cameras = len(drawn.centres_m)
    names = [f"cam{i + 1}" for i in range(cameras)]
    at = int(rng.integers(cameras))
    prior = np.diag(np.tile(SURVEY_SIGMA_M**2, cameras))
    surveyed = drawn.centres_m + rng.standard_normal((cameras, 3)) * SURVEY_SIGMA_M
    direction = rng.standard_normal(3)
    surveyed[at] += wrong_m * direction / np.linalg.norm(direction)
    seen = see(drawn, rng)
    covariance = np.asarray(np.linalg.inv(drawn.information + np.linalg.inv(prior)), float)
    pull = seen + np.linalg.solve(prior, (surveyed - drawn.centres_m).reshape(-1))
    adjusted = drawn.centres_m + (covariance @ pull).reshape(-1, 3)
    return check_survey(names, surveyed, prior, adjusted, covariance), names[at]


def see(drawn: Drawn, rng: np.random.Generator) -> Array:
    """(3 n,) the cameras' own pull on the centres: noise of the information they have, about the truth."""
    values, vectors = np.linalg.eigh(drawn.information)
    noise: Array = vectors @ (np.sqrt(np.maximum(values, 0)) * rng.standard_normal(len(values)))
    return noise


def draw(cameras: int, rng: np.random.Generator, points: int = POINTS) -> Drawn:
    """A network of tripods around a field, and a flight over it."""
    extent = rng.uniform(60, 150)
    bearing = 2 * np.pi * (np.arange(cameras) + rng.uniform(-0.3, 0.3, cameras)) / cameras
    radius = extent / 2 * rng.uniform(0.7, 1.0, cameras)
    centres = np.column_stack([radius * np.sin(bearing), radius * np.cos(bearing), rng.uniform(-2, 2, cameras)])
    spread = rng.uniform(-1, 1, (points, 2)) * extent
    flown = np.column_stack([spread, rng.uniform(*HEIGHTS_M, points)])
    return Drawn(centres, information(centres, flown))


def information(centres: Array, points: Array) -> Array:
    """(3 n, 3 n) what bearings to the points tell about the centres, attitudes and points being unknown too."""
    n = len(centres)
    poses = np.zeros((6 * n, 6 * n))
    for point in points:
        design = [bearing_design(point - centre) / SIGMA_RAY for centre in centres]
        to_point = np.concatenate([each[:, 6:] for each in design])
        to_poses = np.zeros((2 * n, 6 * n))
        for i, each in enumerate(design):
            to_poses[2 * i : 2 * i + 2, 3 * i : 3 * i + 3] = each[:, 3:6]
            to_poses[2 * i : 2 * i + 2, 3 * (n + i) : 3 * (n + i) + 3] = each[:, :3]
        left = to_poses - to_point @ np.linalg.lstsq(to_point, to_poses, rcond=None)[0]
        poses += left.T @ left
    known: Array = poses[: 3 * n, : 3 * n] - poses[: 3 * n, 3 * n :] @ np.linalg.solve(
        poses[3 * n :, 3 * n :], poses[3 * n :, : 3 * n]
    )
    return (known + known.T) / 2


def bearing_design(sight: Array) -> Array:
    """(2, 9) derivative of a bearing by attitude, centre and point."""
    distance = np.linalg.norm(sight)
    ahead = sight / distance
    across = np.linalg.svd(ahead[None, :])[2][1:]
    skew = np.array([[0, -ahead[2], ahead[1]], [ahead[2], 0, -ahead[0]], [-ahead[1], ahead[0], 0]])
    return np.hstack([-across @ skew, -across / distance, across / distance])

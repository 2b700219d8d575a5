"""One surveyed position of several is wrong: is that noticed, and is the right one named?

    python -m tools.bench.survey_network [--trials N] [--seed N]

Every trial draws a network, a flight and a survey, lets the cameras see the flight with a pixel of noise, adjusts both
together to first order (camera attitudes, centres and the flight's points are all unknown), and asks the check.
"""

import argparse
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.solving.survey_check import NetworkCheck, check_survey
from edge.common.arrays import Array

SIGMA_RAY: Final = 1.0 / 1500.0  # a pixel at 1500 px focal length
POINTS: Final = 600  # independent ones of a flight: what is left of thousands of correlated detections
SURVEY_SIGMA_M: Final = np.array([0.008, 0.008, 0.016])  # two occupations of network RTK
TRIALS_A_NETWORK: Final = 10  # surveys drawn of each network
HEIGHTS_M: Final = (40.0, 150.0)


@dataclass(frozen=True)
class Drawn:
    """A network's geometry: centres (n, 3), and what the cameras alone know of them: information (3 n, 3 n)."""

    centres_m: Array
    information: Array


def main() -> None:
    """Run the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--points", type=int, default=POINTS, help=f"independent ones of a flight (default: {POINTS})")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    print(
        f"seed {args.seed}, {args.trials} trials a row, networks of 60 to 150 m, survey sigma 8 8 16 mm, known lenses,"
    )
    print(f"1 px at 1500 px focal length, {args.points} independent points of a flight")
    print("cameras  wrong by   noticed   right one named: first  first and alone  among those named   another alone")
    for cameras in (3, 4, 5, 8):
        networks = [draw(cameras, rng, args.points) for _ in range(max(1, args.trials // TRIALS_A_NETWORK))]
        for wrong_m in (0.0, 0.05, 0.1, 0.3):
            print(row(networks, wrong_m, args.trials, rng))


def row(networks: list[Drawn], wrong_m: float, trials: int, rng: np.random.Generator) -> str:
    """One line of the table."""
    noticed = first = alone = among = other = 0
    for count in range(trials):
        verdict, wrong = trial(networks[count % len(networks)], wrong_m, rng)
        noticed += not verdict.passed
        first += verdict.suspect == wrong
        alone += verdict.suspect == wrong and not verdict.also
        among += wrong in (verdict.suspect, *verdict.also)
        other += verdict.suspect not in (None, wrong) and not verdict.also
    shares = [100 * times / trials for times in (noticed, first, alone, among, other)]
    columns = " ".join(f"{share:14.1f} %" for share in shares)
    return f"{len(networks[0].centres_m):7d} {wrong_m:8.2f} m {columns}"


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


if __name__ == "__main__":
    main()

"""One surveyed position of several is wrong: is that noticed, and is the right one named?

    python -m tools.bench.survey_network [--trials N] [--seed N]

Every trial draws a network, a flight and a survey, lets the cameras see the flight with a pixel of noise, adjusts both
together to first order (camera attitudes, centres and the flight's points are all unknown), and asks the check.
"""

import argparse
from typing import Final

import numpy as np

from tools.doubles.survey_network import POINTS, Drawn, draw, trial

TRIALS_A_NETWORK: Final = 10  # surveys drawn of each network


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


if __name__ == "__main__":
    main()

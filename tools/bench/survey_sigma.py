"""Is the survey's sigma true? Error of the averaged position against its stated sigma, and with a false fix mixed in.

python -m tools.bench.survey_sigma [--trials N] [--seed N]
"""

import argparse

import numpy as np

from calib.survey import Antenna, Occupation, combine
from edge.common.arrays import Array
from edge.gnss.averaging import POLE_SIGMA_M, SERVICES, StaticMean, average
from tools.doubles.receiver import rtk_error

SERVICE = SERVICES["network-rtk"]
ORIGIN = (48.0, 11.0, 500.0)
ANTENNA = Antenna(above_lens_m=0.0, measured_to="phase-centre")
PAUSE_S = 1800.0  # between two occupations: independent, and what a round over a few tripods takes
FALSE_FIX_M = 0.3


def main() -> None:
    """Run all of it and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print(f"seed {args.seed}, {args.trials} trials, 1 Hz, network RTK, error of two Gauss-Markov processes an axis")
    rng = np.random.default_rng(args.seed)
    show_durations(args.trials, rng)
    show_two_occupations(args.trials, rng)
    show_contamination(args.trials // 2, rng)


def show_durations(trials: int, rng: np.random.Generator) -> None:
    """Coverage and size of the error of one session, by its length."""
    print("\none session      error rms E N U (mm)   stated (mm)          within 1 sigma E N U    naive sd/sqrt(n)")
    for seconds in (6, 20, 60, 180, 600):
        t = np.arange(0.0, seconds + 1)
        noise = [rtk_error(t, rng) for _ in range(trials)]
        runs = [_mean(t, each) for each in noise]
        error = np.array([run.mean_m for run in runs])
        sigma = np.sqrt([run.sigma_m**2 - pole_variance() for run in runs])
        naive = np.median([each.std(axis=0) for each in noise], axis=0) / np.sqrt(len(t))
        within = (np.abs(error) < sigma).mean(axis=0)
        refused = np.mean([bool(run.fault) for run in runs])
        print(
            f"{seconds:4d} s   {mm(np.sqrt((error**2).mean(axis=0)))}   {mm(np.median(sigma, axis=0))}   "
            f"{percent(within)}   {mm(naive)}   refused {100 * refused:.1f} %"
        )


def show_two_occupations(trials: int, rng: np.random.Generator) -> None:
    """The figure asked for: 2 x 180 s, error against stated sigma."""
    errors, sigmas = [], []
    for _ in range(trials):
        point = two_occupations(rng)
        errors.append(point[0])
        sigmas.append(point[1])
    error, sigma = np.array(errors), np.array(sigmas)
    within = (np.abs(error) < sigma).mean(axis=0)
    print(f"\n2 x 180 s, {PAUSE_S / 60:.0f} min apart, the pole's share left out of sigma:")
    print(f"error rms {mm(np.sqrt((error**2).mean(axis=0)))}, stated {mm(np.median(sigma, axis=0))}")
    print(f"within 1 sigma: {percent(within)}, all axes {100 * (np.abs(error) < sigma).mean():.1f} % (asked 68 +- 5)")
    print(f"within 2 sigma: {percent((np.abs(error) < 2 * sigma).mean(axis=0))} (a normal error: 95)")


def two_occupations(rng: np.random.Generator) -> tuple[Array, Array]:
    """Error (3,) and stated sigma (3,) of one tripod occupied twice."""
    t = np.arange(0.0, 181)
    both = np.concatenate([t, t + PAUSE_S])
    error = rtk_error(both, rng)
    means = [_mean(t, error[: len(t)]), _mean(t, error[len(t) :])]
    occupations = [_occupation(mean, index) for index, mean in enumerate(means)]
    point = combine(occupations, where="bench")
    # Sub-millimetre work: the weights are equal, so the mean of the means is the point.
    return np.mean([mean.mean_m for mean in means], axis=0), np.array(point.sigma_m)


def show_contamination(trials: int, rng: np.random.Generator) -> None:
    """A false fix for part of the session: what the estimator makes of it, and whether the session is refused."""
    print(f"\n180 s, of which a share is {FALSE_FIX_M} m off in one direction:")
    t = np.arange(0.0, 181)
    for share in (0.1, 0.2, 0.3, 0.4):
        for kind in ("one stretch", "scattered"):
            errors, refused = [], 0
            for _ in range(trials):
                mean = _mean(t, rtk_error(t, rng) + false_fix(len(t), share, kind, rng))
                errors.append(mean.mean_m)
                refused += bool(mean.fault)
            rms = float(np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()))
            print(f"  {100 * share:.0f} % {kind}: 3-D rms {rms * 1000:.1f} mm; refused {100 * refused / trials:.1f} %")


def false_fix(count: int, share: float, kind: str, rng: np.random.Generator) -> Array:
    """(N, 3) a constant offset in a random direction for a share of the epochs."""
    direction = rng.standard_normal(3)
    wrong = np.zeros(count, bool)
    if kind == "scattered":
        wrong[rng.permutation(count)[: round(share * count)]] = True
    else:
        start = rng.integers(0, count - round(share * count) + 1)
        wrong[start : start + round(share * count)] = True
    return wrong[:, None] * FALSE_FIX_M * direction / np.linalg.norm(direction)


def pole_variance() -> Array:
    """(3,) the simulated antenna stands exactly: the pole's share of sigma is not tested here."""
    return np.array(POLE_SIGMA_M) ** 2


def _mean(t_s: Array, enu_m: Array) -> StaticMean:
    return average(t_s, enu_m, np.zeros(len(t_s), np.int64), SERVICE)


def _occupation(mean: StaticMean, index: int) -> Occupation:
    def three(values: Array) -> tuple[float, float, float]:
        east, north, up = values.tolist()
        return east, north, up

    return Occupation(
        t_unix_ns=round((1_790_000_000 + index * PAUSE_S) * 1e9),
        duration_s=mean.duration_s,
        samples=mean.samples,
        geodetic=ORIGIN,
        scatter_m=three(mean.scatter_m),
        floor_m=three(mean.floor_m),
        fixed_m=(0.0, 0.0, 0.0),
        antenna=ANTENNA,
    )


def mm(values: Array) -> str:
    """Three lengths in millimetres."""
    return " ".join(f"{1000 * value:5.1f}" for value in values)


def percent(values: Array) -> str:
    """Three shares in per cent."""
    return " ".join(f"{100 * value:5.1f}" for value in values)


if __name__ == "__main__":
    main()

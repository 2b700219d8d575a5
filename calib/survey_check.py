"""The survey against the cameras: which surveyed position is wrong, told from what the cameras themselves saw.

The hazard is a false fix that every test of the receiver's has passed. It stands still, it repeats, and it bends the
whole network. But the cameras know the network's shape without any survey, up to place, heading, tilt and scale. The
adjustment has already weighed the two against each other; by how much it moved each camera away from its surveyed
position, compared with how much it may, is a chi-square test with 3 n - 7 degrees of freedom. With four cameras or more
the one whose removal explains the misfit is named; with three any one of them would explain it.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from edge.lens import Array

FALSE_ALARM: Final = 0.01  # of a good survey: one calibration in a hundred asks for a second look
GAUGE: Final = 7  # what the cameras cannot know: place, attitude, scale
NAMEABLE_FROM: Final = 4  # cameras: with three every one of them can be the wrong one
RANK_TOLERANCE: Final = 1e-9  # of the largest eigenvalue: below it a direction is not tested at all
TAPE_SIGMA_M: Final = 0.01  # a steel tape over 50 m, sag and reading


@dataclass(frozen=True)
class NetworkCheck:
    """The verdict. statistic: chi-square with `freedom` degrees. suspect: the camera named, if one can be.

    wrong_by_m: (3,) east, north, up: how far the suspect's survey is off by what all others say; shares: for each
    camera the part of the statistic that goes away without it.
    """

    statistic: float
    freedom: int
    p_value: float
    passed: bool
    suspect: str | None
    wrong_by_m: tuple[float, float, float] | None
    shares: dict[str, float]

    def __str__(self) -> str:
        if self.passed:
            return f"survey and cameras agree (chi-square {self.statistic:.1f} of {self.freedom})"
        if self.suspect is None or self.wrong_by_m is None:
            return (
                f"one of the surveyed positions is wrong (chi-square {self.statistic:.1f} of {self.freedom}); "
                "with so few cameras it cannot be told which"
            )
        return (
            f"the surveyed position of {self.suspect} is wrong by about {math.hypot(*self.wrong_by_m):.2f} m "
            f"(chi-square {self.statistic:.1f} of {self.freedom})"
        )


def check_survey(
    names: list[str], surveyed_m: Array, survey_covariance: Array, adjusted_m: Array, adjusted_covariance: Array
) -> NetworkCheck:
    """Test the survey of n cameras against the adjustment that used it as a prior.

    surveyed_m, adjusted_m: (n, 3) ENU. survey_covariance, adjusted_covariance: (3 n, 3 n), the latter of the adjusted
    centres with everything else estimated. Source: Baarda, "A testing procedure for use in geodetic networks" (1968):
    the prior's weighted residuals g have covariance M = P^-1 - P^-1 C P^-1, and leaving camera i out lowers
    g' M^+ g by g_i' M_ii^-1 g_i.
    """
    weight = np.linalg.inv(survey_covariance)
    residual = weight @ (adjusted_m - surveyed_m).reshape(-1)
    spread = weight - weight @ adjusted_covariance @ weight
    spread = (spread + spread.T) / 2
    freedom = 3 * len(names) - GAUGE
    statistic = _quadratic(residual, spread, freedom)
    shares, biases = {}, {}
    for i, name in enumerate(names):
        block = slice(3 * i, 3 * i + 3)
        biases[name] = -np.linalg.pinv(spread[block, block], rcond=RANK_TOLERANCE) @ residual[block]
        shares[name] = float(-residual[block] @ biases[name])
    p_value = float(stats.chi2.sf(statistic, freedom))
    passed = p_value > FALSE_ALARM
    suspect = _suspect(shares) if not passed and len(names) >= NAMEABLE_FROM else None
    wrong_by = None
    if suspect is not None:
        east, north, up = biases[suspect].tolist()
        wrong_by = (east, north, up)
    return NetworkCheck(statistic, freedom, p_value, passed, suspect, wrong_by, shares)


def _quadratic(vector: Array, matrix: Array, rank: int) -> float:
    """vector' matrix^+ vector over the `rank` largest eigenvalues: the gauge is known to be nothing but rounding."""
    values, vectors = np.linalg.eigh(matrix)
    kept = np.arange(len(values)) >= len(values) - rank
    kept &= values > RANK_TOLERANCE * values[-1]
    return float(np.sum((vectors[:, kept].T @ vector) ** 2 / values[kept]))


def _suspect(shares: dict[str, float]) -> str:
    """The camera without which the misfit is least."""
    return max(shares, key=lambda name: shares[name])


@dataclass(frozen=True)
class TapeCheck:
    """A taped distance against the surveyed one. z: their difference in sigmas."""

    first: str
    second: str
    difference_m: float
    z: float

    @property
    def passed(self) -> bool:
        """Whether they agree within the false-alarm rate."""
        return 2 * float(stats.norm.sf(abs(self.z))) > FALSE_ALARM

    def __str__(self) -> str:
        verdict = "agrees" if self.passed else "one of the two positions is wrong, or the tape was misread"
        return f"{self.first} to {self.second}: survey minus tape {self.difference_m:+.3f} m: {verdict}"


def check_tape(
    names: tuple[str, str], positions_m: Array, sigmas_m: Array, taped_m: float, *, tape_sigma_m: float = TAPE_SIGMA_M
) -> TapeCheck:
    """Compare a taped distance between two lenses with their surveyed positions (2, 3), sigmas (2, 3), ENU metres."""
    between = positions_m[1] - positions_m[0]
    surveyed_m = float(np.linalg.norm(between))
    along = between / surveyed_m if surveyed_m > 0 else np.zeros(3)
    variance = float(np.sum((along * sigmas_m) ** 2)) + tape_sigma_m**2
    return TapeCheck(*names, surveyed_m - taped_m, (surveyed_m - taped_m) / math.sqrt(variance))

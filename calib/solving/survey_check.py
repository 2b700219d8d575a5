"""The survey against the cameras: which surveyed position is an outlier, by what the cameras themselves saw.

The hazard is a false fix that every test of the receiver's has passed. It stands still, it repeats, and it bends the
whole network. But the cameras know the network's shape without any survey, up to place, heading, tilt and scale. The
adjustment has already weighed the two against each other; by how much it moved each camera away from its surveyed
position, compared with how much it may, is a chi-square test with at most 3 n - 7 degrees of freedom. What the cameras
hardly know (a lens left free takes much of it) is not tested. A wrong position has three unknowns: only with more than
three tested directions, so from four cameras on, can the one whose removal explains the misfit be named, and where
others explain it nearly as well they are named too.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from edge.common.arrays import Array

FALSE_ALARM: Final = 0.01  # of a good survey: one calibration in a hundred asks for a second look
GAUGE: Final = 7  # what the cameras cannot know: place, attitude, scale
WRONG_HAS: Final = 3  # unknowns: fewer tested directions than that and one more, and every camera explains the misfit
TESTABLE: Final = 0.01  # of the survey's own information: what the cameras know less of is left to the survey
BIAS_SIGMA_M: Final = 1.0  # false fixes are decimetres, slips of the pen metres; without a scale any camera would do
UNDECIDED: Final = 6.0  # twice the log of 20 to 1: an explanation less than that worse than the best stays possible
TAPE_SIGMA_M: Final = 0.01  # a steel tape over 50 m, sag and reading


@dataclass(frozen=True)
class NetworkCheck:
    """The verdict. statistic: chi-square with `freedom` degrees, of `most` that cameras with sure lenses would test.
    suspect: the camera named, if one can be.

    wrong_by_m: (3,) east, north, up: how far the suspect's survey is off by what all others say. also: cameras that
    explain the misfit nearly as well. rest_p_value: chance of what is left, if the suspect's position were unknown.
    """

    statistic: float
    freedom: int
    p_value: float
    passed: bool
    suspect: str | None = None
    wrong_by_m: tuple[float, float, float] | None = None
    also: tuple[str, ...] = ()
    rest_p_value: float | None = None
    most: int = 0

    def __str__(self) -> str:
        if self.freedom == 0:
            return (
                "not tested: the cameras know nothing of the survey's shape but what the survey has told them "
                "(too few of them, or lenses left free)"
            )
        figures = f"(chi-square {self.statistic:.1f} of {self.freedom}{self._untested})"
        if self.passed:
            return f"survey and cameras agree {figures}"
        if self.suspect is None or self.wrong_by_m is None:
            return f"one of the surveyed positions is wrong; the cameras do not know enough to tell which {figures}"
        rest = f"; {', '.join(self.also)} cannot be excluded" if self.also else ""
        return (
            f"the surveyed position of {self.suspect} is wrong by about {math.hypot(*self.wrong_by_m):.2f} m{rest} "
            f"{figures}"
        )

    @property
    def _untested(self) -> str:
        """What of the survey's shape the cameras cannot tell, where there is some."""
        left = self.most - self.freedom
        return (
            f"; {left} of {self.most} directions are not tested: lenses left free, or too little seen"
            if left > 0
            else ""
        )


def check_survey(
    names: list[str], surveyed_m: Array, survey_covariance: Array, adjusted_m: Array, adjusted_covariance: Array
) -> NetworkCheck:
    """Test the survey of n cameras against the adjustment that used it as a prior.

    surveyed_m, adjusted_m: (n, 3) ENU. survey_covariance, adjusted_covariance: (3 n, 3 n), the latter of the adjusted
    centres with everything else estimated. In units of the survey's sigma (P = R R') the shift h = R^-1 (adjusted -
    surveyed) has covariance S = 1 - R^-1 C R^-T, and a wrong position b of camera i shifts it by -S R^-1 b. Source:
    Baarda, "A testing procedure for use in geodetic networks" (1968).
    """
    root = np.linalg.cholesky(survey_covariance)
    shift = np.linalg.solve(root, (adjusted_m - surveyed_m).reshape(-1))
    whitened = np.linalg.solve(root, np.linalg.solve(root, adjusted_covariance).T)
    values, vectors = np.linalg.eigh(np.eye(len(shift)) - (whitened + whitened.T) / 2)
    tested = (values > TESTABLE) & (np.arange(len(values)) >= GAUGE)
    values, vectors = values[tested], vectors[:, tested]
    seen = vectors.T @ shift
    freedom, statistic = len(values), float(np.sum(seen**2 / values))
    p_value = float(stats.chi2.sf(statistic, freedom)) if freedom else 1.0
    passed, most = p_value > FALSE_ALARM, max(len(shift) - GAUGE, 0)
    if passed or freedom <= WRONG_HAS:
        return NetworkCheck(statistic, freedom, p_value, passed, most=most)
    explained = _explanations(names, np.linalg.solve(root.T, vectors), seen, values)
    suspect, *others = sorted(explained, key=lambda name: -explained[name].support)
    least = explained[suspect].support - UNDECIDED
    also = tuple(name for name in others if explained[name].support > least)
    rest = float(stats.chi2.sf(statistic - explained[suspect].removes, freedom - WRONG_HAS))
    return NetworkCheck(statistic, freedom, p_value, passed, suspect, explained[suspect].bias_m, also, rest, most)


class _Explanation(NamedTuple):
    """One camera's wrong position as the cause: twice the log of its likelihood, how wrong it would be, and the part
    of the statistic that goes away with it.
    """

    support: float
    bias_m: tuple[float, float, float]
    removes: float


def _explanations(names: list[str], directions: Array, seen: Array, values: Array) -> dict[str, _Explanation]:
    """What each camera's wrong position would explain; directions: (3 n, m) tested ones, R^-T times eigenvectors."""
    explained = {}
    for i, name in enumerate(names):
        reach = directions[3 * i : 3 * i + 3]
        known = reach @ (values[:, None] * reach.T)
        pull = reach @ seen
        total = known + np.eye(3) / BIAS_SIGMA_M**2
        bias = -np.linalg.solve(total, pull)
        # A position that could be anything explains anything: its freedom counts against it.
        support = -float(pull @ bias) - float(np.linalg.slogdet(total * BIAS_SIGMA_M**2)[1])
        east, north, up = bias.tolist()
        explained[name] = _Explanation(support, (east, north, up), float(pull @ np.linalg.pinv(known) @ pull))
    return explained


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

"""Which one change of which one camera explains that the rays contradict each other: fault isolation.

Every hypothesis (this camera was turned; this camera's clock stepped) is weighed against "only what was expected": the
network's own covariance, the clocks' bounds, boxes off their centres. The hazards are two. The innocent: the camera
that looks worst is not named unless three others agree about the same object without it and no other camera explains
nearly as much. And the wrong cause: where an object flies straight a clock and a turn look alike, so a cause is told
only where the flight tells, and a clock that states its bound is believed more than one that does not.

The score of a hypothesis is what it takes off the sum of squares (Rao 1948, Willsky and Jones 1976: generalised
likelihood ratio), in closed form from normal equations: nothing is fitted again for each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from calib.guarding.evidence import FAULT_SIZE
from calib.guarding.memory import Slice
from calib.guarding.sums import Sums, summed
from calib.guarding.wander import ClockEstimate
from calib.network import POSE_SIZE
from edge.common.arrays import Array

TURN_SIGMA_RAD: Final = 0.035  # 2 degrees, one sigma of what a knock turns a camera by
STEP_SIGMA_S: Final = 0.3  # one sigma of what a clock steps by
CLOCK_BELIEF: Final = (
    8.0  # nats: at most so much is a stated bound worth against a step; a bound may be a lie, once in 3000
)
TELLS_CAUSE: Final = 7.0  # nats between the two causes, before one is told
ASTRAY: Final = 30.0  # taken off the sum of squares by one camera's change: then something is wrong
NAMING_MARGIN: Final = 16.0  # by which it must take off more than any other camera's change, to be named
NAMING_MARGIN_SHARE: Final = 0.15  # and this share of it
WITNESSES: Final = 3  # other cameras that agree about one object
SUPPORTED: Final = 0.5  # share of a window's slices in which they do
UNEXPLAINED: Final = 0.15  # of what is explained: more left over, and it is not the cause, or not yet the whole of it
FREEDOM_SIGMA: Final = 4.0  # and what chance leaves over
LEAST_PX: Final = 1.5  # less moves a target by less than its sigma
LEAST_STEP_S: Final = 0.008
OF_TURN: Final = np.arange(3)
OF_STEP: Final = np.array([POSE_SIZE])


@dataclass(frozen=True)
class Contradiction:
    """What one camera's change explains. score: what it takes off the sum of squares.

    turn_rad: (3,) and step_s: each as if it were the cause alone. knock_odds: log odds of a turn against a step, the
    clock's stated bound included.
    """

    camera: int
    score: float
    turn_rad: Array
    step_s: float
    knock_odds: float
    by_turn: float
    by_step: float

    @property
    def cause(self) -> Literal["knock", "clock", "either"]:
        """What happened, as far as the flight tells."""
        if abs(self.knock_odds) < TELLS_CAUSE:
            return "either"
        return "knock" if self.knock_odds > 0 else "clock"


@dataclass(frozen=True)
class Ranking:
    """All cameras' contradictions, worst first; and, if nothing happened: what is left of the squares beyond their
    degrees of freedom, and how the clocks are.
    """

    found: list[Contradiction]
    unexplained: float
    freedom: int
    clocks: ClockEstimate


@dataclass(frozen=True)
class GuardVerdict:
    """The strongest contradiction, whether it is one beyond doubt (astray), whether its camera may be named, and over
    how many slices it was found. clocks: if nothing happened.

    turned_rad, stepped_rad: by how much the camera's rays are off by the turn, or by the step. changed: since the first
    of the slices, by what was before; else for as long as is looked back. left_over: of all squares, unexplained.
    """

    worst: Contradiction
    astray: bool
    named: bool
    slices: int
    turned_rad: float
    stepped_rad: float
    clocks: ClockEstimate
    changed: bool
    left_over: float

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """By which the best explanation is chosen: of those with a beginning the one that leaves least unexplained."""
        return self.named, self.changed, -self.left_over if self.changed else self.worst.score / self.slices


@dataclass(frozen=True)
class ExpectedErrors:
    """What poses and clocks may be off by: mean (7 C,) and inverse (7 C, 7 C) of the joint covariance.

    focal_px: (C,). bound_s: (C,) of a clock that states one, else infinite.
    """

    mean: Array
    inverse: Array
    focal_px: Array
    bound_s: Array


def contradictions(sums: Sums, expected: ExpectedErrors) -> Ranking:
    """What each camera's change would explain."""
    posterior = np.linalg.inv(sums.normal + expected.inverse)
    right = sums.right - sums.normal @ expected.mean
    squares = sums.squares - 2 * float(expected.mean @ sums.right) + float(expected.mean @ sums.normal @ expected.mean)
    back = sums.cross.T @ posterior
    left = sums.change - back @ sums.cross
    pull = sums.right_change - sums.cross.T @ expected.mean - back @ right
    found = [_contradiction(k, left, pull, float(expected.bound_s[k])) for k in range(len(expected.focal_px))]
    unexplained = squares - float(right @ posterior @ right) - sums.freedom
    of_clocks = np.arange(len(found)) * FAULT_SIZE + OF_STEP
    off_s = (expected.mean + posterior @ right)[of_clocks]
    clocks = ClockEstimate(off_s, np.sqrt(np.diag(posterior)[of_clocks]))
    return Ranking(sorted(found, key=lambda one: -one.score), unexplained, sums.freedom, clocks)


def _contradiction(camera: int, left: Array, pull: Array, bound_s: float) -> Contradiction:
    turn, turn_score, turn_cost = _fit(left, pull, camera * FAULT_SIZE + OF_TURN, TURN_SIGMA_RAD)
    step, step_score, step_cost = _fit(left, pull, camera * FAULT_SIZE + OF_STEP, STEP_SIGMA_S)
    belief = min((float(step[0]) / bound_s) ** 2 / 2, CLOCK_BELIEF)
    odds = (turn_score - step_score) / 2 - turn_cost + step_cost + belief
    return Contradiction(camera, max(turn_score, step_score), turn, float(step[0]), odds, turn_score, step_score)


def _fit(left: Array, pull: Array, at: NDArray[np.intp], sigma: float) -> tuple[Array, float, float]:
    """A change with that prior sigma: its value, what it takes off the sum of squares, and its Occam factor (nats)."""
    normal = left[np.ix_(at, at)]
    value = np.linalg.solve(normal + np.eye(len(at)) * sigma**-2.0, pull[at])
    cost = float(np.linalg.slogdet(np.eye(len(at)) + normal * sigma**2)[1]) / 2
    return value, float(value @ pull[at]), cost


def judge(slices: Sequence[Slice], sums: Sums, expected: ExpectedErrors, before: Sums | None = None) -> GuardVerdict:
    """Whether rays contradict each other, and whether one camera may be named for it. slices: those it would be in.

    before: what was seen until then by itself, if the sums hold it too. What is left over is asked of the slices alone:
    among all that went well before, a slice that nothing explains would not be noticed.
    """
    ranking = contradictions(sums, expected)
    unexplained, freedom = ranking.unexplained, ranking.freedom
    if before is not None:
        unexplained, freedom = unexplained - contradictions(before, expected).unexplained, freedom - before.freedom
    worst, second = ranking.found[:2]
    turned_px, stepped_px = _moved_px(slices, worst)
    by_turn = worst.by_turn >= ASTRAY and turned_px > LEAST_PX
    by_step = worst.by_step >= ASTRAY and stepped_px > LEAST_PX and abs(worst.step_s) > LEAST_STEP_S
    clear = worst.score - second.score > max(NAMING_MARGIN, NAMING_MARGIN_SHARE * worst.score)
    over = unexplained - worst.score
    fits = over < UNEXPLAINED * worst.score + FREEDOM_SIGMA * np.sqrt(2.0 * freedom)
    astray = (by_turn or by_step) and _lasts(slices, worst, len(expected.focal_px))
    named = astray and clear and bool(fits) and _has_witnesses(slices, worst.camera)
    focal_px = float(expected.focal_px[worst.camera])
    return GuardVerdict(
        worst,
        astray,
        named,
        len(slices),
        turned_px / focal_px,
        stepped_px / focal_px,
        ranking.clocks,
        before is not None,
        ranking.unexplained - worst.score,
    )


def _moved_px(slices: Sequence[Slice], found: Contradiction) -> tuple[float, float]:
    """Root mean square by which the turn, and the step, move the pixels that the camera reports."""
    seen = [
        (one, one.cameras.tolist().index(found.camera))
        for part in slices
        for _, one in part.objects
        if found.camera in one.cameras
    ]
    if not seen:
        return 0.0, 0.0
    turned_px2 = np.mean([one.turned_px2[k] for one, k in seen], axis=0)
    speed2 = float(np.mean([one.speed_px_s[k] ** 2 for one, k in seen]))
    return float(np.sqrt(found.turn_rad @ turned_px2 @ found.turn_rad)), abs(found.step_s) * float(np.sqrt(speed2))


def _has_witnesses(slices: Sequence[Slice], camera: int) -> bool:
    """Whether, most of the time, three others agree about one object."""
    agreed = sum(
        any(
            sum(agree and k != camera for k, agree in zip(found.cameras.tolist(), found.agree, strict=True))
            >= WITNESSES
            for _, found in one.objects
        )
        for one in slices
    )
    return agreed >= SUPPORTED * len(slices)


def _lasts(slices: Sequence[Slice], found: Contradiction, cameras: int) -> bool:
    """Whether most slices speak of it: half a second of something else would stay in every window for seconds."""
    return 2 * sum(supports(one, found, cameras) for one in slices) > len(slices)


def supports(one: Slice, found: Contradiction, cameras: int) -> bool:
    """Whether a slice, by itself, is better explained with the change than without."""
    sums = summed([one], cameras)
    knocked = found.knock_odds > 0
    at = found.camera * FAULT_SIZE + (OF_TURN if knocked else OF_STEP)
    value = found.turn_rad if knocked else np.array([found.step_s])
    gain = 2 * value @ sums.right[at] - value @ sums.normal[np.ix_(at, at)] @ value
    return bool(gain > 0)

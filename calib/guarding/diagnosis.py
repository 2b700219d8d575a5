"""Which one change of which one camera explains that the rays contradict each other: fault isolation.

Every hypothesis (this camera was turned; this camera's clock stepped) is weighed against "only what was expected": the
network's own covariance, the clocks' bounds, boxes off their centres. The hazards are two. The innocent: the camera
that looks worst is not named unless three others agree about the same object without it and no other camera explains
nearly as much. And the wrong cause: where an object flies straight a clock and a turn look alike, so a cause is told
only where the flight tells, and a clock that states its bound is believed more than one that does not.

The score of a hypothesis is what it takes off the sum of squares (Rao 1948, Willsky and Jones 1976: generalised
likelihood ratio), in closed form from normal equations: nothing is fitted again for each.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from calib.guarding.evidence import FAULT_SIZE, UNKNOWNS, ObjectEvidence
from calib.guarding.memory import Slice
from calib.guarding.wander import ClockEstimate
from calib.network import POSE_SIZE
from edge.common.arrays import Array
from edge.common.units import NS

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
DRIFTS_PER_S: Final = 0.3  # of its offset a box drifts a second: an object that turns shows another end
STRETCH_NS: Final = 3_000_000_000  # of flight, in which that drift is as good as straight
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

    turned_rad, stepped_rad: by how much the camera's rays are off by the turn, or by the step.
    """

    worst: Contradiction
    astray: bool
    named: bool
    slices: int
    turned_rad: float
    stepped_rad: float
    clocks: ClockEstimate


@dataclass(frozen=True)
class ExpectedErrors:
    """What poses and clocks may be off by: mean (7 C,) and inverse (7 C, 7 C) of the joint covariance.

    focal_px: (C,). bound_s: (C,) of a clock that states one, else infinite.
    """

    mean: Array
    inverse: Array
    focal_px: Array
    bound_s: Array


@dataclass(frozen=True)
class Sums:
    """Normal equations of pose and clock of all cameras, boxes' offsets taken out: (7 C, 7 C), (7 C,).

    squares: the sum of squares they can explain, of so many degrees of freedom.
    """

    normal: Array
    right: Array
    squares: float
    freedom: int


def summed(slices: Sequence[Slice], cameras: int) -> Sums:
    """All slices of a window."""
    size = cameras * FAULT_SIZE
    normal, right = np.zeros((size, size)), np.zeros(size)
    squares, freedom = 0.0, 0
    for found in _by_object(slices).values():
        one = _without_offsets(found, cameras)
        normal += one.normal
        right += one.right
        squares += one.squares
        freedom += one.freedom
    return Sums(normal, right, squares, freedom)


def _by_object(slices: Sequence[Slice]) -> dict[tuple[int, int], list[tuple[float, ObjectEvidence]]]:
    """Each object's evidence of each stretch, with seconds from the stretch's middle."""
    found: defaultdict[tuple[int, int], list[tuple[float, ObjectEvidence]]] = defaultdict(list)
    for one in slices:
        ago_ns = slices[-1].t_unix_ns - one.t_unix_ns
        for number, of_object in one.objects:
            after_ns = STRETCH_NS // 2 - ago_ns % STRETCH_NS
            found[number, ago_ns // STRETCH_NS].append((after_ns / NS, of_object))
    return found


def _without_offsets(found: Sequence[tuple[float, ObjectEvidence]], cameras: int) -> Sums:
    """One object's slices, its offsets in the images and how they drift eliminated, each with its prior."""
    shape = (cameras, UNKNOWNS)
    moments = [np.zeros((*shape, *shape)) for _ in range(3)]  # weighed by 1, t and t^2
    rights = [np.zeros(shape) for _ in range(2)]
    lasting = np.ones(cameras)
    for t_s, one in found:
        at = one.cameras
        blocks = one.normal.transpose(0, 2, 1, 3)
        for power, moment in enumerate(moments):
            moment[at[:, None], :, at[None], :] += blocks * t_s**power
        for power, right in enumerate(rights):
            right[at] += one.right * t_s**power
        lasting[at] = one.lasting_px
    size, count = cameras * FAULT_SIZE, 2 * cameras
    kept, gone = slice(0, FAULT_SIZE), slice(FAULT_SIZE, UNKNOWNS)
    inner = [moment[:, gone][:, :, :, gone].reshape(count, count) for moment in moments]
    offsets = np.block([[inner[0], inner[1]], [inner[1], inner[2]]])
    sigma = np.repeat(lasting, 2)
    diagonal = np.arange(2 * count)
    offsets[diagonal, diagonal] += np.concatenate([sigma, sigma * DRIFTS_PER_S]) ** -2.0
    cross = np.vstack([moment[:, gone][:, :, :, kept].reshape(count, size) for moment in moments[:2]])
    beside = np.concatenate([right[:, gone].ravel() for right in rights])
    solved = np.linalg.solve(offsets, np.column_stack([cross, beside]))
    return Sums(
        moments[0][:, kept][:, :, :, kept].reshape(size, size) - cross.T @ solved[:, :-1],
        rights[0][:, kept].ravel() - cross.T @ solved[:, -1],
        sum(one.squares for _, one in found) - float(beside @ solved[:, -1]),
        sum(one.freedom for _, one in found),
    )


def contradictions(sums: Sums, expected: ExpectedErrors) -> Ranking:
    """What each camera's change would explain."""
    posterior = np.linalg.inv(sums.normal + expected.inverse)
    right = sums.right - sums.normal @ expected.mean
    squares = sums.squares - 2 * float(expected.mean @ sums.right) + float(expected.mean @ sums.normal @ expected.mean)
    back = sums.normal @ posterior
    left = sums.normal - back @ sums.normal
    pull = right - back @ right
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


def judge(slices: Sequence[Slice], expected: ExpectedErrors) -> GuardVerdict:
    """Whether a window's rays contradict each other, and whether one camera may be named for it."""
    ranking = contradictions(summed(slices, len(expected.focal_px)), expected)
    worst, second = ranking.found[:2]
    turned_px, stepped_px = _moved_px(slices, worst)
    by_turn = worst.by_turn >= ASTRAY and turned_px > LEAST_PX
    by_step = worst.by_step >= ASTRAY and stepped_px > LEAST_PX and abs(worst.step_s) > LEAST_STEP_S
    clear = worst.score - second.score > max(NAMING_MARGIN, NAMING_MARGIN_SHARE * worst.score)
    over = ranking.unexplained - worst.score
    fits = over < UNEXPLAINED * worst.score + FREEDOM_SIGMA * np.sqrt(2.0 * ranking.freedom)
    astray = by_turn or by_step
    named = astray and clear and bool(fits) and _has_witnesses(slices, worst.camera)
    focal_px = float(expected.focal_px[worst.camera])
    return GuardVerdict(worst, astray, named, len(slices), turned_px / focal_px, stepped_px / focal_px, ranking.clocks)


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


def supports(one: Slice, found: Contradiction, cameras: int) -> bool:
    """Whether a slice, by itself, is better explained with the change than without."""
    sums = summed([one], cameras)
    knocked = found.knock_odds > 0
    at = found.camera * FAULT_SIZE + (OF_TURN if knocked else OF_STEP)
    value = found.turn_rad if knocked else np.array([found.step_s])
    gain = 2 * value @ sums.right[at] - value @ sums.normal[np.ix_(at, at)] @ value
    return bool(gain > 0)

"""From an estimate downhill under weights that stay: Levenberg-Marquardt, with geodesic acceleration in valleys.

The hazard is the valley. Where the object is far or a lens is hardly known, the cost is a narrow valley that bends: a
straight step of any length leaves it, damping shortens the steps until they stay inside, and what looks settled only
creeps. So a step that left it is bent as the residuals bend along it (Transtrum and Sethna 2012), and a descent says
whether it has settled or only had its steps.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.adjustment.normal import Normal, NormalStep, factorise
from calib.adjustment.problem import Point
from calib.errors import LensError

SETTLED: Final = 0.03  # squared sigmas: a step that gains less moves nothing by more than a sixth of its sigma
# Squared sigmas a control point: outliers go on changing sides here and there along the flight for long after the
# cameras have settled, each time moving a second of it by a few hundredths of its sigma.
FLIGHT_SETTLED: Final = 1e-3
NEAR: Final = 10.0  # squared sigmas: a step that gains less is near the end
FIRST_DAMPING: Final = 1e-4
LEAST_DAMPING: Final = 1e-6  # below it, none
HARDEST_DAMPING: Final = 1e6
LOOKED_AHEAD: Final = 0.1  # share of a step at which residuals are looked at to see how they bend
SHORTEST_FREE: Final = 0.1  # of a step that takes the flight's shape for as free as it is
MOST_BENT: Final = 0.75  # of a step: what is bent more is no valley


@dataclass(frozen=True)
class Descent:
    """Where a descent came to, its cost there, and whether it has settled."""

    point: Point
    cost: float
    settled: bool


@dataclass(frozen=True)
class _Trial:
    """A point that may be gone on from. camera_squared: how far the step moved the cameras, in squared sigmas."""

    point: Point
    cost: float
    camera_squared: float


def descend(point: Point, steps: int) -> Descent:
    """Until it has settled, or for so many steps."""
    way, cost = _Way(), point.cost()
    for _ in range(steps):
        normal = point.normal()
        while (trial := _trial(point, normal, way)) is None or trial.cost > cost:
            way = way.more_careful
            if way.damping > HARDEST_DAMPING:
                return Descent(point, cost, settled=True)
        gain, cost, point = cost - trial.cost, trial.cost, trial.point
        flight_settled = max(SETTLED, FLIGHT_SETTLED * len(point.estimate.control))
        if gain < SETTLED or (way.damping == 0.0 and trial.camera_squared < SETTLED and gain < flight_settled):
            return Descent(point, cost, settled=True)
        way = way.bolder(near=gain < NEAR)
    return Descent(point, cost, settled=False)


@dataclass(frozen=True)
class _Way:
    """How a step is taken. bent: as the residuals bend, once a straight one has left the valley. free: the shape of
    the flight as free as it is, near the end; far from it, such a step would be taken too far. share: of a free step,
    that damping does not shorten where only slack was left.
    """

    damping: float = 0.0
    bent: bool = False
    free: bool = False
    share: float = 1.0

    @property
    def more_careful(self) -> "_Way":
        """After a step that gained nothing."""
        if not self.bent:
            return replace(self, bent=True)
        if self.free:
            short = self.share <= SHORTEST_FREE
            return replace(self, free=not short, share=1.0 if short else self.share / 4)
        return replace(self, damping=max(10 * self.damping, FIRST_DAMPING))

    def bolder(self, *, near: bool) -> "_Way":
        """After one that gained something."""
        return replace(self, damping=self.damping / 10 if self.damping > LEAST_DAMPING else 0.0, free=near, share=1.0)


def _trial(point: Point, normal: Normal, way: _Way) -> _Trial | None:
    """Where a step leads; None if the equations have no solution, or one that is no lens."""
    try:
        factor = factorise(normal, way.damping, slack=way.free)
        step = factor.solve(normal)
        taken = step.scaled(way.share)
        if way.bent:
            ahead = point.moved(step.scaled(LOOKED_AHEAD))
            bend = factor.solve(point.bent(step, LOOKED_AHEAD, ahead, normal))
            if _length(bend, normal) < MOST_BENT * _length(step, normal):
                taken = taken.plus(bend.scaled(way.share**2))
        reached = point.moved(taken)
    except (np.linalg.LinAlgError, LensError):
        return None
    return _Trial(reached, reached.cost(), taken.camera_squared)


def _length(step: NormalStep, normal: Normal) -> float:
    """Of a step, each unknown in the units of its own information."""
    control = np.einsum("ma,maa,ma->", step.control, normal.block[0], step.control)
    return float(np.sqrt(control + (step.camera**2 * np.diag(normal.corner)).sum()))

"""Uniform cubic B-splines: a flight as a function of time, one spline per unbroken stretch.

Cameras that do not fire together see the object at different instants. Resampling them to common times invents
observations; a continuous flight does not: every pixel constrains the flight at its own time, and the derivative by
time is what makes clocks observable. A cubic is the lowest degree whose acceleration is continuous, and with uniform
knots only four control points act at any instant, so the normal equations of a whole flight are banded.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

ORDER: Final = 4  # control points that act at one instant
# Rows: power of u; columns: control point (de Boor 1978, uniform knots).
_BASIS: Final = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float) / 6
# The third difference of four neighbouring control points is the cubic's third derivative times spacing^3.
THIRD_DIFFERENCE: Final = np.array([-1.0, 3.0, -3.0, 1.0])


@dataclass(frozen=True)
class Flight:
    """Where the knots of one or several flights lie: stretches, each with control points of its own.

    start_s: (S,) time of each stretch's first knot. spans: (S,) number of polynomial pieces. spacing_s: of the knots.
    target: (S,) which object flew the stretch. Control points of all stretches are stacked in one (M, 3) array.
    """

    start_s: Array
    spans: NDArray[np.int64]
    spacing_s: float
    target: NDArray[np.int64]

    @property
    def first_control(self) -> NDArray[np.int64]:
        """(S,) index of each stretch's first control point."""
        return np.concatenate([[0], np.cumsum(self.spans + ORDER - 1)[:-1]]).astype(np.int64)

    @property
    def piece_controls(self) -> NDArray[np.int64]:
        """(P,) index of the first of the four control points of every polynomial piece."""
        pieces = [first + np.arange(spans) for first, spans in zip(self.first_control, self.spans, strict=True)]
        return np.concatenate(pieces)

    @property
    def controls(self) -> int:
        """How many control points there are in all."""
        return int(np.sum(self.spans + ORDER - 1))

    @property
    def end_s(self) -> Array:
        """(S,) time of each stretch's last knot."""
        return self.start_s + self.spans * self.spacing_s

    def stretch_of(self, t_s: Array, target: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) stretch that holds each time of each object; -1 where none does."""
        found = np.full(len(t_s), -1, np.int64)
        for stretch in range(len(self.start_s)):
            inside = (t_s >= self.start_s[stretch]) & (t_s <= self.end_s[stretch]) & (target == self.target[stretch])
            found[inside] = stretch
        return found

    def locate(self, t_s: Array, stretch: NDArray[np.int64]) -> "Located":
        """Where times (N,) fall in their stretches (N,). Times beyond an end extrapolate its last piece."""
        at = (t_s - self.start_s[stretch]) / self.spacing_s
        span = np.clip(np.floor(at).astype(np.int64), 0, self.spans[stretch] - 1)
        return Located(self.first_control[stretch] + span, at - span, self.spacing_s)


@dataclass(frozen=True)
class Located:
    """Times as (first: (N,) index of the first of four control points, u: (N,) position within the piece)."""

    first: NDArray[np.int64]
    u: Array
    spacing_s: float

    def rows(self, which: NDArray[np.bool_]) -> "Located":
        """Only some of them."""
        return Located(self.first[which], self.u[which], self.spacing_s)

    def weights(self) -> Array:
        """(N, 4) weights of the four control points in the position."""
        u = self.u
        return np.stack([np.ones_like(u), u, u * u, u**3], axis=1) @ _BASIS

    def velocity_weights(self) -> Array:
        """(N, 4) weights in the velocity, per second."""
        u = self.u
        return np.stack([np.zeros_like(u), np.ones_like(u), 2 * u, 3 * u * u], axis=1) @ _BASIS / self.spacing_s

    def blossom_weights(self) -> Array:
        """(N, 4) weights in the control point that a spline with a knot there has: f - spacing^2 f'' / 6."""
        u = self.u
        curvature = np.stack([np.zeros_like(u), np.zeros_like(u), np.full_like(u, 2.0), 6 * u], axis=1) @ _BASIS
        return self.weights() - curvature / 6

    def controls(self) -> NDArray[np.int64]:
        """(N, 4) indices of the control points."""
        return self.first[:, None] + np.arange(ORDER)


def evaluate(located: Located, control: Array) -> Array:
    """Positions (N, 3) of a flight with control points (M, 3)."""
    position: Array = np.einsum("nk,nkd->nd", located.weights(), control[located.controls()])
    return position


def velocity(located: Located, control: Array) -> Array:
    """Velocities (N, 3) per second of a flight with control points (M, 3)."""
    result: Array = np.einsum("nk,nkd->nd", located.velocity_weights(), control[located.controls()])
    return result


def relaid(control: Array, old: Flight, new: Flight, later_s: float) -> Array:
    """Control points (M', 3) on new knots of the flight that control points (M, 3) are of on old ones.

    later_s: the new times less the old. On the same knots they come back as they are; those of a stretch that was not
    flown for as long, to one knot, are NaN.
    """
    result = np.full((new.controls, 3), np.nan)
    for own in range(len(new.start_s)):
        start_s, end_s = new.start_s[own] - later_s, new.end_s[own] - later_s
        flown = (old.start_s - start_s < old.spacing_s) & (end_s - old.end_s < old.spacing_s)
        before = np.flatnonzero(flown & (old.target == new.target[own]))
        if len(before) == 1:
            t_s = start_s + (np.arange(new.spans[own] + ORDER - 1) - 1) * new.spacing_s
            located = old.locate(t_s, np.full(len(t_s), before[0]))
            first = new.first_control[own]
            points = np.einsum("nk,nkd->nd", located.blossom_weights(), control[located.controls()])
            result[first : first + len(t_s)] = points
    return result


def lay_knots(t_s: Array, target: NDArray[np.int64], spacing_s: float, longest_gap_s: float) -> Flight:
    """Stretches that cover times (N,) of objects (N,), broken where an object is unseen for longer than the gap."""
    starts, spans, owners = [], [], []
    for owner in np.unique(target):
        times = np.sort(t_s[target == owner])
        breaks = np.flatnonzero(np.diff(times) > longest_gap_s)
        firsts = times[np.concatenate([[0], breaks + 1])]
        lasts = times[np.concatenate([breaks, [len(times) - 1]])]
        for first, last in zip(firsts, lasts, strict=True):
            starts.append(first - 0.5 * spacing_s)
            spans.append(max(1, int(np.ceil((last - first) / spacing_s)) + 1))
            owners.append(owner)
    return Flight(np.array(starts), np.array(spans, np.int64), spacing_s, np.array(owners, np.int64))

"""Fault diagnosis of a camera from residuals: is it a knock, or a clock that stepped?

The hazard is the alarm nobody heeds any more. A calibration is never exact: a camera is always off by a little, in
the same direction, and always more than its noise allows. So the expected part of it, the network's own covariance, is
counted as what cannot be told from a knock, and only more than that is evidence of a fault. A stepped clock shows
differently: what it is off by follows the motion in the image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array

WINDOWS_NS: Final = (
    2_000_000_000,
    4_000_000_000,
    6_000_000_000,
)  # evidence looked back on: for a blow, and for a slow tilt
FEWEST: Final = 6  # residuals
SHORTEST_NS: Final = 1_000_000_000  # they must span
ALIKE: Final = 3.0  # residuals that say as much as one: they share seconds, witnesses and pixels
KNOCK_SIGMA: Final = 4.5
KNOCK_PX: Final = 2.0  # less is a lens, not a knock
CLOCK_SIGMA: Final = 4.5
CLOCK_S: Final = 0.010  # a smaller step moves a target by less than its noise
CLOCK_PRIOR_S: Final = 0.5
FREE_PX: Final = 1e6  # a knock may be of any size
NO_CLOCK_S: Final = 1e-9
REWEIGHTINGS: Final = 4  # of reweighting: a wrong partner is far off and must not count


@dataclass(frozen=True)
class Residual:
    """off_px (2,): where its track is, minus where witnesses say it should be. velocity_px_s (2,) of the image there.

    noise_px: one sigma that is new each time; expected_px: one sigma that the calibration leaves, always the same.
    """

    t_unix_ns: int
    off_px: Array
    velocity_px_s: Array
    noise_px: float
    expected_px: float


@dataclass(frozen=True)
class FaultEvidence:
    """How strongly residuals speak against a camera, since when, and what happened to it."""

    strength: float
    since_unix_ns: int
    knock_px: float | None
    clock_s: float | None  # how far what it shows is behind its stamps, negative: ahead


def diagnose(seen: Sequence[Residual], now_unix_ns: int, clock_sigma_s: float = 0.001) -> FaultEvidence | None:
    """The fault with the strongest evidence in the residuals, if any.

    clock_sigma_s: by how much this camera's clock may be off the calibration's without being at fault: a consumer's
    camera with a clock of its own wanders by tens of milliseconds in a minute, a disciplined box does not.
    """
    stamps = np.array([t.t_unix_ns for t in seen], np.int64)
    inside = np.array([stamps > now_unix_ns - window for window in WINDOWS_NS]).reshape(len(WINDOWS_NS), len(seen))
    inside = inside[[_enough(stamps[window]) for window in inside]]
    if not len(inside):
        return None
    residuals = _Residuals.of(seen)
    expected = np.array([residuals.expected_px(window, clock_sigma_s) for window in inside])
    knocks = _fit(residuals, inside, np.full(len(inside), FREE_PX), NO_CLOCK_S, residuals.middle_px(inside))
    # A step of the clock beside what is expected anyway.
    clocks = _fit(residuals, inside, expected, CLOCK_PRIOR_S, np.zeros((len(inside), 2)))
    found = [
        _fault(knock, clock, float(expected_px), clock_sigma_s, int(stamps[window][0]))
        for knock, clock, expected_px, window in zip(knocks, clocks, expected, inside, strict=True)
    ]
    return max((one for one in found if one is not None), key=lambda one: one.strength, default=None)


def _enough(stamps: NDArray[np.int64]) -> bool:
    return len(stamps) >= FEWEST and stamps[-1] - stamps[0] >= SHORTEST_NS


def _fault(
    knocked: "_RayFit", stepped: "_RayFit", expected_px: float, clock_sigma_s: float, since_unix_ns: int
) -> FaultEvidence | None:
    knock_px = float(np.linalg.norm(knocked.value[:2]))
    knock = knock_px / float(np.sqrt(np.trace(knocked.covariance[:2, :2]) / 2 + expected_px**2))
    clock_s = float(stepped.value[2])
    clock = abs(clock_s) / float(np.hypot(np.sqrt(stepped.covariance[2, 2]), clock_sigma_s))
    is_knocked, is_stepped = knock > KNOCK_SIGMA and knock_px > KNOCK_PX, clock > CLOCK_SIGMA and abs(clock_s) > CLOCK_S
    if not is_knocked and not is_stepped:
        return None
    by_clock = is_stepped and (not is_knocked or stepped.cost < knocked.cost)
    strength = clock / CLOCK_SIGMA if by_clock else knock / KNOCK_SIGMA
    return FaultEvidence(strength, since_unix_ns, None if by_clock else knock_px, clock_s if by_clock else None)


@dataclass(frozen=True)
class _Residuals:
    """All residuals of a camera as arrays: off_px, velocity_px_s (N, 2), noise_px, expected (N,)."""

    off_px: Array
    velocity_px_s: Array
    noise_px: Array
    expected: Array

    @classmethod
    def of(cls, seen: Sequence[Residual]) -> "_Residuals":
        return cls(
            np.array([t.off_px for t in seen]),
            np.array([t.velocity_px_s for t in seen]),
            np.array([t.noise_px for t in seen]) * np.sqrt(ALIKE),
            np.array([t.expected_px for t in seen]),
        )

    def middle_px(self, inside: NDArray[np.bool_]) -> Array:
        """(W, 2) median of what is off, a window."""
        return np.array([np.median(self.off_px[window], axis=0) for window in inside])

    def expected_px(self, window: NDArray[np.bool_], clock_sigma_s: float) -> float:
        """What the calibration and a clock that wanders leave, one sigma."""
        wander_px = float(np.median(np.linalg.norm(self.velocity_px_s[window], axis=1))) * clock_sigma_s
        return float(np.hypot(np.median(self.expected[window]), wander_px))


@dataclass(frozen=True)
class _RayFit:
    """Offset u, v px and delay s; (3, 3) covariance; what is left over."""

    value: Array
    covariance: Array
    cost: float


def _fit(
    residuals: _Residuals, inside: NDArray[np.bool_], offset_sigma_px: Array, delay_sigma_s: float, start: Array
) -> list[_RayFit]:
    """off = offset + delay * velocity for each window (W, N), robustly (Cauchy weights), with prior sigmas of both.

    start: (W, 2) offsets to begin with. All windows at once: this is asked of every camera several times a second.
    """
    v, noise2 = residuals.velocity_px_s, residuals.noise_px**2
    features = np.column_stack([np.ones(len(v)), v, (v**2).sum(axis=1)])
    targets = np.column_stack([residuals.off_px, (v * residuals.off_px).sum(axis=1)])
    value = np.column_stack([start, np.zeros(len(start))])
    for _ in range(REWEIGHTINGS):
        weight = inside / noise2 / (1 + _squares(residuals, value) / (9 * noise2))
        one, vx, vy, vv = (weight @ features).T
        nil = np.zeros_like(one)
        normal = np.stack([one, nil, vx, nil, one, vy, vx, vy, vv], axis=1).reshape(-1, 3, 3)
        normal[:, [0, 1], [0, 1]] += offset_sigma_px[:, None] ** -2
        normal[:, 2, 2] += delay_sigma_s**-2
        covariance = np.linalg.inv(normal)
        value = np.matmul(covariance, (weight @ targets)[:, :, None])[:, :, 0]
    cost = (inside * np.log1p(_squares(residuals, value) / (9 * noise2))).sum(axis=1)
    return [_RayFit(*fit) for fit in zip(value, covariance, cost.tolist(), strict=True)]


def _squares(residuals: _Residuals, value: Array) -> Array:
    """(W, N) squared residuals, px^2."""
    left = residuals.off_px - value[:, None, :2] - value[:, None, 2:] * residuals.velocity_px_s
    squares: Array = np.einsum("wni,wni->wn", left, left)
    return squares

"""What witnesses say of a camera, and whether it amounts to a knock or to a clock that stepped.

The hazard is the alarm nobody believes any more. A calibration is never exact: a camera is always off by a little, in
the same direction, and always more than its noise allows. So the expected part of it, the network's own covariance, is
counted as what cannot be told from a knock, and only more than that speaks against a camera. A stepped clock shows
differently: what it is off by follows the motion in the image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge.lens import Array

WINDOWS_NS: Final = (
    2_000_000_000,
    4_000_000_000,
    6_000_000_000,
)  # evidence looked back on: for a blow, and for a slow tilt
FEWEST: Final = 6  # testimonies
SHORTEST_NS: Final = 1_000_000_000  # they must span
ALIKE: Final = 3.0  # testimonies that say as much as one: they share seconds, witnesses and pixels
KNOCK_SIGMA: Final = 4.5
KNOCK_PX: Final = 2.0  # less is a lens, not a knock
CLOCK_SIGMA: Final = 4.5
CLOCK_S: Final = 0.010  # a smaller step moves a target by less than its noise
CLOCK_PRIOR_S: Final = 0.5
ROUNDS: Final = 4  # of reweighting: a wrong partner is far off and must not count


@dataclass(frozen=True)
class Testimony:
    """off_px (2,): where its track is, minus where witnesses say it should be. velocity_px_s (2,) of the image there.

    noise_px: one sigma that is new each time; expected_px: one sigma that the calibration leaves, always the same.
    """

    t_unix_ns: int
    off_px: Array
    velocity_px_s: Array
    noise_px: float
    expected_px: float


@dataclass(frozen=True)
class Accusation:
    """How strongly testimony speaks against a camera, since when, and what happened to it."""

    strength: float
    since_unix_ns: int
    knock_px: float | None
    clock_s: float | None  # how far what it shows is behind its stamps, negative: ahead


def judge(heard: Sequence[Testimony], now_unix_ns: int, clock_sigma_s: float = 0.001) -> Accusation | None:
    """The strongest accusation that the testimony supports, if any.

    clock_sigma_s: by how much this camera's clock may be off the calibration's without being at fault: a consumer's
    camera with a clock of its own wanders by tens of milliseconds in a minute, a disciplined box does not.
    """
    windows = [[t for t in heard if t.t_unix_ns > now_unix_ns - window] for window in WINDOWS_NS]
    found = [_judge(window, clock_sigma_s) for window in windows]
    return max((one for one in found if one is not None), key=lambda one: one.strength, default=None)


def _judge(heard: list[Testimony], clock_sigma_s: float) -> Accusation | None:
    if len(heard) < FEWEST or heard[-1].t_unix_ns - heard[0].t_unix_ns < SHORTEST_NS:
        return None
    off = np.array([t.off_px for t in heard])
    velocity = np.array([t.velocity_px_s for t in heard])
    noise = np.array([t.noise_px for t in heard]) * np.sqrt(ALIKE)
    wander_px = float(np.median(np.linalg.norm(velocity, axis=1))) * clock_sigma_s
    expected = float(np.hypot(np.median([t.expected_px for t in heard]), wander_px))
    free = _fit(off, velocity, noise, (1e6, 1e-9))  # a knock alone
    knock_px = float(np.linalg.norm(free.value[:2]))
    knock = knock_px / float(np.sqrt(np.trace(free.covariance[:2, :2]) / 2 + expected**2))
    both = _fit(off, velocity, noise, (expected, CLOCK_PRIOR_S))  # a clock, beside what is expected anyway
    clock_s = float(both.value[2])
    clock = abs(clock_s) / float(np.hypot(np.sqrt(both.covariance[2, 2]), clock_sigma_s))
    knocked, stepped = knock > KNOCK_SIGMA and knock_px > KNOCK_PX, clock > CLOCK_SIGMA and abs(clock_s) > CLOCK_S
    if not knocked and not stepped:
        return None
    by_clock = stepped and (not knocked or both.cost < free.cost)
    strength = clock / CLOCK_SIGMA if by_clock else knock / KNOCK_SIGMA
    return Accusation(strength, heard[0].t_unix_ns, None if by_clock else knock_px, clock_s if by_clock else None)


@dataclass(frozen=True)
class _Fit:
    """Offset u, v px and delay s; (3, 3) covariance; what is left over."""

    value: Array
    covariance: Array
    cost: float


def _fit(off: Array, velocity: Array, noise: Array, prior: tuple[float, float]) -> _Fit:
    """off = offset + delay * velocity, robustly (Cauchy weights), with prior sigmas of offset and delay."""
    design = np.zeros((len(off), 2, 3))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    design[:, :, 2] = velocity
    precision = np.diag([prior[0] ** -2, prior[0] ** -2, prior[1] ** -2])
    value = np.append(np.median(off, axis=0), 0.0) if prior[1] < 1e-6 else np.zeros(3)
    weight = noise**-2
    for _ in range(ROUNDS):
        residual = np.linalg.norm(off - np.einsum("nij,j->ni", design, value), axis=1) / noise
        weight = noise**-2 / (1 + (residual / 3) ** 2)
        normal = np.einsum("nia,n,nib->ab", design, weight, design) + precision
        value = np.linalg.solve(normal, np.einsum("nia,n,ni->a", design, weight, off))
    left = np.linalg.norm(off - np.einsum("nij,j->ni", design, value), axis=1) / noise
    return _Fit(value, np.linalg.inv(normal), float(np.sum(np.log1p((left / 3) ** 2))))

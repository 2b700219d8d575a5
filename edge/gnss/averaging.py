"""Static averaging: the mean of one receiver's epochs, and a sigma that is true.

The hazard is sd / sqrt(n). The error of an RTK position is correlated over minutes: an hour at 1 Hz holds some ten to a
hundred independent samples, ten per second add nothing, and sd / sqrt(n) of three minutes is 7 to 25 times too small.
Nor does a short window show the error's size: everything in it is wrong by the same amount. So sigma comes from a model
of the correlated error, with a prior on its size that the window's own scatter replaces only as it grows long, and with
a floor that no averaging in one go gets below. And a receiver can be wrong throughout: what wanders, jumps or
comes back from float somewhere else is refused whole.

Horizontal figures of the model are 2-D rms; per axis they are smaller by sqrt(2).
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.static_rtk import LEAST_STATIC_SIGMA_M

TAU_S: Final = 20.0  # correlation time of the fast part of the error, measured on network RTK
SLOW_TAU_S: Final = 400.0  # and of the slow part, which only a second occupation later averages
PRIOR_WEIGHT: Final = 1.0  # the prior counts as one correlation time's worth of data
POLE_SIGMA_M: Final = (0.003 / math.sqrt(2), 0.003 / math.sqrt(2), 0.002)  # levelling and height of the antenna
PPM: Final = 1e-6  # of the baseline to the base station: the receivers' own data sheets

CLIP_MADS: Final = 3.0  # with the next line the usual three-sigma clip
MAD_TO_SIGMA: Final = 1.4826  # of a normal distribution
LONG_SEGMENT_S: Final = 30.0  # a shorter one is too uncertain to accuse another of being wrong
SEGMENTS_APART_H_M, SEGMENTS_APART_V_M = 0.03, 0.05  # above it one of two fixes between floats is false
NOW_APART_SIGMAS: Final = 6.0  # of the fast error: what comes now has to be this far away to be told before it is long
DRIFT_SIGMAS: Final = 5.0  # a fixed solution wanders by no more than five sigma of its model
DRIFT_BLOCK_S: Final = 3.0  # medians of so long are compared, so that single epochs do not alarm
MAX_STEP_NOISE_M: Final = (0.02, 0.02, 0.03)  # more noise than this between epochs is no fixed solution
MIN_SAMPLES: Final = 3
MIN_DURATION_S: Final = 5.0  # below it, a receiver that wanders cannot be told from one that does not
HOLD_EPOCHS: Final = 20  # identical coordinates in a row: the receiver's static hold, or a canned recording


@dataclass(frozen=True)
class Service:
    """How good a kind of RTK is. sigma: its fast error's one sigma, floor: what stays; east, north, up, metres."""

    name: str
    sigma_m: tuple[float, float, float]
    floor_m: tuple[float, float, float]


def _service(name: str, sigma_h: float, sigma_v: float, floor_h: float, floor_v: float) -> Service:
    """sigma per axis; floor_h is 2-D rms."""
    return Service(name, (sigma_h, sigma_h, sigma_v), (floor_h / math.sqrt(2), floor_h / math.sqrt(2), floor_v))


# Measured on an hour each of a 3 km baseline, two VRS networks and a PPP-RTK service.
SERVICES: Final = {
    service.name: service
    for service in (
        _service("own-base", 0.0045, 0.010, 0.005, 0.010),
        _service("network-rtk", 0.0095, 0.024, 0.008, 0.015),
        _service("ppp-rtk", 0.013, 0.024, 0.012, 0.020),
    )
}


@dataclass(frozen=True)
class StaticMean:
    """The mean of a session, or why there is none.

    mean_m, sigma_m: (3,) east, north, up. Of sigma, scatter_m is what a longer session makes smaller, floor_m what only
    another occupation later does, fixed_m (pole, baseline, resolution) what nothing does. fault: why the session must
    not be used, empty if it may; young if more time is all it needs; moved_until_s, on the epochs' own clock, if it is
    that the antenna was not at rest until then. warnings: what to tell the operator.
    """

    mean_m: Array
    sigma_m: Array
    scatter_m: Array
    floor_m: Array
    fixed_m: Array
    samples: int
    clipped: int
    duration_s: float
    segments: int
    fault: str = ""
    young: bool = False
    moved_until_s: float | None = None
    warnings: tuple[str, ...] = ()


def variance_share(duration_s: float, tau_s: float = TAU_S) -> float:
    """Variance of a Gauss-Markov process's mean over duration_s, relative to its own; 2 tau / T for long sessions."""
    x = duration_s / tau_s
    return 1.0 if x < 1e-6 else 2 / x * (1 - (1 - math.exp(-x)) / x)


def average(
    t_s: Array,
    enu_m: Array,
    segment: NDArray[np.int64],
    service: Service,
    *,
    step_m: tuple[float, float] = (0.0, 0.0),
    baseline_m: float = 0.0,
) -> StaticMean:
    """Median, 3-MAD clip and mean of a session, with its sigma.

    t_s: (N,) seconds, ascending. enu_m: (N, 3). segment: (N,) numbers that change where the fix was interrupted.
    step_m: the coordinates' resolution, horizontal and vertical. Source: TSA, "Guidance notes for GNSS network RTK
    surveying" (2012), for windows and intervals.
    """
    agreeing, fault = _agreeing_segments(t_s, enu_m, segment, service)
    keep = agreeing & _within_mads(enu_m, agreeing)
    keep = keep if keep.any() else agreeing
    mean = enu_m[keep].mean(axis=0)
    observed_s = _duration_s(t_s[agreeing], segment[agreeing])
    duration_s = observed_s * float(keep.sum() / agreeing.sum())
    scatter = _scatter(enu_m[keep], duration_s, service)
    resolution = np.array([step_m[0], step_m[0], step_m[1]]) / math.sqrt(12)
    floor = np.array(service.floor_m)
    fixed = np.sqrt(np.array(POLE_SIGMA_M) ** 2 + resolution**2 + (PPM * baseline_m) ** 2)
    sigma = np.maximum(np.sqrt(scatter**2 + floor**2 + fixed**2), LEAST_STATIC_SIGMA_M)
    drift = None if fault else _drift(t_s[agreeing], enu_m[agreeing], service)
    fault = drift.fault if drift else fault
    young = not fault and (keep.sum() < MIN_SAMPLES or observed_s < MIN_DURATION_S)
    if young:
        fault = f"only {int(keep.sum())} epochs in {observed_s:.1f} s so far, of {MIN_DURATION_S:.0f} s"
    return StaticMean(
        mean_m=mean,
        sigma_m=sigma,
        scatter_m=scatter,
        floor_m=floor,
        fixed_m=fixed,
        samples=int(keep.sum()),
        clipped=int((~keep).sum()),
        duration_s=duration_s,
        segments=len(np.unique(segment[keep])),
        fault=fault,
        young=bool(young),
        moved_until_s=drift.until_s if drift else None,
        warnings=_warnings(enu_m, step_m),
    )


def _duration_s(t_s: Array, segment: NDArray[np.int64]) -> float:
    """Seconds observed, interruptions left out."""
    if len(t_s) < 2:
        return 0.0
    inside = np.diff(segment) == 0
    return float(np.diff(t_s)[inside].sum())


def _agreeing_segments(
    t_s: Array, enu_m: Array, segment: NDArray[np.int64], service: Service
) -> tuple[NDArray[np.bool_], str]:
    """Which epochs belong to segments that agree with the longest, and a fault if a long one does not.

    Of a short one too, while it is what comes now and farther away than a fixed solution wanders.
    """
    wander_h_m, wander_v_m = NOW_APART_SIGMAS * service.sigma_m[0], NOW_APART_SIGMAS * service.sigma_m[2]
    numbers = np.unique(segment)
    medians = {n: np.median(enu_m[segment == n], axis=0) for n in numbers}
    lengths = {n: float(np.ptp(t_s[segment == n])) for n in numbers}
    longest = max(numbers, key=lambda n: lengths[n])
    agreeing = np.ones(len(t_s), bool)
    fault = ""
    for n in numbers:
        east, north, up = medians[n] - medians[longest]
        if math.hypot(east, north) <= SEGMENTS_APART_H_M and abs(up) <= SEGMENTS_APART_V_M:
            continue
        agreeing[segment == n] = False
        now_elsewhere = n == segment[-1] and (math.hypot(east, north) > wander_h_m or abs(up) > wander_v_m)
        if lengths[n] >= LONG_SEGMENT_S or now_elsewhere:
            fault = (
                f"after an interruption it was {math.hypot(east, north):.3f} m away, {up:+.3f} m up: "
                "one of the two fixes is false, or the tripod was moved"
            )
    return agreeing, fault


def _within_mads(enu_m: Array, considered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Epochs within CLIP_MADS robust sigma of the median of those considered, on every axis."""
    median = np.median(enu_m[considered], axis=0)
    sigma = MAD_TO_SIGMA * np.median(np.abs(enu_m[considered] - median), axis=0)
    # A receiver that repeats itself has no scatter at all; a millimetre keeps the rounding of its digits in.
    within: NDArray[np.bool_] = np.all(np.abs(enu_m - median) <= CLIP_MADS * np.maximum(sigma, 1e-3), axis=1)
    return within


def _scatter(enu_m: Array, duration_s: float, service: Service) -> Array:
    """(3,) sigma of the mean from the fast part of the error: prior and window weighed by what the window holds."""
    share = variance_share(duration_s)
    seen = (enu_m.std(axis=0)) ** 2 / max(1 - share, 1e-9)
    weight = duration_s / (2 * TAU_S)
    variance = (PRIOR_WEIGHT * np.array(service.sigma_m) ** 2 + weight * seen) / (PRIOR_WEIGHT + weight)
    scatter: Array = np.sqrt(variance * share)
    return scatter


class _Drift(NamedTuple):
    """Why this is no antenna at rest, and until when it was not."""

    fault: str
    until_s: float


def _drift(t_s: Array, enu_m: Array, service: Service) -> _Drift | None:
    """Block medians over all lags, compared with what the model's error does in that time."""
    if len(t_s) < MIN_SAMPLES:
        return None
    blocks = np.floor((t_s - t_s[0]) / DRIFT_BLOCK_S).astype(np.int64)
    edges = np.flatnonzero(np.diff(blocks)) + 1
    times = np.array([part.mean() for part in np.split(t_s, edges)])
    medians = np.array([np.median(part, axis=0) for part in np.split(enu_m, edges)])
    noise = np.minimum(_step_noise(enu_m), MAX_STEP_NOISE_M)
    lag = 1
    while lag < len(times):
        moved = np.abs(medians[lag:] - medians[:-lag])
        allowed = DRIFT_SIGMAS * np.sqrt(_increment_variance(times[lag:] - times[:-lag], service) + 2 * noise**2)
        excess = (moved / allowed).max(axis=1)
        if np.any(excess > 1):
            worst, last = int(np.argmax(excess)), int(np.flatnonzero(excess > 1)[-1])
            distance_m = float(np.linalg.norm(medians[worst + lag] - medians[worst]))
            fault = (
                f"it moved {distance_m:.3f} m within {times[worst + lag] - times[worst]:.0f} s: "
                "not a fixed solution of an antenna at rest"
            )
            return _Drift(fault, float(times[last + lag]))
        lag *= 2
    return None


def _step_noise(enu_m: Array) -> Array:
    """(3,) white noise between epochs, from the median of their second differences, which no steady drift enlarges."""
    noise: Array = MAD_TO_SIGMA * np.median(np.abs(np.diff(enu_m, 2, axis=0)), axis=0) / math.sqrt(6)
    return noise


def _increment_variance(lag_s: Array, service: Service) -> Array:
    """(N, 3) variance of the difference of two epochs lag_s (N,) apart, by the model."""
    fast = 2 * (1 - np.exp(-lag_s / TAU_S))[:, None] * np.array(service.sigma_m) ** 2
    slow = 2 * (1 - np.exp(-lag_s / SLOW_TAU_S))[:, None] * np.array(service.floor_m) ** 2
    variance: Array = fast + slow
    return variance


def _warnings(enu_m: Array, step_m: tuple[float, float]) -> tuple[str, ...]:
    found = []
    same = np.all(np.diff(enu_m, axis=0) == 0, axis=1)
    breaks = np.flatnonzero(np.concatenate(([True], ~same, [True])))
    if len(enu_m) > HOLD_EPOCHS and np.diff(breaks).max() >= HOLD_EPOCHS:
        found.append("identical coordinates epoch after epoch: switch the receiver's static hold off")
    if step_m[1] >= 0.05:
        found.append("altitude comes with one decimal only: make the receiver send two or more")
    return tuple(found)

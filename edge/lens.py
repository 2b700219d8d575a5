"""Lens models: raw pixel <-> undistorted ray, vectorised, with the derivatives the adjustment needs.

The hazard is the inverse. A lens polynomial is only meant for the image it was fitted on; beyond some radius it turns
back, and an inverse iterated a fixed number of times returns a plausible wrong ray (OpenCV's default five steps are
1 px off in the corner of a wide lens). Here the inverse is Newton's, on the true derivative, run until it has
converged, and a pixel the model cannot explain comes back as NaN rather than as a guess.

Within, a ray is the complex number x + iy: a bend is then a factor, a tangential shift a square, and a derivative two
numbers, `along` the change and `across` its conjugate. That is half of the work, and a box does it for every frame.

Pixel origin: the centre of the top-left pixel. Ray: (x, y) with z = 1, x right, y down, z forward.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import LensError

Complex = NDArray[np.complex128]

NEWTON_STEPS: Final = 80  # 5 suffice; a damped way from the first guess to 87 degrees off the axis takes 60
CONVERGED_RAY: Final = 1e-12  # ray units: 1e-9 px at 1000 px focal length
CONVERGED_PLACE: Final = 1e-9  # ray units: further from its target a ray is another's
LONGEST_STEP_RAY: Final = 0.25  # ray units a step: keeps Newton on the branch that holds the optical axis
REACH_MARGIN: Final = 1.1  # the fold is looked for along one axis; decentring moves it by a few per cent
NO_RAY: Final = complex(np.nan, np.nan)
COEFFICIENTS: Final = {"radtan": (4, 5, 8), "fisheye": (4,)}


@dataclass(frozen=True)
class LensModel:
    """A camera's lens.

    intrinsics: fx, fy, cx, cy in pixels. distortion: OpenCV's order, radtan k1 k2 p1 p2 [k3 [k4 k5 k6]], fisheye
    k1 k2 k3 k4 of theta. focal_sigma_px: one sigma of fx and fy as the lens report says, None if it says nothing.
    Raises LensError if the numbers cannot be a lens.
    """

    model: Literal["radtan", "fisheye"]
    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, ...]
    size_px: tuple[int, int]
    rms_px: float = 0.0
    focal_sigma_px: float | None = None

    def __post_init__(self) -> None:
        if self.model not in COEFFICIENTS:
            raise LensError(f"unknown model {self.model!r}", where="lens", action='use "radtan" or "fisheye"')
        if len(self.distortion) not in COEFFICIENTS[self.model]:
            allowed = " or ".join(map(str, COEFFICIENTS[self.model]))
            raise LensError(
                f"{self.model} with {len(self.distortion)} coefficients", where="lens", action=f"give {allowed}"
            )
        numbers = (*self.intrinsics, *self.distortion)
        if len(self.intrinsics) != 4 or not np.all(np.isfinite(numbers)) or min(self.intrinsics[:2]) <= 0:
            raise LensError(
                f"intrinsics {self.intrinsics} are no lens", where="lens", action="give finite fx, fy > 0 and cx, cy"
            )

    def refined(self, change: Array) -> "LensModel":
        """This lens with `change` (fx, fy, cx, cy, k1) added."""
        fx, fy, cx, cy = (float(a + b) for a, b in zip(self.intrinsics, change[:4], strict=True))
        distortion = (self.distortion[0] + float(change[4]), *self.distortion[1:])
        return replace(self, intrinsics=(fx, fy, cx, cy), distortion=distortion)


@dataclass(frozen=True)
class Distorted:
    """Distorted normalised coordinates (N, 2), their derivative by the ray (N, 2, 2) and by k1 (N, 2)."""

    xy: Array
    by_ray: Array
    by_k1: Array


@dataclass(frozen=True)
class _Bent:
    """Where rays (N,) come to lie, (N,); a change d of one moves it by `along` d + `across` conj(d). by_k1: (N,)."""

    place: Complex
    along: Complex
    across: Complex
    by_k1: Complex


def distort(lens: LensModel, rays: Array) -> Distorted:
    """Distort rays. rays: (N, 2)."""
    bent = _bend(lens, _as_complex(rays))
    by_ray = np.empty((len(bent.place), 2, 2))
    by_ray[:, :, 0] = _as_pairs(bent.along + bent.across)
    by_ray[:, :, 1] = _as_pairs(1j * (bent.along - bent.across))
    return Distorted(_as_pairs(bent.place), by_ray, _as_pairs(bent.by_k1))


def ray_to_pixel(lens: LensModel, rays: Array) -> Array:
    """Raw pixels (N, 2) of rays (N, 2)."""
    fx, fy, cx, cy = lens.intrinsics
    return _as_pairs(_bend(lens, _as_complex(rays)).place) * (fx, fy) + (cx, cy)


def pixel_to_ray(lens: LensModel, pixels: Array) -> Array:
    """Undistorted rays (N, 2) of raw pixels (N, 2); NaN where the lens model has no such ray."""
    fx, fy, cx, cy = lens.intrinsics
    target = (np.asarray(pixels, float).reshape(-1, 2) - (cx, cy)) / (fx, fy)
    if not any(lens.distortion) and lens.model == "radtan":
        return target
    place = _as_complex(target)
    beyond = np.abs(place) > _reach(lens)
    place[beyond] = 0
    rays = _newton(lens, _first_guess(lens, place), place)
    rays[beyond] = NO_RAY
    return _as_pairs(rays)


def _as_complex(pairs: Array) -> Complex:
    """(N, 2) as (N,), a copy only where it has to be one."""
    return np.ascontiguousarray(pairs, np.float64).view(np.complex128).reshape(-1)


def _as_pairs(numbers: Complex) -> Array:
    """(N,) as (N, 2)."""
    return numbers.view(np.float64).reshape(-1, 2)


def _newton(lens: LensModel, rays: Complex, target: Complex) -> Complex:
    """Rays (N,) whose distorted place is the target (N,); NaN where none is reached from those to begin with."""
    for _ in range(NEWTON_STEPS):
        at = _bend(lens, rays)
        off, determinant = target - at.place, _squared(at.along) - _squared(at.across)
        # A factor and no divisor: complex numbers that are none, as rays behind a camera, divide with a warning.
        factor = 1 / np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
        step = (at.along.conj() * off - at.across * off.conj()) * factor
        length = np.abs(step)
        if not (length > CONVERGED_RAY).any():
            break
        rays = rays + step * np.minimum(1.0, LONGEST_STEP_RAY / np.maximum(length, CONVERGED_RAY))
    found = (np.abs(off) < CONVERGED_PLACE) & (determinant > 0)
    return np.where(found, rays, NO_RAY)


def _squared(numbers: Complex) -> Array:
    """Their squared lengths."""
    return numbers.real**2 + numbers.imag**2


@lru_cache(maxsize=64)
def _reach(lens: LensModel) -> float:
    """How far from the axis, in distorted units, any ray can fall: what is beyond need not be searched for."""
    rays = np.concatenate([np.linspace(0, 3, 601)[1:], np.geomspace(3, 1e3, 400)])
    along = distort(lens, np.stack([rays, np.zeros_like(rays)], axis=1))
    folded = np.flatnonzero(along.by_ray[:, 0, 0] <= 0)
    if not len(folded):
        return np.inf
    return REACH_MARGIN * float(along.xy[: folded[0] + 1, 0].max()) + REACH_MARGIN - 1


def _first_guess(lens: LensModel, target: Complex) -> Complex:
    if lens.model == "radtan":
        return target
    theta = np.abs(target)
    bounded = np.minimum(theta, 1.4)  # rad: the tangent of more would start Newton out of reach
    return target * np.where(theta > 0, np.tan(bounded) / np.maximum(theta, 1e-12), 1.0)


def _bend(lens: LensModel, rays: Complex) -> _Bent:
    return _bend_radtan(lens, rays) if lens.model == "radtan" else _bend_fisheye(lens, rays)


def _bend_radtan(lens: LensModel, rays: Complex) -> _Bent:
    """Brown (1966) with OpenCV's rational extension."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.distortion, *(0.0,) * (8 - len(lens.distortion)))
    r2 = _squared(rays)
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)  # of radial, by r2
    by_k1 = rays * r2
    if k4 or k5 or k6:
        share = 1 / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = radial * share
        slope = (slope - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) * share
        by_k1 = by_k1 * share
    square = rays * rays
    place, along, across = rays * radial, (radial + r2 * slope).astype(np.complex128), square * slope
    if p1 or p2:
        off = complex(p2, p1)
        towards = rays * off.conjugate()
        place = place + square * off.conjugate() + 2 * off * r2
        along, across = along + 4 * towards.real, across + 2 * off * rays
    return _Bent(place, along, across, by_k1)


def _bend_fisheye(lens: LensModel, rays: Complex) -> _Bent:
    """Kannala and Brandt (2006), OpenCV's four odd powers of theta."""
    k1, k2, k3, k4 = lens.distortion
    r = np.maximum(np.abs(rays), 1e-12)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))) / (1 + r * r)
    unit, scale = rays * (1 / r), bent / r
    return _Bent(
        rays * scale,
        ((slope + scale) / 2).astype(np.complex128),
        unit * unit * ((slope - scale) / 2),
        unit * (theta * t2),
    )

"""Lens models: raw pixel <-> undistorted ray, vectorised, with the derivatives the adjustment needs.

The hazard is the inverse. A lens polynomial is only meant for the image it was fitted on; beyond some radius it turns
back, and an inverse iterated a fixed number of times returns a plausible wrong ray (OpenCV's default five steps are
1 px off in the corner of a wide lens). Here the inverse is Newton's, on the true derivative, run until it has
converged, and a pixel the model cannot explain comes back as NaN rather than as a guess.

Pixel origin: the centre of the top-left pixel. Ray: (x, y) with z = 1, x right, y down, z forward.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from edge.errors import LensError, SkyfixError

__all__ = ["Array", "LensError", "LensModel", "SkyfixError", "pixel_to_ray", "ray_to_pixel"]

Array = NDArray[np.float64]

NEWTON_STEPS: Final = 60  # a damped step may be short near the fold; 8 suffice elsewhere
CONVERGED_RAY: Final = 1e-12  # ray units: 1e-9 px at 1000 px focal length
LONGEST_STEP_RAY: Final = 0.25  # ray units a step: keeps Newton on the branch that holds the optical axis
REACH_MARGIN: Final = 1.1  # the fold is looked for along one axis; decentring moves it by a few per cent
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


def distort(lens: LensModel, rays: Array) -> Distorted:
    """Distort rays. rays: (N, 2)."""
    return _distort_radtan(lens, rays) if lens.model == "radtan" else _distort_fisheye(lens, rays)


def ray_to_pixel(lens: LensModel, rays: Array) -> Array:
    """Raw pixels (N, 2) of rays (N, 2)."""
    fx, fy, cx, cy = lens.intrinsics
    return distort(lens, rays).xy * (fx, fy) + (cx, cy)


def pixel_to_ray(lens: LensModel, pixels: Array) -> Array:
    """Undistorted rays (N, 2) of raw pixels (N, 2); NaN where the lens model has no such ray."""
    fx, fy, cx, cy = lens.intrinsics
    target = (np.asarray(pixels, float).reshape(-1, 2) - (cx, cy)) / (fx, fy)
    if not any(lens.distortion) and lens.model == "radtan":
        return target
    beyond = np.hypot(target[:, 0], target[:, 1]) > _reach(lens)
    rays = _first_guess(lens, np.where(beyond[:, None], 0.0, target))
    return np.where(beyond[:, None], np.nan, _newton(lens, rays, np.where(beyond[:, None], 0.0, target)))


def _newton(lens: LensModel, rays: Array, target: Array) -> Array:
    """Rays (N, 2) whose distorted place is the target (N, 2); NaN where none is reached from those to begin with."""
    for _ in range(NEWTON_STEPS):
        at = distort(lens, rays)
        step = _solve_2x2(at.by_ray, target - at.xy)
        length = np.hypot(step[:, 0], step[:, 1])[:, None]
        if not np.any(length > CONVERGED_RAY):
            break
        rays = rays + step * np.minimum(1.0, LONGEST_STEP_RAY / np.maximum(length, CONVERGED_RAY))
    else:
        at = distort(lens, rays)
    wrong = ~(np.abs(at.xy - target).max(axis=1) < 1e-9) | ~(np.linalg.det(at.by_ray) > 0)
    return np.where(wrong[:, None], np.nan, rays)


@lru_cache(maxsize=64)
def _reach(lens: LensModel) -> float:
    """How far from the axis, in distorted units, any ray can fall: what is beyond need not be searched for."""
    rays = np.concatenate([np.linspace(0, 3, 601)[1:], np.geomspace(3, 1e3, 400)])
    along = distort(lens, np.stack([rays, np.zeros_like(rays)], axis=1))
    folded = np.flatnonzero(along.by_ray[:, 0, 0] <= 0)
    if not len(folded):
        return np.inf
    return REACH_MARGIN * float(along.xy[: folded[0] + 1, 0].max()) + REACH_MARGIN - 1


def _first_guess(lens: LensModel, target: Array) -> Array:
    if lens.model == "radtan":
        return target.copy()
    theta = np.linalg.norm(target, axis=1, keepdims=True)
    bounded = np.minimum(theta, 1.4)  # rad: the tangent of more would start Newton out of reach
    return target * np.where(theta > 0, np.tan(bounded) / np.maximum(theta, 1e-12), 1.0)


def _solve_2x2(matrix: Array, right: Array) -> Array:
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    determinant = a * d - b * c
    determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
    x = (d * right[:, 0] - b * right[:, 1]) / determinant
    y = (a * right[:, 1] - c * right[:, 0]) / determinant
    return np.stack([x, y], axis=1)


def _distort_radtan(lens: LensModel, rays: Array) -> Distorted:
    """Brown (1966) with OpenCV's rational extension."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.distortion, *(0.0,) * (8 - len(lens.distortion)))
    x, y = rays[:, 0], rays[:, 1]
    r2 = x * x + y * y
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = above / below
    # d radial / d r2
    slope = (k1 + r2 * (2 * k2 + 3 * r2 * k3) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / below
    xy = np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
        axis=1,
    )
    cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    by_ray = np.empty((len(rays), 2, 2))
    by_ray[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_ray[:, 0, 1] = by_ray[:, 1, 0] = cross
    by_ray[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return Distorted(xy, by_ray, rays * (r2 / below)[:, None])


def _distort_fisheye(lens: LensModel, rays: Array) -> Distorted:
    """Kannala and Brandt (2006), OpenCV's four odd powers of theta."""
    k1, k2, k3, k4 = lens.distortion
    r = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))) / (1 + r * r)
    unit = rays / r[:, None]
    scale = bent / r
    outer = unit[:, :, None] * unit[:, None, :]
    by_ray = scale[:, None, None] * (np.eye(2) - outer) + slope[:, None, None] * outer
    return Distorted(rays * scale[:, None], by_ray, unit * (theta * t2)[:, None])

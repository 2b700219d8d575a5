"""A lens: raw pixel <-> undistorted ray, vectorised, with the derivatives the adjustment needs.

The hazard is the inverse. A lens polynomial is only meant for the image it was fitted on; beyond some radius it turns
back, and an inverse iterated a fixed number of times returns a plausible wrong ray (OpenCV's default five steps are
1 px off in the corner of a wide lens). Here the inverse is Newton's, on the true derivative, run until it has
converged, and a pixel the model cannot explain comes back as NaN rather than as a guess.

Within, a ray is the complex number x + iy: a bend is then a factor, a tangential shift a square, and a derivative two
numbers, `along` the change and `across` its conjugate. That is half of the work, and a box does it for every frame.

Pixel origin: the centre of the top-left pixel. Ray: (x, y) with z = 1, x right, y down, z forward.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Protocol

import numpy as np

from edge.common.arrays import Array
from edge.common.errors import LensError
from edge.lens.kinds import LENS_KINDS, Bent, Complex, Kind, squared

NEWTON_STEPS: Final = 80  # 5 suffice; a damped way from the first guess to 87 degrees off the axis takes 60
CONVERGED_RAY: Final = 1e-12  # ray units: 1e-9 px at 1000 px focal length
CONVERGED_PLACE: Final = 1e-9  # ray units: further from its target a ray is another's
LONGEST_STEP_RAY: Final = 0.25  # ray units a step: keeps Newton on the branch that holds the optical axis
REACH_MARGIN: Final = 1.1  # the fold is looked for along one axis; decentring moves it by a few per cent
NO_RAY: Final = complex(np.nan, np.nan)


class LensNumbers(Protocol):
    """What describes a lens on the wire and in a configuration."""

    @property
    def model(self) -> str:
        """Name of the lens model."""

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy, pixels."""

    @property
    def distortion(self) -> Sequence[float]:
        """The model's coefficients."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width, height."""

    @property
    def rms_px(self) -> float:
        """Of the measurement."""

    @property
    def focal_sigma_px(self) -> float | None:
        """One sigma of fx and fy."""


@dataclass(frozen=True)
class LensModel:
    """A camera's lens.

    model: a name of LENS_KINDS. intrinsics: fx, fy, cx, cy in pixels. distortion: the model's coefficients, for radtan
    and fisheye in OpenCV's order. focal_sigma_px: one sigma of fx and fy as the lens report says, None if it says none.
    Raises LensError if the numbers cannot be a lens.
    """

    model: str
    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, ...]
    size_px: tuple[int, int]
    rms_px: float = 0.0
    focal_sigma_px: float | None = None

    def __post_init__(self) -> None:
        if self.model not in LENS_KINDS:
            known = " or ".join(f'"{name}"' for name in LENS_KINDS)
            raise LensError(f"unknown model {self.model!r}", where="lens", action=f"use {known}")
        if len(self.distortion) not in self.kind.coefficients:
            allowed = " or ".join(map(str, self.kind.coefficients))
            raise LensError(
                f"{self.model} with {len(self.distortion)} coefficients", where="lens", action=f"give {allowed}"
            )
        numbers = (*self.intrinsics, *self.distortion)
        if len(self.intrinsics) != 4 or not np.all(np.isfinite(numbers)) or min(self.intrinsics[:2]) <= 0:
            raise LensError(
                f"intrinsics {self.intrinsics} are no lens", where="lens", action="give finite fx, fy > 0 and cx, cy"
            )

    @classmethod
    def of(cls, numbers: LensNumbers) -> "LensModel":
        """The lens that a message or a configuration describes. Raises LensError."""
        return cls(
            numbers.model,
            numbers.intrinsics,
            tuple(numbers.distortion),
            numbers.size_px,
            numbers.rms_px,
            numbers.focal_sigma_px,
        )

    @property
    def kind(self) -> Kind:
        """What its model does."""
        return LENS_KINDS[self.model]

    @property
    def is_pinhole(self) -> bool:
        """Whether it bends nothing."""
        return self.kind.is_pinhole(self.distortion)

    @property
    def refined_coefficient(self) -> float:
        """The coefficient of its distortion that the adjustment refines."""
        return self.distortion[self.kind.refined]

    def refined(self, change: Array) -> "LensModel":
        """This lens with `change` (fx, fy, cx, cy, the refined coefficient) added."""
        fx, fy, cx, cy = (float(a + b) for a, b in zip(self.intrinsics, change[:4], strict=True))
        distortion = list(self.distortion)
        distortion[self.kind.refined] += float(change[4])
        return replace(self, intrinsics=(fx, fy, cx, cy), distortion=tuple(distortion))


@dataclass(frozen=True)
class Distorted:
    """Distorted normalised coordinates (N, 2), their derivative by the ray (N, 2, 2).

    by_coefficient: (N, 2) by the coefficient that is refined.
    """

    xy: Array
    by_ray: Array
    by_coefficient: Array


def distort(lens: LensModel, rays: Array) -> Distorted:
    """Distort rays. rays: (N, 2)."""
    bent = _bend(lens, _as_complex(rays))
    by_ray = np.empty((len(bent.place), 2, 2))
    by_ray[:, :, 0] = _as_pairs(bent.along + bent.across)
    by_ray[:, :, 1] = _as_pairs(1j * (bent.along - bent.across))
    return Distorted(_as_pairs(bent.place), by_ray, _as_pairs(bent.by_coefficient))


def ray_to_pixel(lens: LensModel, rays: Array) -> Array:
    """Raw pixels (N, 2) of rays (N, 2)."""
    fx, fy, cx, cy = lens.intrinsics
    return _as_pairs(_bend(lens, _as_complex(rays)).place) * (fx, fy) + (cx, cy)


def pixel_to_ray(lens: LensModel, pixels: Array) -> Array:
    """Undistorted rays (N, 2) of raw pixels (N, 2); NaN where the lens model has no such ray."""
    fx, fy, cx, cy = lens.intrinsics
    target = (np.asarray(pixels, float).reshape(-1, 2) - (cx, cy)) / (fx, fy)
    if lens.is_pinhole:
        return target
    place = _as_complex(target)
    beyond = np.abs(place) > _reach(lens)
    place[beyond] = 0
    rays = _newton(lens, lens.kind.first_guess(place), place)
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
        off, determinant = target - at.place, squared(at.along) - squared(at.across)
        # A factor and no divisor: complex numbers that are none, as rays behind a camera, divide with a warning.
        factor = 1 / np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
        step = (at.along.conj() * off - at.across * off.conj()) * factor
        length = np.abs(step)
        if not (length > CONVERGED_RAY).any():
            break
        rays = rays + step * np.minimum(1.0, LONGEST_STEP_RAY / np.maximum(length, CONVERGED_RAY))
    found = (np.abs(off) < CONVERGED_PLACE) & (determinant > 0)
    return np.where(found, rays, NO_RAY)


@lru_cache(maxsize=64)
def _reach(lens: LensModel) -> float:
    """How far from the axis, in distorted units, any ray can fall: what is beyond need not be searched for."""
    rays = np.concatenate([np.linspace(0, 3, 601)[1:], np.geomspace(3, 1e3, 400)])
    along = distort(lens, np.stack([rays, np.zeros_like(rays)], axis=1))
    folded = np.flatnonzero(along.by_ray[:, 0, 0] <= 0)
    if not len(folded):
        return np.inf
    return REACH_MARGIN * float(along.xy[: folded[0] + 1, 0].max()) + REACH_MARGIN - 1


def _bend(lens: LensModel, rays: Complex) -> Bent:
    return lens.kind.bend(lens.distortion, rays)

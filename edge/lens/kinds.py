"""The lens models there are. Each is one class, and LENS_KINDS is the one list of them.

A new one is a class and its line in that list: messages, configurations, site files and the command line read the names
there. What a kind does not say it inherits from Kind.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.common.errors import LensError
from edge.common.plugs import check_name, name_among

Complex = NDArray[np.complex128]
Coefficients = tuple[float, ...]

STEEPEST_GUESS_RAD: Final = 1.4  # the tangent of more would start Newton out of reach
FISHEYE_STEPS: Final = 200  # of OpenCV's fit, which is at rest after 20 to 50
FISHEYE_AT_REST: Final = 1e-9  # relative change of the parameters


@dataclass(frozen=True)
class Bent:
    """Where rays (N,) come to lie, (N,); a change d of one moves it by `along` d + `across` conj(d).

    by_coefficient: (N,) derivative by the coefficient that is refined.
    """

    place: Complex
    along: Complex
    across: Complex
    by_coefficient: Complex


@dataclass(frozen=True)
class BoardFit:
    """A camera fitted to views of boards: fx, fy, cx, cy, the coefficients, and each view's turn and shift (3,)."""

    intrinsics: tuple[float, float, float, float]
    distortion: Coefficients
    poses: list[tuple[Array, Array]]


class Kind(ABC):
    """A lens model. Rays and places are complex numbers x + iy of the plane z = 1 and of normalised image coordinates.

    coefficients: how many it may have, ascending. refined: which of them the adjustment refines, with its name and how
    far that of a lens file is to be trusted, one sigma.
    """

    name: ClassVar[str]
    coefficients: ClassVar[tuple[int, ...]]
    refined: ClassVar[int] = 0
    refined_name: ClassVar[str] = "k1"
    refined_sigma: ClassVar[float] = 0.01  # moves a pixel at 0.5 ray units by 1e-3 of the focal length

    @abstractmethod
    def bend(self, distortion: Coefficients, rays: Complex) -> Bent:
        """Where rays (N,) come to lie, with derivatives."""

    def first_guess(self, target: Complex) -> Complex:
        """Rays (N,) from which Newton's method finds those of the places (N,)."""
        return target

    def is_pinhole(self, distortion: Coefficients) -> bool:
        """Whether rays come to lie where they are."""
        return False

    def fit(
        self, boards_mm: Sequence[Array], corners_px: Sequence[Array], size_px: tuple[int, int], coefficients: int
    ) -> BoardFit:
        """Zhang's method: the lens that shows flat boards (N, 3) at pixels (N, 2). Raises LensError, or OpenCV's."""
        raise LensError(
            f"a {self.name} lens is not measured from pictures by this program",
            where="--model",
            action=f"write the lens file by hand, or measure it as one of {', '.join(measured_names())}",
        )


class Radtan(Kind):
    """Brown (1966) with OpenCV's rational extension: k1 k2 p1 p2 [k3 [k4 k5 k6]]."""

    name = "radtan"
    coefficients = (4, 5, 8)

    def bend(self, distortion: Coefficients, rays: Complex) -> Bent:
        """A polynomial, or a quotient of two, in the squared distance from the axis, and a decentring."""
        k1, k2, p1, p2, k3, k4, k5, k6 = (*distortion, *(0.0,) * (8 - len(distortion)))
        r2 = squared(rays)
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
        return Bent(place, along, across, by_k1)

    def is_pinhole(self, distortion: Coefficients) -> bool:
        """Without coefficients there is nothing that bends."""
        return not any(distortion)

    def fit(
        self, boards_mm: Sequence[Array], corners_px: Sequence[Array], size_px: tuple[int, int], coefficients: int
    ) -> BoardFit:
        """By OpenCV, with the first so many of its coefficients free."""
        import cv2  # noqa: PLC0415  # 60 MB that only a measurement of a lens needs

        flags = {4: cv2.CALIB_FIX_K3, 5: 0, 8: cv2.CALIB_RATIONAL_MODEL}[coefficients]
        boards = [board.astype(np.float32) for board in boards_mm]
        corners = [corner.astype(np.float32) for corner in corners_px]
        _, matrix, found, turns, shifts = cv2.calibrateCamera(boards, corners, size_px, None, None, flags=flags)
        return _board_fit(matrix, np.asarray(found).ravel()[:coefficients], turns, shifts)


class Fisheye(Kind):
    """Kannala and Brandt (2006), OpenCV's four odd powers of the angle from the axis: k1 k2 k3 k4."""

    name = "fisheye"
    coefficients = (4,)

    def bend(self, distortion: Coefficients, rays: Complex) -> Bent:
        """A polynomial in the angle."""
        k1, k2, k3, k4 = distortion
        r = np.maximum(np.abs(rays), 1e-12)
        theta = np.arctan(r)
        t2 = theta * theta
        bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        slope = (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))) / (1 + r * r)
        unit, scale = rays * (1 / r), bent / r
        return Bent(
            rays * scale,
            ((slope + scale) / 2).astype(np.complex128),
            unit * unit * ((slope - scale) / 2),
            unit * (theta * t2),
        )

    def first_guess(self, target: Complex) -> Complex:
        """As if the angle were not bent at all."""
        theta = np.abs(target)
        bounded = np.minimum(theta, STEEPEST_GUESS_RAD)
        return target * np.where(theta > 0, np.tan(bounded) / np.maximum(theta, 1e-12), 1.0)

    def fit(
        self, boards_mm: Sequence[Array], corners_px: Sequence[Array], size_px: tuple[int, int], coefficients: int
    ) -> BoardFit:
        """By OpenCV's own fisheye module."""
        import cv2  # noqa: PLC0415  # 60 MB that only a measurement of a lens needs

        boards = [board.reshape(1, -1, 3) for board in boards_mm]
        corners = [corner.reshape(1, -1, 2) for corner in corners_px]
        guess = np.array([[size_px[0] / 3, 0, size_px[0] / 2], [0, size_px[0] / 3, size_px[1] / 2], [0, 0, 1.0]])
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, FISHEYE_STEPS, FISHEYE_AT_REST)
        start = np.zeros(coefficients)
        found = cv2.fisheye.calibrate(boards, corners, size_px, guess, start, flags=flags, criteria=criteria)
        return _board_fit(*found[1:])


LENS_KINDS: Final[dict[str, Kind]] = {kind.name: kind for kind in (Radtan(), Fisheye())}
DEFAULT_LENS: Final = Radtan.name

# The name of a lens model in a message or file. A struct that holds one asks check_lens_name in its __post_init__.
LensName = Annotated[str, name_among(LENS_KINDS)]


def check_lens_name(field: str, name: str) -> None:
    """Raises ValueError for the name of no lens model."""
    check_name(field, name, LENS_KINDS)


def measured_names() -> list[str]:
    """Names of the lens models that can be measured from pictures of a board."""
    return sorted(name for name, kind in LENS_KINDS.items() if type(kind).fit is not Kind.fit)


def squared(numbers: Complex) -> Array:
    """Their squared lengths."""
    return numbers.real**2 + numbers.imag**2


def _board_fit(matrix: object, distortion: object, turns: Sequence[object], shifts: Sequence[object]) -> BoardFit:
    camera = np.asarray(matrix, float)
    turned, shifted = ([np.asarray(each, float).ravel() for each in vectors] for vectors in (turns, shifts))
    return BoardFit(
        (float(camera[0, 0]), float(camera[1, 1]), float(camera[0, 2]), float(camera[1, 2])),
        tuple(np.asarray(distortion, float).ravel().tolist()),
        list(zip(turned, shifted, strict=True)),
    )

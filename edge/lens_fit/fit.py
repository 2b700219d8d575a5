"""A lens from pictures of a flat board (Zhang 2000), and how far to trust it.

The residual of a calibration says how well it explains the pictures it was made from, and falls with every parameter
that is added. So the lens is also judged on pictures that were held out, the number of distortion coefficients is
chosen by that, and the spread of the focal length between the fits with one part of the pictures left out (the
delete-a-group jackknife, Shao and Wu 1989) is its sigma. Pictures that fit far worse than the others are left out, one
at a time, and named.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from edge.common.arrays import Array
from edge.common.errors import LensError
from edge.lens import LENS_KINDS, LensModel, pixel_to_ray, ray_to_pixel
from edge.lens_fit.boards import BoardView

FEWEST_VIEWS: Final = 6  # below, focal length and distortion are not told apart
OUTLIER_RATIO: Final = 2.5  # times the median rms of a view: a blurred or bent board
OUTLIER_FLOOR_PX: Final = 0.3  # px: no view as good as this is called an outlier
MOST_REJECTED: Final = 1 / 3  # of the views: if more are bad, it is the model that is wrong
FOLDS: Final = 5
WORTH_IT: Final = 0.98  # a larger model must lower the held-out rms below this share
COVERAGE_GRID: Final = (8, 6)  # columns, rows of the coverage map


@dataclass(frozen=True)
class LensFit:
    """A measured lens. rms_px: of the views used. held_out_rms_px: of views that a fit had not seen. view_rms_px: by
    name. rejected: name to reason. coverage: `(rows, columns)` corners seen in each part of the image."""

    lens: LensModel
    rms_px: float
    held_out_rms_px: float
    view_rms_px: dict[str, float]
    rejected: dict[str, str]
    coverage: Array


@dataclass(frozen=True)
class _LensFit:
    lens: LensModel
    view_rms: Array

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.view_rms**2)))


def fit_lens(views: Sequence[BoardView], size_px: tuple[int, int], model: str) -> LensFit:
    """The lens that views of a board show. size_px: width, height of the pictures. Raises LensError if too few."""
    used = list(views)
    rejected: dict[str, str] = {}
    _need(used)
    # With the most flexible model first: a picture is only bad if even that cannot explain it, and one bad picture
    # left in would make every choice of a model for the rest of them.
    _reject(used, rejected, size_px, model, max(LENS_KINDS[model].coefficients))
    coefficients = _choose(used, size_px, model)
    fit = _reject(used, rejected, size_px, model, coefficients)
    held_out, focal_sigma = _cross_validate(used, size_px, model, coefficients)
    lens = LensModel(
        model, fit.lens.intrinsics, fit.lens.distortion, size_px, rms_px=fit.rms, focal_sigma_px=focal_sigma
    )
    by_name = {view.name: float(rms) for view, rms in zip(used, fit.view_rms, strict=True)}
    return LensFit(lens, fit.rms, held_out, by_name, rejected, coverage(used, size_px))


def _reject(
    used: list[BoardView], rejected: dict[str, str], size_px: tuple[int, int], model: str, coefficients: int
) -> _LensFit:
    """Fit, moving the worst views from used to rejected one at a time until none is far worse than the others."""
    most = MOST_REJECTED * (len(used) + len(rejected))
    while True:
        fit = _calibrate(used, size_px, model, coefficients)
        worst, median = int(np.argmax(fit.view_rms)), float(np.median(fit.view_rms))
        good = fit.view_rms[worst] <= max(OUTLIER_FLOOR_PX, OUTLIER_RATIO * median)
        if good or len(rejected) >= most or len(used) <= FEWEST_VIEWS:
            return fit
        rejected[used[worst].name] = f"rms {fit.view_rms[worst]:.2f} px, the others' median {median:.2f} px"
        del used[worst]


def _need(views: Sequence[BoardView]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise LensError(
            f"the board was found in {len(views)} pictures, {FEWEST_VIEWS} are needed",
            where="pictures of the board",
            action="take more, sharp, with the board tilted and in every corner of the image; check --board",
        )


def _choose(views: Sequence[BoardView], size_px: tuple[int, int], model: str) -> int:
    """The fewest coefficients that held-out views ask for."""
    best, *others = LENS_KINDS[model].coefficients
    if not others:
        return best
    best_rms = _cross_validate(views, size_px, model, best)[0]
    for coefficients in others:
        rms = _cross_validate(views, size_px, model, coefficients)[0]
        if rms < WORTH_IT * best_rms:
            best, best_rms = coefficients, rms
    return best


def _calibrate(views: Sequence[BoardView], size_px: tuple[int, int], model: str, coefficients: int) -> _LensFit:
    """Zhang's method as the lens model does it; the residuals are taken again with our own lens model.

    Each in the pose of the fit, from the board to the picture: while a bad picture is still among them the fitted lens
    may be one that has no ray for a good one's corners, and the good one would be blamed.
    """
    try:
        boards, corners = [view.board_mm for view in views], [view.image_px for view in views]
        found = LENS_KINDS[model].fit(boards, corners, size_px, coefficients)
    except cv2.error as error:
        action = "take more pictures, with the board tilted and nearer the corners"
        raise LensError(
            f"the fit does not converge ({error.err})", where="pictures of the board", action=action
        ) from error
    lens = LensModel(model, found.intrinsics, found.distortion, size_px)
    return _LensFit(lens, np.array([_rms(lens, view, *pose) for view, pose in zip(views, found.poses, strict=True)]))


def _held_out_rms(lens: LensModel, view: BoardView) -> float:
    """How well a lens explains a view it was not fitted to, its pose alone fitted: rms distance of the corners, px."""
    # The corners' rays make it a pinhole problem; where the lens has no ray for a corner, it explains nothing.
    rays = pixel_to_ray(lens, view.image_px)
    if not np.isfinite(rays).all():
        return float("inf")
    _, turn, shift = cv2.solvePnP(view.board_mm, rays, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_ITERATIVE)
    return _rms(lens, view, np.asarray(turn, float), np.asarray(shift, float).ravel())


def _rms(lens: LensModel, view: BoardView, turn: Array, shift: Array) -> float:
    """Rms distance of a view's corners, px, from where a lens sees those of a board turned (Rodrigues) and shifted."""
    in_camera = view.board_mm @ np.asarray(cv2.Rodrigues(turn)[0]).T + shift
    off = ray_to_pixel(lens, in_camera[:, :2] / in_camera[:, 2:]) - view.image_px
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def _cross_validate(
    views: Sequence[BoardView], size_px: tuple[int, int], model: str, coefficients: int
) -> tuple[float, float]:
    """Rms of views that a fit had not seen, and the jackknife sigma of the focal length."""
    folds = min(FOLDS, len(views))
    fits = []
    held_out: list[float] = []
    for fold in range(folds):
        kept = [view for k, view in enumerate(views) if k % folds != fold]
        fit = _calibrate(kept, size_px, model, coefficients)
        fits.append(fit.lens.intrinsics[:2])
        held_out += [_held_out_rms(fit.lens, view) for k, view in enumerate(views) if k % folds == fold]
    focal = np.array(fits)
    variance = (folds - 1) / folds * np.sum((focal - focal.mean(axis=0)) ** 2, axis=0)
    return float(np.sqrt(np.mean(np.square(held_out)))), float(np.sqrt(variance.max()))


def coverage(views: Sequence[BoardView], size_px: tuple[int, int]) -> Array:
    """How many corners were seen in each part of the image, `(rows, columns)`."""
    columns, rows = COVERAGE_GRID
    corners = np.concatenate([view.image_px for view in views])
    extent = ((0, size_px[1]), (0, size_px[0]))
    counts: Array = np.histogram2d(corners[:, 1], corners[:, 0], bins=(rows, columns), range=extent)[0]
    return counts

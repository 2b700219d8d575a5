"""What is known of all cameras together before their pixels speak: the priors of each, and what their errors share.

The hazard is independence. Lens files of one type of camera are off by the same two per cent (one guess, one board, one
way of calibrating), and the two focal lengths of one lens are off by the same factor. Taken as independent, the errors
of eight numbers average to a third, and the network's scale seems three times as certain as it is.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.normal import Normal
from calib.adjustment.priors import CameraPrior
from calib.adjustment.projection import CAMERA_SIZE, CENTRE, LENS, ROTATION, centre_of, unknowns_of
from calib.network import Camera
from edge.common.arrays import Array

AXES_SHARE: Final = 0.95  # of a focal length's variance: pixels are square to a few tenths of a per cent
TYPE_SHARES: Final = 0.3  # of a lens file's variance, by all cameras of one type: one guess, one board, one method
FOCAL_ALIKE: Final = 0.05  # relative difference of focal lengths, up to which equal pictures are of one type of camera
FX: Final = LENS.start
COEFFICIENT: Final = LENS.stop - 1


@dataclass(frozen=True)
class JointPrior:
    """The priors of all cameras. widened: (14 C, 14 C) covariance that is added to what they claim, or None."""

    cameras: tuple[CameraPrior, ...]
    widened: Array | None = None

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """(14 C,) unknowns that something definite is known of: neither free nor held fixed, nor part of a gauge."""
        parts = []
        for prior in self.cameras:
            known = np.isfinite(prior.sigma) & ~prior.fixed
            known[ROTATION] = False
            known[CENTRE] = np.linalg.matrix_rank(prior.centre_information) == 3
            parts.append(known)
        return np.concatenate(parts)

    @cached_property
    def covariance(self) -> Array:
        """(K', K') of the known unknowns, as claimed and widened."""
        claimed = self.claimed
        if self.widened is not None:
            claimed = claimed + self.widened[np.ix_(self.known, self.known)]
        return claimed

    @cached_property
    def claimed(self) -> Array:
        """(K', K') of the known unknowns, as claimed."""
        full = np.zeros((len(self.known), len(self.known)))
        for index, prior in enumerate(self.cameras):
            own = unknowns_of(index)
            full[own, own] = np.diag(np.where(np.isfinite(prior.sigma), prior.sigma, 0.0) ** 2)
            at = centre_of(index)
            if self.known[at].all():
                full[at, at] = np.linalg.inv(prior.centre_information)
        self._share(full)
        return full[np.ix_(self.known, self.known)]

    def _share(self, full: Array) -> None:
        """Enter what focal lengths and refined coefficients of one camera, and of one type of camera, share."""
        for i, one in enumerate(self.cameras):
            for j, two in enumerate(self.cameras):
                share = 1.0 if i == j else TYPE_SHARES if of_one_type(one.mean, two.mean) else 0.0
                for a in (FX, FX + 1):
                    for b in (FX, FX + 1):
                        between = share * (1.0 if a == b else AXES_SHARE)
                        full[CAMERA_SIZE * i + a, CAMERA_SIZE * j + b] = between * one.sigma[a] * two.sigma[b]
                k = COEFFICIENT
                full[CAMERA_SIZE * i + k, CAMERA_SIZE * j + k] = share * one.sigma[k] * two.sigma[k]

    @cached_property
    def information(self) -> Array:
        """(14 C, 14 C) of everything but the up directions."""
        size = len(self.known)
        total = np.zeros((size, size))
        for index, prior in enumerate(self.cameras):
            total[unknowns_of(index), unknowns_of(index)] = prior.information()
        known = np.ix_(self.known, self.known)
        total[known] = np.linalg.inv(self.covariance)
        return total

    def deviation(self, cameras: tuple[Camera, ...]) -> Array:
        """(14 C,) how far the cameras are from their means."""
        return np.concatenate([p.deviation(c) for p, c in zip(self.cameras, cameras, strict=True)])

    def cost(self, cameras: tuple[Camera, ...]) -> float:
        """What the cameras cost by being elsewhere than expected, in squared sigmas."""
        away = self.deviation(cameras)
        ups = [prior.up_residual(camera)[0] for prior, camera in zip(self.cameras, cameras, strict=True)]
        return float(away @ self.information @ away) + sum(float(up @ up) for up in ups)

    def add_to(self, normal: Normal, cameras: tuple[Camera, ...]) -> None:
        """Add it to the normal equations of a step from these cameras."""
        information, gradient = self.information.copy(), self.information @ self.deviation(cameras)
        for index, (prior, camera) in enumerate(zip(self.cameras, cameras, strict=True)):
            at = np.arange(CAMERA_SIZE)[ROTATION] + CAMERA_SIZE * index
            up, by_rotation = prior.up_residual(camera)
            information[np.ix_(at, at)] += by_rotation.T @ by_rotation
            gradient[at] += by_rotation.T @ up
        normal.add_prior(slice(0, len(gradient)), information, gradient)


def of_one_type(one: Camera, two: Camera) -> bool:
    """Whether two lens files are likely to err alike: equal pictures and models, focal lengths near one another.

    Not where a lens report says how good the file is: that was measured, camera by camera.
    """
    a, b = one.lens, two.lens
    measured = a.focal_sigma_px is not None or b.focal_sigma_px is not None
    near = abs(a.intrinsics[0] / b.intrinsics[0] - 1) < FOCAL_ALIKE
    return not measured and a.model == b.model and a.size_px == b.size_px and near

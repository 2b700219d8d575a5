"""Sites whose pixels are a linear Gaussian problem of known information: what the tests of doubts are fed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.adjustment.joint_prior import JointPrior
from calib.adjustment.priors import FIXED, FREE, CameraPrior
from calib.adjustment.projection import CAMERA_SIZE, LENS, OFFSET, RATE, READOUT
from calib.network import Camera
from calib.solving.pixel_information import PixelInformation
from edge.common.arrays import Array
from edge.lens import LensModel
from tools.doubles.survey_network import draw

LENS_MODEL = LensModel("radtan", (1000.0, 1000.0, 960.0, 540.0), (0.0,) * 4, (1920, 1080))
SURVEY_SIGMA_M = 0.02
SEEN = 0.2  # of the prior's sigma: how well the pixels know what is not a position


def prior(name: str, *, reference: bool = False, bound_s: float = 0.005) -> CameraPrior:
    """A surveyed camera with a lens file of 1 % and a clock of that bound; the site's time if it is the reference."""
    sigma = np.full(CAMERA_SIZE, FREE)
    sigma[[OFFSET, RATE]] = FIXED if reference else (bound_s, bound_s / 60)
    sigma[READOUT] = FIXED
    sigma[LENS] = [10.0, 10.0, 10.0, 10.0, 0.01]
    return CameraPrior(Camera(name, LENS_MODEL, np.eye(3), np.zeros(3)), sigma, np.eye(3) / SURVEY_SIGMA_M**2)


def priors(count: int) -> JointPrior:
    """Cameras a, b, c ...; the first one's clock is the site's time."""
    return JointPrior(tuple(prior(chr(ord("a") + k), reference=k == 0) for k in range(count)))


@dataclass(frozen=True)
class Site:
    """Cameras' priors, and what their pixels know: information (K', K') of the known unknowns."""

    prior: JointPrior
    information: Array

    @classmethod
    def drawn(cls, count: int, seed: int) -> "Site":
        """A network of tripods about a field, its shape known to a pixel of noise; lenses and clocks by themselves."""
        prior = priors(count)
        full = np.zeros((len(prior.known),) * 2)
        centres = np.concatenate([CAMERA_SIZE * k + np.arange(3, 6) for k in range(count)])
        full[np.ix_(centres, centres)] = draw(count, np.random.default_rng(seed), points=200).information
        others = np.setdiff1d(np.flatnonzero(prior.known), centres)
        place = np.cumsum(prior.known) - 1
        full[others, others] = 1 / (SEEN**2 * np.diag(prior.claimed)[place[others]])
        known = np.ix_(prior.known, prior.known)
        return cls(prior, full[known])

    def seen(self, rng: np.random.Generator, off: Sequence[float] | Array = ()) -> PixelInformation:
        """What pixels say of a draw of the priors' errors, as large as claimed, and of `off` (14 C,) on top of them.

        off: how far what is claimed lies from the truth.
        """
        size = len(self.information)
        claimed = np.linalg.cholesky(self.prior.claimed) @ rng.standard_normal(size)
        if len(off):
            claimed = claimed + np.asarray(off)[self.prior.known]
        values, vectors = np.linalg.eigh(self.information)
        noise = vectors @ (np.sqrt(np.maximum(values, 0)) * rng.standard_normal(size))
        scale = np.sqrt(np.diag(self.prior.claimed))
        pull = (noise - self.information @ claimed) * scale
        return PixelInformation(scale, self.information * np.outer(scale, scale), pull)

"""What is known of a camera before its pixels speak, and how firmly.

The hazard runs both ways. Taken as exact, a lens file that is 2 % off or a clock half a second off comes out as metres
of position; left free, a flight that cannot carry them lets them run away with it. So every unknown has a prior with a
reason, and the pixels move it only as far as they can pay for.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.projection import CAMERA_SIZE, CENTRE, LENS, OFFSET, RATE, READOUT, ROTATION
from calib.geometry.rotation import rotation, skew
from calib.network import Camera
from calib.observations import SiteCamera
from edge.common.arrays import Array

FOCAL_SIGMA: Final = 0.01  # of the focal length: what checkerboard calibrations of consumer cameras disagree by
PRINCIPAL_SIGMA: Final = 0.01  # of the focal length, likewise
CLOCK_SIGMA_S: Final = 0.5  # a box that says nothing of its clock, once the coarse search has aligned it
RATE_SIGMA: Final = 1e-3  # s/s: stamps counted at 30 frames a second that were 29.97 run 1001 ppm fast
READOUT_SIGMA_S: Final = 0.01  # rolling shutters take 5 to 30 ms
READOUT_S: Final = 0.015  # and their middle
KNOWN_READOUT_SIGMA_S: Final = 5e-4  # a data sheet's
ALIGNED_TO_S: Final = 0.05  # what the search by epipolar geometry is good for on the worst flights
KEEPS_BOUND_S: Final = 60.0  # a disciplined clock leaves its bound no faster than in this time
LEAST_MISLED_S: Final = 0.005  # s: less is how well tracks tell a clock, and 0.1 m of a drone
CONTRADICTING_RATE: Final = 3e-4  # s/s: leaves a bound of milliseconds within half a minute, whatever the box says
FREE: Final = np.inf
FIXED: Final = 0.0


@dataclass(frozen=True)
class CameraPrior:
    """Where a camera's unknowns are pulled to and how hard.

    mean: a camera that holds the expected centre, clock and lens (its attitude is not used). sigma: (14,) in the order
    of projection.py, infinite for free, 0 for held fixed; the centre's three are ignored for centre_information
    (3, 3). up_cam: (3,) the camera's own idea of up, with up_sigma_rad, or None.
    """

    mean: Camera
    sigma: Array
    centre_information: Array
    up_cam: Array | None = None
    up_sigma_rad: float = 0.0

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """(14,) which unknowns are not estimated."""
        held: NDArray[np.bool_] = self.sigma == FIXED
        held[CENTRE] = False
        return held

    def information(self) -> Array:
        """(14, 14) of all but the up direction."""
        with np.errstate(divide="ignore"):
            diagonal = np.where(self.fixed, 1.0, 1 / self.sigma**2)
        matrix = np.diag(np.where(np.isfinite(diagonal), diagonal, 0.0))
        matrix[CENTRE, CENTRE] = self.centre_information
        return matrix

    def deviation(self, camera: Camera) -> Array:
        """(14,) how far a camera is from the mean; zero where nothing is expected."""
        away = np.zeros(CAMERA_SIZE)
        away[CENTRE] = camera.centre_enu - self.mean.centre_enu
        away[OFFSET] = camera.clock_offset_s - self.mean.clock_offset_s
        away[RATE] = camera.clock_rate - self.mean.clock_rate
        away[READOUT] = camera.readout_s - self.mean.readout_s
        away[LENS.start : LENS.start + 4] = np.subtract(camera.lens.intrinsics, self.mean.lens.intrinsics)
        away[LENS.stop - 1] = camera.lens.refined_coefficient - self.mean.lens.refined_coefficient
        away[self.fixed] = 0.0
        return away

    def up_residual(self, camera: Camera) -> tuple[Array, Array]:
        """(3,) whitened misfit of the up direction and its (3, 3) derivative by the rotation; zeros if unknown."""
        if self.up_cam is None:
            return np.zeros(3), np.zeros((3, 3))
        up = camera.R_cam_enu[:, 2]
        return (up - self.up_cam) / self.up_sigma_rad, -skew(up) / self.up_sigma_rad


def lens_sigma(camera: Camera) -> Array:
    """(5,) one sigma of fx, fy, cx, cy (px) and the refined coefficient: the lens report's, else a hundredth."""
    focal = camera.lens.focal_sigma_px
    fx, fy = camera.lens.intrinsics[:2]
    coefficient = camera.lens.kind.refined_sigma
    if focal is not None:
        return np.array([focal, focal, focal, focal, coefficient * focal / (FOCAL_SIGMA * fx)])
    return np.array([FOCAL_SIGMA * fx, FOCAL_SIGMA * fy, PRINCIPAL_SIGMA * fx, PRINCIPAL_SIGMA * fy, coefficient])


def camera_priors(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> tuple[CameraPrior, ...]:
    """What is known of each camera beforehand. cameras: as aligned and georeferenced."""
    reference = time_reference(cameras, sites)
    return tuple(_camera_prior(camera, sites[camera.id], camera.id == reference) for camera in cameras)


def held(camera: Camera, prior: CameraPrior) -> Camera:
    """The camera with every unknown that is not estimated where it is expected to be."""
    return replace(
        camera,
        clock_offset_s=prior.mean.clock_offset_s if prior.fixed[OFFSET] else camera.clock_offset_s,
        clock_rate=prior.mean.clock_rate if prior.fixed[RATE] else camera.clock_rate,
        readout_s=prior.mean.readout_s if prior.fixed[READOUT] else camera.readout_s,
    )


def misled(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> bool:
    """Whether the clock that the others were held against is off them, or off their pace, beyond what it states.

    All alike, the first by name is taken for the site's time. Where it is the one that is wrong, all others are off by
    the same, and the flight with them: nobody's word is the time, but what most of those say that know theirs.
    """
    bound_s = sites[time_reference(cameras, sites)].clock_bound_s
    if bound_s is None:
        return False
    before, anew = cameras[0], on_site_time(cameras, sites)[0]
    off = abs(before.clock_offset_s - anew.clock_offset_s) > max(3 * bound_s, LEAST_MISLED_S)
    return off or abs(before.clock_rate - anew.clock_rate) > CONTRADICTING_RATE


def on_site_time(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> tuple[Camera, ...]:
    """The cameras with their clocks against the site's time: that of the boxes that know theirs, else of most.

    Anew for every set of cameras: the one the others were aligned to may be the one that was thrown out.
    """
    knowing = [camera for camera in cameras if _knows_its_time(sites[camera.id])]
    zero_s = _of_most([camera.clock_offset_s for camera in knowing or cameras])
    rates = [camera.clock_rate for camera in knowing]
    # Where one of them has left its bound, it may be the one that the others were held against.
    pace = _of_most(rates) if max(map(abs, rates), default=0.0) > CONTRADICTING_RATE else 0.0
    return tuple(
        replace(camera, clock_offset_s=camera.clock_offset_s - zero_s, clock_rate=camera.clock_rate - pace)
        for camera in cameras
    )


def _of_most(values: list[float]) -> float:
    """The median; of two in the middle, the nearer to zero."""
    ranked = sorted(values)
    return min(ranked[(len(ranked) - 1) // 2], ranked[len(ranked) // 2], key=abs)


def _knows_its_time(site: SiteCamera) -> bool:
    return site.clock_bound_s is not None and site.clock_bound_s <= ALIGNED_TO_S


def trusted_clocks(sites: dict[str, SiteCamera]) -> frozenset[str]:
    """Cameras whose own bound is tighter than any alignment by tracks."""
    return frozenset(name for name, site in sites.items() if _knows_its_time(site))


def time_reference(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> str:
    """The camera whose clock is the site's time: the smallest published bound that the tracks do not contradict, else
    the first that needed no shift and keeps the others' pace.
    """
    pace = float(np.median([camera.clock_rate for camera in cameras]))

    def rank(camera: Camera) -> tuple[float, bool, float, str]:
        site = sites[camera.id]
        bound = site.clock_bound_s if site.clock_bound_s is not None and _bound_holds(camera, site) else np.inf
        off_pace = abs(camera.clock_rate - pace) > CONTRADICTING_RATE
        return (bound, off_pace, abs(camera.clock_offset_s), camera.id)

    return min(cameras, key=rank).id


def _camera_prior(camera: Camera, site: SiteCamera, reference: bool) -> CameraPrior:
    sigma = np.full(CAMERA_SIZE, FREE)
    sigma[OFFSET], sigma[RATE] = (FIXED, FIXED) if reference else _clock_sigma(camera, site)
    sigma[READOUT] = _readout_sigma(site)
    sigma[LENS] = lens_sigma(camera)
    centre, information = camera.centre_enu, np.zeros((3, 3))
    if site.position_enu is not None and site.position_covariance is not None:
        centre, information = site.position_enu, np.asarray(np.linalg.inv(site.position_covariance), float)
    mean = replace(
        camera,
        lens=site.lens,
        centre_enu=centre,
        clock_offset_s=camera.clock_offset_s if reference or not _bound_holds(camera, site) else 0.0,
        readout_s=site.readout_s if site.readout_s is not None else READOUT_S,
    )
    up_sigma = np.radians(site.up_sigma_deg) if site.up_sigma_deg is not None else 0.0
    return CameraPrior(mean, sigma, information, site.up_cam if up_sigma > 0 else None, float(up_sigma))


def _bound_holds(camera: Camera, site: SiteCamera) -> bool:
    if site.clock_bound_s is None:
        return False
    keeps_pace = abs(camera.clock_rate) <= max(3 * site.clock_bound_s / KEEPS_BOUND_S, CONTRADICTING_RATE)
    return keeps_pace and abs(camera.clock_offset_s) <= max(3 * site.clock_bound_s, ALIGNED_TO_S)


def _clock_sigma(camera: Camera, site: SiteCamera) -> tuple[float, float]:
    """Offset and rate: the box's own bound while the tracks do not contradict it, else what the search left open."""
    if site.clock_bound_s is not None and _bound_holds(camera, site):
        return site.clock_bound_s, min(RATE_SIGMA, site.clock_bound_s / KEEPS_BOUND_S)
    return CLOCK_SIGMA_S, RATE_SIGMA


def _readout_sigma(site: SiteCamera) -> float:
    if site.readout_s is None:
        return READOUT_SIGMA_S
    return FIXED if site.readout_s == 0 else KNOWN_READOUT_SIGMA_S


def moved(camera: Camera, step: Array) -> Camera:
    """The camera after a step (14,) of the adjustment."""
    # Rounding of many steps must not leave the rotations.
    U, _, Vt = np.linalg.svd(rotation(step[ROTATION]) @ camera.R_cam_enu)
    return Camera(
        camera.id,
        camera.lens.refined(step[LENS]),
        U @ Vt,
        camera.centre_enu + step[CENTRE],
        camera.clock_offset_s + float(step[OFFSET]),
        camera.clock_rate + float(step[RATE]),
        camera.readout_s + float(step[READOUT]),
    )

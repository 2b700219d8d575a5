"""What a calibration has found out that its user did not know: clocks beyond their bounds, lenses that were off.

The hazard is the correction that is made in silence. An adjustment that moves a clock by half a second has repaired a
flight, and left the box to spoil the next one.
"""

from typing import Final

import numpy as np

from calib.observations import SiteCamera
from calib.solving.found import Cause, Found
from calib.solving.solution import CameraReport

OFF_BOUND_S: Final = 2e-3  # an offset is worth telling beyond its bound and this: 4 cm at 20 m/s
OFF_LENS: Final = 0.01  # of the focal length: as much as lens files are usually good for
SIGNIFICANT: Final = 3.0  # sigmas


def findings(cameras: tuple[CameraReport, ...], sites: dict[str, SiteCamera]) -> tuple[Found, ...]:
    """Clocks and lenses that are off, camera by camera."""
    found: list[Found] = []
    for camera in cameras:
        found += [Found(Cause.CLOCK, (camera.id,), sentence) for sentence in _clock(camera, sites[camera.id])]
        found += [Found(Cause.LENS, (camera.id,), sentence) for sentence in _lens(camera)]
    return tuple(found)


def _clock(camera: CameraReport, site: SiteCamera) -> list[str]:
    offset, bound = camera.clock_offset_s, site.clock_bound_s
    if bound is None:
        if abs(offset) > max(0.1, SIGNIFICANT * camera.sigma_offset_s):
            return [f"the clock of {camera.id} is {-offset:+.3f} s off the site's; it says nothing of its own bound"]
        return []
    if abs(offset) > bound + OFF_BOUND_S + SIGNIFICANT * camera.sigma_offset_s:
        return [
            f"the clock of {camera.id} is {-offset:+.3f} s off the site's, its own bound is {bound:.3f} s: "
            "look at its time synchronisation"
        ]
    return []


def _lens(camera: CameraReport) -> list[str]:
    before, after = np.array(camera.lens_before.intrinsics[:2]), np.array(camera.lens_after.intrinsics[:2])
    change = after / before - 1
    sigma = np.array(camera.sigma_lens[:2]) / before
    worst = int(np.argmax(np.abs(change)))
    if abs(change[worst]) > OFF_LENS and abs(change[worst]) > SIGNIFICANT * sigma[worst]:
        return [
            f"the focal length of {camera.id} is {100 * change[worst]:+.1f} % off its lens file: calibrate the lens"
        ]
    return []

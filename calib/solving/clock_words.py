"""A clock that is off, in words: by how much, what that looks like, and how fast it runs.

The hazard is a number that nobody recognises: 3600 s is a time zone, 18 s is GPS time, and 5667 ppm is a frame rate of
29.83 that was written down as 30.
"""

from typing import Final

from calib.observations import SiteCamera
from calib.solving.solution import CameraReport

SIGNIFICANT: Final = 3.0  # sigmas
OFF_BOUND_S: Final = 2e-3  # an offset is worth telling beyond its bound and this: 4 cm at 20 m/s
OFF_RATE: Final = 3e-4  # s/s: ten times what a quartz does; frame rates that were rounded are off by 1000 and more
HALF_HOUR_S: Final = 1800.0  # time zones differ by multiples of it
LEAP_SECONDS: Final = {18.0: "GPS time in place of UTC", 37.0: "TAI in place of UTC"}  # s, since 2017
LIKE_S: Final = 0.5  # how far clocks that are read in another time may be off besides


def clock_words(camera: CameraReport, site: SiteCamera) -> list[str]:
    """What is worth telling of a camera's clock, a sentence each for its offset and its rate."""
    return [sentence for sentence in (_offset(camera, site), _rate(camera)) if sentence]


def _offset(camera: CameraReport, site: SiteCamera) -> str | None:
    offset, bound = camera.clock_offset_s, site.clock_bound_s
    known = _known(offset)
    if bound is None:
        if abs(offset) <= max(0.1, SIGNIFICANT * camera.sigma_offset_s):
            return None
        return f"the clock of {camera.id} is {-offset:+.3f} s off the site's{known}; it says nothing of its own bound"
    if abs(offset) <= bound + OFF_BOUND_S + SIGNIFICANT * camera.sigma_offset_s:
        return None
    return (
        f"the clock of {camera.id} is {-offset:+.3f} s off the site's{known}, its own bound is {bound:.3f} s: "
        "look at its time synchronisation"
    )


def _known(offset_s: float) -> str:
    """What an offset looks like, in brackets, or nothing."""
    half_hours = round(offset_s / HALF_HOUR_S)
    if half_hours and abs(offset_s - half_hours * HALF_HOUR_S) < LIKE_S:
        return f" ({abs(half_hours) / 2:g} h: another time zone or summer time)"
    for seconds, what in LEAP_SECONDS.items():
        if abs(abs(offset_s) - seconds) < LIKE_S:
            return f" ({what})"
    return ""


def _rate(camera: CameraReport) -> str | None:
    rate = camera.clock_rate
    if abs(rate) <= OFF_RATE + SIGNIFICANT * camera.sigma_rate:
        return None
    return (
        f"the clock of {camera.id} runs {1e6 * abs(rate):.0f} ppm {'slow' if rate > 0 else 'fast'}, as if "
        f"{30 / (1 + rate):.2f} frames a second were counted as 30: give its true frame rate, or stamp each frame"
    )

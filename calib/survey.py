"""From occupations of a tripod to the surveyed position of its lens, with a sigma that is true.

The hazard is the fix that is wrong from beginning to end: inside one occupation a false ambiguity cannot be seen, it
only stands still 0.3 m away. So a tripod is occupied twice, with the receiver made to fix anew in between, and the two
are compared; the rover comes back to the first tripod at the end; and what the antenna's height above the lens is, and
to which point of the antenna it was measured, is asked and never assumed. A second occupation soon after the first
guards against the false fix but does not halve the slow error: only occupations twenty minutes apart do.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from calib.errors import CalibrationError
from calib.geodesy import Origin, enu_to_geodetic, geodetic_to_enu
from edge.common.arrays import Array
from edge.common.static_rtk import LEAST_STATIC_SIGMA_M

INDEPENDENT_AFTER_S: Final = 1200.0  # three correlation times of the slow error: 5 % of it is still shared
MAX_APART_H_M, MAX_APART_V_M = 0.050, 0.080  # twice what 95 % of good pairs differ by, measured on network RTK
MAX_BESIDE_LENS_M: Final = 0.010  # its direction is unknown before the camera's heading is

Reference = Literal["phase-centre", "ARP"]


@dataclass(frozen=True)
class Antenna:
    """Where the antenna is relative to the lens.

    above_lens_m: from the lens's entrance pupil up to measured_to. position_of: what the receiver's coordinates are of;
    NMEA's are nearly always of the phase centre. phase_centre_above_arp_m: of the antenna model, needed where the two
    differ. beside_lens_m: horizontally, at most 10 mm. Raises CalibrationError for what cannot be allowed for.
    """

    above_lens_m: float
    measured_to: Reference
    position_of: Reference = "phase-centre"
    phase_centre_above_arp_m: float | None = None
    beside_lens_m: float = 0.0
    model: str = ""
    measured_by: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.beside_lens_m <= MAX_BESIDE_LENS_M:
            raise CalibrationError(
                f"the antenna stands {self.beside_lens_m * 1000:.0f} mm beside the lens",
                where="antenna",
                action=f"put it above the lens, within {MAX_BESIDE_LENS_M * 1000:.0f} mm of the plumb line",
            )
        if self.measured_to != self.position_of and self.phase_centre_above_arp_m is None:
            raise CalibrationError(
                f"its height was measured to the {self.measured_to}, its positions are of the {self.position_of}",
                where="antenna",
                action="give phase_centre_above_arp_m from the antenna's data sheet",
            )

    @property
    def up_m(self) -> float:
        """Metres from the lens up to the point that the receiver's coordinates are of."""
        phase_m = self.phase_centre_above_arp_m or 0.0
        shift_m = {"ARP": 0.0, "phase-centre": phase_m}
        return self.above_lens_m + shift_m[self.position_of] - shift_m[self.measured_to]


@dataclass(frozen=True)
class Occupation:
    """One static session on a tripod, of the antenna.

    geodetic: latitude deg, longitude deg, ellipsoidal m. Of its error, east, north, up in metres: scatter_m becomes
    smaller with time, floor_m with an independent occupation, fixed_m never.
    """

    t_unix_ns: int
    duration_s: float
    samples: int
    geodetic: Origin
    scatter_m: tuple[float, float, float]
    floor_m: tuple[float, float, float]
    fixed_m: tuple[float, float, float]
    antenna: Antenna

    @property
    def lens_geodetic(self) -> Origin:
        """The lens: the antenna's position less its height above the lens, along the ellipsoid's normal."""
        latitude, longitude, height = self.geodetic
        return latitude, longitude, height - self.antenna.up_m


@dataclass(frozen=True)
class SurveyedPoint:
    """The surveyed lens: latitude deg, longitude deg, ellipsoidal m; one sigma east, north, up, m."""

    geodetic: Origin
    sigma_m: tuple[float, float, float]
    independent: int


@dataclass(frozen=True)
class Apart:
    """How far two occupations of one tripod differ, and whether that is too far."""

    horizontal_m: float
    vertical_m: float

    @property
    def too_far(self) -> bool:
        """Whether one of the two must be a false fix, or the tripod was moved."""
        return self.horizontal_m > MAX_APART_H_M or abs(self.vertical_m) > MAX_APART_V_M

    def __str__(self) -> str:
        return f"{self.horizontal_m * 1000:.0f} mm horizontally, {self.vertical_m * 1000:+.0f} mm vertically"


def apart(first: Occupation, second: Occupation) -> Apart:
    """How far the second occupation's lens lies from the first's."""
    east, north, up = geodetic_to_enu(np.array([second.lens_geodetic]), first.lens_geodetic)[0]
    return Apart(math.hypot(east, north), float(up))


def combine(occupations: list[Occupation], *, where: str) -> SurveyedPoint:
    """The surveyed lens from all occupations of its tripod, weighed by their length.

    Raises CalibrationError, naming `where`, if two of them are too far apart: which is wrong cannot be seen from two.
    """
    if not occupations:
        raise CalibrationError("no occupation", where=where, action="occupy the tripod")
    for i, first in enumerate(occupations):
        for second in occupations[i + 1 :]:
            if (difference := apart(first, second)).too_far:
                raise CalibrationError(
                    f"two occupations differ by {difference}: one is a false fix, or the tripod was moved",
                    where=where,
                    action="re-initialise and occupy it once more, then reject the odd one out",
                )
    weights = np.array([occupation.duration_s for occupation in occupations])
    weights = weights / weights.sum() if weights.sum() > 0 else np.full(len(weights), 1 / len(weights))
    origin = occupations[0].lens_geodetic
    enu = geodetic_to_enu(np.array([occupation.lens_geodetic for occupation in occupations]), origin)
    latitude, longitude, height = enu_to_geodetic(weights @ enu, origin)[0]
    sigma, independent = _sigma(occupations, weights)
    return SurveyedPoint((float(latitude), float(longitude), float(height)), sigma, independent)


def _sigma(occupations: list[Occupation], weights: Array) -> tuple[tuple[float, float, float], int]:
    scatter = np.array([occupation.scatter_m for occupation in occupations])
    floor = np.array([occupation.floor_m for occupation in occupations])
    fixed = np.array([occupation.fixed_m for occupation in occupations])
    groups = _groups(occupations)
    variance = (weights**2) @ scatter**2 + np.max(fixed, axis=0) ** 2
    for group in range(groups.max() + 1):
        # Occupations close in time share their slow error: their floors add, they do not average.
        variance += (weights[groups == group] @ floor[groups == group]) ** 2
    east, north, up = np.maximum(np.sqrt(variance), LEAST_STATIC_SIGMA_M)
    return (float(east), float(north), float(up)), int(groups.max() + 1)


def _groups(occupations: list[Occupation]) -> Array:
    """(N,) the number of the independent group that each occupation belongs to."""
    order = sorted(range(len(occupations)), key=lambda i: occupations[i].t_unix_ns)
    groups = np.zeros(len(occupations), int)
    for before, after in itertools.pairwise(order):
        pause_s = (occupations[after].t_unix_ns - occupations[before].t_unix_ns) * 1e-9
        groups[after] = groups[before] + (pause_s >= INDEPENDENT_AFTER_S)
    return groups


@dataclass(frozen=True)
class Closure:
    """The rover's return to the tripod on which it began. age_s: between the two occupations."""

    apart: Apart
    age_s: float

    def __str__(self) -> str:
        verdict = "the tripod or the base moved, or a fix is false" if self.apart.too_far else "closes"
        return f"after {self.age_s / 60:.0f} min: {self.apart}: {verdict}"


def loop_closure(occupations: list[Occupation]) -> Closure | None:
    """The difference between the first and the last occupation of the first tripod; None before the rover is back."""
    if len(occupations) < 2:
        return None
    first, *_, last = sorted(occupations, key=lambda occupation: occupation.t_unix_ns)
    return Closure(apart(first, last), (last.t_unix_ns - first.t_unix_ns) * 1e-9)

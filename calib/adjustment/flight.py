"""The state of an adjustment: the cameras, and the flight they saw."""

from dataclasses import dataclass

import numpy as np

from calib.geometry.spline import ORDER, THIRD_DIFFERENCE, Flight
from calib.network import Camera
from edge.common.arrays import Array


@dataclass(frozen=True)
class FlightEstimate:
    """All unknowns: the cameras, and the flight's control points (M, 3) in ENU metres."""

    cameras: tuple[Camera, ...]
    flight: Flight
    control: Array


def jerk(flight: Flight, control: Array) -> Array:
    """(P, 3) third derivative of the flight on each of its polynomial pieces, m/s^3."""
    four = control[flight.piece_controls[:, None] + np.arange(ORDER)]
    third: Array = np.einsum("k,nkd->nd", THIRD_DIFFERENCE, four) / flight.spacing_s**3
    return third

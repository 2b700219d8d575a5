"""Rays as unit vectors, and where those of two cameras come nearest to each other.

The hazard is the flat crossing: under a fraction of a degree two rays pass each other closely anywhere, and where they
are nearest is noise. The sine of their angle is therefore part of the answer, and too small a one makes it no meeting.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from edge.common.arrays import Array

LEAST_SINE2: Final = 1e-4  # of the angle between two rays: 0.6 degrees; flatter tells no range


@dataclass(frozen=True)
class NearestPoint:
    """Of pairs of rays (...): the middle of their shortest connection (..., 3), its length (m), the distance along each
    ray to it (m, negative behind the camera), and the squared sine of the angle between the two.
    """

    points: Array
    gap_m: Array
    range_a_m: Array
    range_b_m: Array
    sine2: Array


def directions_cam(rays: Array) -> Array:
    """(N, 3) unit vectors in the camera frame of rays (N, 2); NaN stays NaN."""
    homogeneous = np.column_stack([rays, np.ones(len(rays))])
    unit: Array = homogeneous / np.linalg.norm(homogeneous, axis=1, keepdims=True)
    return unit


def nearest_point(centre_a: Array, bearing_a: Array, centre_b: Array, bearing_b: Array) -> NearestPoint:
    """Rays from centres (..., 3) along unit bearings (..., 3), broadcast against each other.

    The least-squares solution of a + r u = b + s v in closed form (Beardsley, Zisserman and Murray 1997, midpoint).
    """
    base = centre_b - centre_a
    cosine = np.einsum("...i,...i->...", bearing_a, bearing_b)
    along_a, along_b = np.einsum("...i,...i->...", bearing_a, base), np.einsum("...i,...i->...", bearing_b, base)
    sine2 = np.maximum(1 - cosine**2, 1e-9)
    range_a, range_b = (along_a - cosine * along_b) / sine2, (cosine * along_a - along_b) / sine2
    on_a, on_b = centre_a + range_a[..., None] * bearing_a, centre_b + range_b[..., None] * bearing_b
    return NearestPoint((on_a + on_b) / 2, np.linalg.norm(on_a - on_b, axis=-1), range_a, range_b, sine2)

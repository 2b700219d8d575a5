"""Rotations: by a vector, and the one that takes directions closest to others.

The hazard is the mirror. The orthogonal matrix that fits best may turn a world inside out; the determinant is held at
+1, whatever the fit loses by it.
"""

import numpy as np
from numpy.typing import ArrayLike

from edge.common.arrays import Array


def skew(v: Array) -> Array:
    """(3, 3) matrix that crosses v (3,) with what it is multiplied with."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def rotation(vector: ArrayLike) -> Array:
    """(3, 3) rotation by a vector (3,) in radians (Rodrigues 1840)."""
    axis = np.asarray(vector, float)
    angle = float(np.linalg.norm(axis))
    if angle == 0.0:
        return np.eye(3)
    cross = skew(axis / angle)
    turned: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


def fit_rotation(target: Array, source: Array, weight: Array) -> Array:
    """Rotations (G, 3, 3) that take unit vectors source (G, T, 3) closest to target (T, 3), weighed (T,).

    Kabsch 1976; the determinant is +1.
    """
    U, _, Vt = np.linalg.svd(np.einsum("ti,gtj->gij", target * weight[:, None], source))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    fitted: Array = U @ Vt
    return fitted

"""The normal equations of a flight and its cameras: banded in the control points, with one dense border.

    [ A  B ] [control]   [a]      A: (3M, 3M), four control points act at once, so 11 superdiagonals
    [ B' C ] [cameras] = [c]      B: (3M, K) dense, K = 14 a camera

A flight of ten minutes has ten thousand unknowns; a dense solution would cost 1e12 operations and hide in a laptop's
memory, the band costs a few 1e7 and grows with the length of the flight. The band is eliminated by Cholesky, the Schur
complement C - B' A^-1 B is solved densely, and its inverse is the covariance of the cameras, the flight integrated out.
A few directions of the flight that a prior must not hold are taken out of A again, U U' of them (`slack`), by the
identity of Woodbury (1950): as a matrix they would fill the band.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import csr_matrix

from calib.geometry.spline import ORDER, Located
from edge.common.arrays import Array

SUPERDIAGONALS: Final = 3 * ORDER - 1
# Control points to a block of the inverse: at least 3 to make the matrix block tridiagonal, more to spare the loop.
BLOCK_POINTS: Final = 12


@dataclass
class Normal:
    """Normal matrix and right-hand side, added up camera by camera.

    block: (ORDER, M, 3, 3), block[k, m] couples control points m and m + k. border: (M, 3, K). corner: (K, K).
    prior: (K, K) the part of the corner that priors put there. slack: (3M, r) U. right_control: (M, 3).
    right_camera: (K,).
    """

    block: Array
    border: Array
    corner: Array
    prior: Array
    slack: Array
    right_control: Array
    right_camera: Array

    @classmethod
    def zero(cls, controls: int, border: int) -> "Normal":
        """An empty system of `controls` points and `border` camera unknowns."""
        return cls(
            np.zeros((ORDER, controls, 3, 3)),
            np.zeros((controls, 3, border)),
            np.zeros((border, border)),
            np.zeros((border, border)),
            np.zeros((3 * controls, 0)),
            np.zeros((controls, 3)),
            np.zeros(border),
        )

    def add_observations(self, located: Located, by_point: Array, by_camera: Array, residual: Array, at: slice) -> None:
        """Add whitened observations: by_point (N, 2, 3), by_camera (N, 2, K'), residual (N, 2); K' columns `at`."""
        controls, n = len(self.right_control), len(residual)
        weights = located.weights()
        information = (by_point.transpose(0, 2, 1) @ by_point).reshape(n, 9)
        for k in range(ORDER):
            pairs = weights[:, : ORDER - k] * weights[:, k:]
            spread = _scatter(pairs, located.first, controls)
            self.block[k] += (spread @ information).reshape(controls, 3, 3)
        spread = _scatter(weights, located.first, controls)
        transposed = by_point.transpose(0, 2, 1)
        coupling = (transposed @ by_camera).reshape(n, -1)
        self.border[:, :, at] += (spread @ coupling).reshape(controls, 3, -1)
        self._pull(spread, by_point, residual)
        columns = by_camera.reshape(2 * n, -1)
        self.corner[at, at] += columns.T @ columns
        self.right_camera[at] -= columns.T @ residual.ravel()

    def add_pull(self, located: Located, by_point: Array, by_camera: Array, residual: Array, at: slice) -> None:
        """Add only what they pull: the right-hand side."""
        self._pull(_scatter(located.weights(), located.first, len(self.right_control)), by_point, residual)
        self.right_camera[at] -= by_camera.reshape(2 * len(residual), -1).T @ residual.ravel()

    def _pull(self, spread: csr_matrix, by_point: Array, residual: Array) -> None:
        self.right_control -= spread @ np.einsum("nij,ni->nj", by_point, residual)

    def add_prior(self, at: slice, information: Array, gradient: Array) -> None:
        """Add what is known of one camera: information (K', K'), and the gradient (K',) of half its cost."""
        self.corner[at, at] += information
        self.prior[at, at] += information
        self.right_camera[at] -= gradient


def _scatter(weights: Array, first: NDArray[np.int64], controls: int) -> csr_matrix:
    """(M, N) sparse matrix that adds observation n, times weights[n, i], to control point first[n] + i."""
    n, width = weights.shape
    indices = (first[:, None] + np.arange(width)).ravel()
    return csr_matrix((weights.ravel(), indices, np.arange(0, n * width + 1, width)), shape=(n, controls)).T.tocsr()


@dataclass(frozen=True)
class NormalStep:
    """A solution of the normal equations: control (M, 3), camera (K,).

    camera_squared: how far it moves the cameras, in squared sigmas, the flight following them.
    """

    control: Array
    camera: Array
    camera_squared: float

    def scaled(self, share: float) -> "NormalStep":
        """A share of it."""
        return NormalStep(share * self.control, share * self.camera, share**2 * self.camera_squared)

    def plus(self, bend: "NormalStep") -> "NormalStep":
        """With what it lacked; as far as without it."""
        return NormalStep(self.control + bend.control, self.camera + bend.camera, self.camera_squared)


@dataclass(frozen=True)
class Factor:
    """A factorised system: of the flight, (A - U U')^-1 B (3M, K), and the Schur complement's inverse (K, K)."""

    flight: "FlightFactor"
    carried: Array
    camera_covariance: Array

    def solve(self, normal: Normal) -> NormalStep:
        """The step that the normal equations ask for."""
        K = len(normal.right_camera)
        a = self.flight.solve(normal.right_control.ravel())
        pull = normal.right_camera - normal.border.reshape(-1, K).T @ a
        camera = self.camera_covariance @ pull
        control = a - self.carried @ camera
        return NormalStep(control.reshape(-1, 3), camera, float(pull @ camera))


@dataclass(frozen=True)
class FlightFactor:
    """A's banded Cholesky factor, A^-1 U (3M, r), and (1 - U' A^-1 U)^-1 (r, r)."""

    band: Array
    freed: Array
    inner: Array

    @classmethod
    def of(cls, normal: Normal, damping: float, *, slack: bool) -> "FlightFactor":
        """Factorise. Raises numpy.linalg.LinAlgError if the flight is not determined, cameras held fixed."""
        band = cholesky_banded(_banded(normal.block, damping))
        rank = normal.slack.shape[1] if slack else 0
        freed = cho_solve_banded((band, False), normal.slack) if rank else np.zeros((len(normal.slack), 0))
        inner = cho_solve(cho_factor(np.eye(rank) - normal.slack.T @ freed), np.eye(rank)) if rank else np.eye(0)
        return cls(band, freed, inner)

    def solve(self, right: Array) -> Array:
        """(A - U U')^-1 times (3M,) or (3M, K)."""
        plain: Array = cho_solve_banded((self.band, False), right)
        return plain + self.freed @ (self.inner @ (self.freed.T @ right)) if self.freed.size else plain


def factorise(normal: Normal, damping: float = 0.0, *, slack: bool = True) -> Factor:
    """Eliminate the band, invert the border. damping: Levenberg-Marquardt's, relative to the diagonal.

    slack: whether it is taken out: what is known is stated without it, but a step along it is as good as any, and
    would be taken too far.
    Raises numpy.linalg.LinAlgError if the system determines nothing in some direction.
    """
    K = len(normal.right_camera)
    flight = FlightFactor.of(normal, damping, slack=slack)
    B = normal.border.reshape(-1, K)
    carried = flight.solve(B)
    # The reduced camera system (Triggs et al. 2000, section 6): S = C - B' A^-1 B, A less its slack.
    schur = normal.corner * (1 + damping * np.eye(K)) - B.T @ carried
    # Unknowns in radians and in pixels side by side: scaled to a unit diagonal before they are inverted.
    scale = 1 / np.sqrt(np.maximum(np.diag(schur), np.finfo(float).tiny))
    unit = schur * scale[:, None] * scale
    inverse = cho_solve(cho_factor((unit + unit.T) / 2), np.eye(K)) * scale[:, None] * scale
    return Factor(flight, carried, (inverse + inverse.T) / 2)


def _banded(block: Array, damping: float) -> Array:
    """LAPACK's upper banded storage (12, 3M) of the symmetric block band (ORDER, M, 3, 3)."""
    M = block.shape[1]
    band = np.zeros((SUPERDIAGONALS + 1, 3 * M))
    for k in range(ORDER):
        for row in range(3):
            for column in range(row if k == 0 else 0, 3):
                distance = 3 * k + column - row
                band[SUPERDIAGONALS - distance, 3 * k + column :: 3] = block[k, : M - k, row, column]
    band[-1] *= 1 + damping
    return band


def local_covariance(block: Array) -> Array:
    """(M - 3, 4, 3, 4, 3) covariance, cameras held fixed, of each run of four neighbouring control points.

    Only the inverse's entries near the diagonal, by the block-tridiagonal recursion (Takahashi, Fagan and Chin 1973):
    linear in M, where the whole inverse would be quadratic.
    """
    M = block.shape[1]
    size = 3 * BLOCK_POINTS
    count = -(-M // BLOCK_POINTS)
    dense = _padded_blocks(block, count)
    diagonal, above = dense[:, :, :size], dense[:, :, size:]
    gain = np.empty((count, size, size))
    conditional = np.empty((count, size, size))
    pivot = diagonal[0]
    for i in range(count):
        # Forward: the block Cholesky's pivots, D_i = A_ii - A_i,i-1 D_i-1^-1 A_i-1,i, and G_i = D_i^-1 A_i,i+1.
        conditional[i] = np.linalg.inv(pivot)
        gain[i] = conditional[i] @ above[i]
        if i + 1 < count:
            pivot = diagonal[i + 1] - above[i].T @ gain[i]
    return _backward(conditional, gain, M)


def _padded_blocks(block: Array, count: int) -> Array:
    """(count, s, 2 s) diagonal and next blocks of the band; control points beyond M are made independent."""
    M, size = block.shape[1], 3 * BLOCK_POINTS
    dense = np.zeros((count, size, 2 * size))
    points = np.arange(M)
    owner, inside = points // BLOCK_POINTS, points % BLOCK_POINTS
    for k in range(ORDER):
        for row in range(3):
            for column in range(3):
                value = block[k, : M - k, row, column]
                o, p = owner[: M - k], inside[: M - k]
                dense[o, 3 * p + row, 3 * (p + k) + column] = value
                if k:  # the mirrored entry, where it falls into the diagonal block
                    within = p + k < BLOCK_POINTS
                    dense[o[within], 3 * (p[within] + k) + column, 3 * p[within] + row] = value[within]
    beyond = np.arange(3 * (M - (count - 1) * BLOCK_POINTS), size)
    dense[-1, beyond, beyond] = 1.0
    return dense


def _backward(conditional: Array, gain: Array, M: int) -> Array:
    count, size = conditional.shape[:2]
    result = np.empty((M - ORDER + 1, ORDER, 3, ORDER, 3))
    own = conditional[-1]
    joint = np.zeros((2 * size, 2 * size))
    for i in range(count - 1, -1, -1):
        joint[size:, size:] = own
        if i < count - 1:
            # Takahashi's recursion: S_i,i+1 = -G_i S_i+1,i+1 and S_ii = D_i^-1 + G_i S_i+1,i+1 G_i'.
            cross = -gain[i] @ own
            joint[:size, size:], joint[size:, :size] = cross, cross.T
            own = conditional[i] - cross @ gain[i].T
        else:
            joint[:size, size:] = joint[size:, :size] = 0
            own = conditional[i]
        joint[:size, :size] = own
        for point in range(min(BLOCK_POINTS, M - ORDER + 1 - i * BLOCK_POINTS)):
            at = slice(3 * point, 3 * (point + ORDER))
            result[i * BLOCK_POINTS + point] = joint[at, at].reshape(ORDER, 3, ORDER, 3)
    return result

"""The two chains under study, each a function from what is believed and seen to 300 positions.

The classical chain is the published one: the essential matrix of the first two cameras from eight points or more by
SVD, the pose with most points in front of both, triangulation by SVD, the third camera by EPnP, and a similarity to
the surveyed positions. Each step takes the one before as exact, which is where its metres come from. Ours starts the
same way and then adjusts everything together (calib.solving.solve).
"""

from typing import Final

import cv2
import numpy as np

from calib.geometry.similarity import fit_similarity
from calib.geometry.twoview import decompose, essential_by_svd, triangulate
from calib.observations import Scene
from calib.solving.solve import SolveOptions, solve
from edge.common.arrays import Array
from edge.lens import pixel_to_ray
from tools.paper.study import INTERVAL_S, SAMPLES, seen

# Without any error a knot a sample lets the flight follow the true one, whose knots are elsewhere, to the last digit.
EXACT: Final = SolveOptions(knots_s=INTERVAL_S)
USUAL: Final = SolveOptions()


def classical(scene: Scene) -> Array:
    """(300, 3) ENU positions by the published chain."""
    rays = [pixel_to_ray(camera.lens, own) for camera, own in zip(scene.cameras, seen(scene), strict=True)]
    R, t = _relative_pose(rays[0], rays[1])
    rotations, centres = [np.eye(3), R], [np.zeros(3), -R.T @ t]
    points = triangulate(rays[:2], rotations, centres)
    R3, centre3 = _epnp(points, rays[2])
    poses = np.array([*centres, centre3])
    surveyed = np.array([camera.position_enu for camera in scene.cameras])
    return fit_similarity(poses, surveyed).similarity.apply(triangulate(rays, [*rotations, R3], list(poses)))


def _relative_pose(rays1: Array, rays2: Array) -> tuple[Array, Array]:
    def in_front(pose: tuple[Array, Array]) -> int:
        R, t = pose
        centre = -R.T @ t
        points = triangulate([rays1, rays2], [np.eye(3), R], [np.zeros(3), centre])
        return int(((points[:, 2] > 0) & ((points - centre) @ R[2] > 0)).sum())

    return max(decompose(essential_by_svd(rays1, rays2)), key=in_front)


def _epnp(points: Array, rays: Array) -> tuple[Array, Array]:
    _, rotation, t = cv2.solvePnP(points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_EPNP)
    R = cv2.Rodrigues(rotation)[0]
    return R, -R.T @ t.ravel()


def ours(scene: Scene, options: SolveOptions) -> Array:
    """(300, 3) ENU positions by the adjustment. Raises CalibrationError if it refuses."""
    trajectory = solve(scene, options).trajectory
    first = scene.observations[scene.cameras[0].id].t_unix_ns[0]
    stamps = first + np.arange(SAMPLES, dtype=np.int64) * round(INTERVAL_S * 1e9)
    longest = np.argmax(np.bincount(trajectory.track))
    own = trajectory.track == longest
    row = np.searchsorted(trajectory.t_unix_ns[own], stamps)
    row = np.minimum(row, int(own.sum()) - 1)
    positions: Array = trajectory.points_enu[own][row]
    positions[trajectory.t_unix_ns[own][row] != stamps] = np.nan  # a sample without a row counts as a failure
    return positions

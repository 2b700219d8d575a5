"""What a settled network is refused for: a world upside down, claims beyond mending, a flight that determines nothing.

The hazard is the answer that looks like one. Each refusal here names the cause that was tested, and what to do.
"""

from typing import Final

import numpy as np

from calib.errors import CalibrationError, UndeterminedError
from calib.network import Network
from calib.solving.findings import contradiction
from calib.solving.georeference import CHECK_UP, OVERTURNED
from calib.solving.inputs import Inputs
from calib.solving.solution import Trajectory
from calib.solving.strain import BEYOND_DOUBT, Strain
from calib.solving.upright import upside_down
from edge.common.arrays import Array

ABSURD_SHARE: Final = 0.3  # of the distance, one sigma: a solution that open is none
FARTHEST_FLOWN_M: Final = 50e3  # from the cameras: beyond it, nothing that flies is more than a speck
MOST_FAR: Final = 0.01  # of the positions, that may lie beyond: outliers
FLY_WIDER: Final = "fly a path with more width and height that at least three cameras see together"


def refuse(network: Network, trajectory: Trajectory, inputs: Inputs, strained: Strain | None) -> None:
    """Raises CalibrationError for a network that cannot be, or that says itself that it knows nothing."""
    _refuse_strained(network, strained)
    _refuse_overturned(network, trajectory, inputs)
    _refuse_absurd(network, trajectory, strained)


def _distance_m(network: Network, trajectory: Trajectory) -> Array:
    """(M,) of what was flown, from the middle of the cameras."""
    middle = network.centres_enu.mean(axis=0)
    return np.asarray(np.linalg.norm(trajectory.points_enu - middle, axis=1), float)


def open_share(network: Network, trajectory: Trajectory) -> float:
    """Median one sigma of the positions, as a share of their distance from the cameras."""
    sigma = np.sqrt(np.trace(trajectory.covariance_enu, axis1=1, axis2=2))
    return float(np.median(sigma / _distance_m(network, trajectory)))


def _refuse_strained(network: Network, strained: Strain | None) -> None:
    """Raises CalibrationError for priors that contradict the cameras in a way that nothing known explains."""
    if strained is not None and strained.p_value_allowed < BEYOND_DOUBT:
        raise CalibrationError(
            f"survey, lens files and clocks contradict what the cameras saw {strained.figures}, and no one of them "
            "alone explains it",
            where=network.site,
            action="check that each camera has its own lens file, position and tracks",
        )


def _refuse_overturned(network: Network, trajectory: Trajectory, inputs: Inputs) -> None:
    """Raises CalibrationError for a world upside down; a local frame has no up."""
    if all(inputs.sites[camera.id].position_enu is None for camera in network.cameras):
        return
    ups = {camera.id: up for camera in network.cameras if (up := inputs.sites[camera.id].up_cam) is not None}
    if ups:
        overturned = [c.id for c in network.cameras if c.id in ups and float(c.R_cam_enu[:, 2] @ ups[c.id]) < 0]
        if overturned:
            raise CalibrationError(
                f"{', '.join(overturned)}: by survey and flight up is where its up_cam says down is",
                where=network.site,
                action="correct up_cam, or look for exchanged positions",
            )
        return
    centres = network.centres_enu
    if upside_down([camera.R_cam_enu for camera in network.cameras], centres, trajectory.points_enu):
        raise CalibrationError(OVERTURNED, where=network.site, action=CHECK_UP)


def _refuse_absurd(network: Network, trajectory: Trajectory, strained: Strain | None) -> None:
    """Raises CalibrationError for a network that says itself that it knows nothing."""
    if len(trajectory.points_enu) == 0:
        raise CalibrationError("no two cameras see the object at once", where=network.site, action=FLY_WIDER)
    share = open_share(network, trajectory)
    far = _distance_m(network, trajectory) > FARTHEST_FLOWN_M
    if far.mean() > MOST_FAR:
        raise UndeterminedError(
            f"the cameras' rays are as good as parallel: {100 * far.mean():.0f} % of them would meet more than "
            f"{FARTHEST_FLOWN_M / 1e3:.0f} km away",
            where=network.site,
            action="stand the cameras farther apart, or fly nearer to them",
        )
    if share < ABSURD_SHARE:
        return
    if strained is not None and strained.doubts:
        raise UndeterminedError(
            f"{contradiction(strained, len(network.cameras))}; without all of these the positions are open by "
            f"{100 * share:.0f} % of the distance",
            where=network.site,
            action="correct what is wrong and solve again",
        )
    raise UndeterminedError(
        f"the flight does not determine the network: positions are open by {100 * share:.0f} % of the distance",
        where=network.site,
        action=FLY_WIDER,
    )

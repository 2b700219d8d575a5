"""Cameras that know where up is: a level on the tripod's head, or the box's own accelerometer."""

from dataclasses import replace

import numpy as np

from calib.simulation.simulation import Simulated
from tools.doubles.hazards.brought import with_sites


def levelled(
    simulated: Simulated,
    rng: np.random.Generator,
    sigma_deg: float,
    claimed_deg: float,
    names: tuple[str, ...] | None = None,
) -> Simulated:
    """The scene in which cameras know where up is, to sigma_deg a horizontal axis, and say claimed_deg.

    names: of these cameras; all if None.
    """
    sites = {}
    for site, truth in zip(simulated.scene.cameras, simulated.network.cameras, strict=True):
        east, north = np.radians(sigma_deg) * rng.normal(0.0, 1.0, 2)
        up = truth.R_cam_enu @ np.array([east, north, 1.0])
        if names is None or site.id in names:
            sites[site.id] = replace(site, up_cam=up / np.linalg.norm(up), up_sigma_deg=claimed_deg)
    return with_sites(simulated, sites)

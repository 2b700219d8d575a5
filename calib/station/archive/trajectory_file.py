"""trajectory.csv: where the objects were, in every frame that somebody may want it in (deploy/CONTRACTS.md).

One hazard is a file of numbers that nobody can place a year later. So a line above the header says about which origin
its local frame is, which program wrote it, and from what. No time of writing: the same input gives the same bytes.
Another is rounding: an uncertainty of seventy metres along a ray and a decimetre across it is no covariance any more
when its entries are cut to four digits. It keeps nine.
"""

from pathlib import Path
from typing import Final

import numpy as np

from calib.geodesy import Origin, enu_to_ecef, enu_to_geodetic
from calib.solving.solution import Trajectory
from edge import __version__
from edge.common.atomic import write_atomically

TRAJECTORY_HEADER: Final = (
    "t_unix_ns,track,x_m,y_m,z_m,east_m,north_m,up_m,sigma_east_m,sigma_north_m,sigma_up_m,cameras,"
    "lat_deg,lon_deg,height_m,cov_en_m2,cov_eu_m2,cov_nu_m2"
)


def write_trajectory(trajectory: Trajectory, origin: Origin, source: str, path: Path) -> None:
    """Write it, whole or not at all. source: what it was solved from."""
    ecef, geodetic = enu_to_ecef(trajectory.points_enu, origin), enu_to_geodetic(trajectory.points_enu, origin)
    covariance = trajectory.covariance_enu
    sigma, mixed = np.sqrt(np.einsum("nii->ni", covariance)), covariance[:, [0, 0, 1], [1, 2, 2]]
    rows = [
        f"{t},{track},{x:.4f},{y:.4f},{z:.4f},{e:.4f},{n:.4f},{u:.4f},{se:.8g},{sn:.8g},{su:.8g},{cameras},"
        f"{lat:.9f},{lon:.9f},{height:.4f},{en:.8e},{eu:.8e},{nu:.8e}"
        for t, track, (x, y, z), (e, n, u), (se, sn, su), cameras, (lat, lon, height), (en, eu, nu) in zip(
            trajectory.t_unix_ns.tolist(),
            trajectory.track.tolist(),
            ecef.tolist(),
            trajectory.points_enu.tolist(),
            sigma.tolist(),
            trajectory.cameras.tolist(),
            geodetic.tolist(),
            mixed.tolist(),
            strict=True,
        )
    ]
    write_atomically(path, "\n".join([about(origin, source), TRAJECTORY_HEADER, *rows, ""]).encode())


def about(origin: Origin, source: str) -> str:
    """The line above the header."""
    lat, lon, height = origin
    name = " ".join(source.split())  # a line break in a file's name must not begin a row
    return f"# origin {lat:.9f} {lon:.9f} {height:.4f} (lat_deg lon_deg height_m), skyfix {__version__}, from {name}"

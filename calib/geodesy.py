"""WGS 84 at the border: geodetic <-> ECEF <-> the site's local east-north-up frame.

The hazard is conditioning: at 6.4e6 m a float32 has half-metre steps and a similarity fitted to raw ECEF has a
condition number of 1e12. So everything is estimated in ENU about a fixed origin, in float64, and these functions are
called only where a survey comes in and a position goes out. The arithmetic is pymap3d's.
"""

import numpy as np
import pymap3d

from edge.common.arrays import Array

Origin = tuple[float, float, float]  # latitude deg, longitude deg, ellipsoidal height m


def geodetic_to_enu(geodetic: Array, origin: Origin) -> Array:
    """(N, 3) ENU metres about `origin` of (N, 3) latitude deg, longitude deg, ellipsoidal height m."""
    lat, lon, height = np.asarray(geodetic, float).reshape(-1, 3).T
    return np.column_stack(pymap3d.geodetic2enu(lat, lon, height, *origin))


def mean_position(geodetic: Array) -> Origin:
    """The middle of (N, 3) latitude deg, longitude deg, ellipsoidal height m, all of one site.

    Its place is that of the mean in ECEF: degrees have no mean across the date line or at a pole.
    """
    places = np.asarray(geodetic, float).reshape(-1, 3)
    ecef = np.column_stack(pymap3d.geodetic2ecef(*places.T))
    latitude, longitude, _ = pymap3d.ecef2geodetic(*ecef.mean(axis=0))
    return float(latitude), float(longitude), float(places[:, 2].mean())


def enu_to_geodetic(enu: Array, origin: Origin) -> Array:
    """(N, 3) latitude deg, longitude deg, ellipsoidal height m of (N, 3) ENU metres about `origin`."""
    east, north, up = np.asarray(enu, float).reshape(-1, 3).T
    return np.column_stack(pymap3d.enu2geodetic(east, north, up, *origin))


def enu_to_ecef(enu: Array, origin: Origin) -> Array:
    """(N, 3) ECEF metres of (N, 3) ENU metres about `origin`."""
    east, north, up = np.asarray(enu, float).reshape(-1, 3).T
    return np.column_stack(pymap3d.enu2ecef(east, north, up, *origin))


def ecef_to_enu(ecef: Array, origin: Origin) -> Array:
    """(N, 3) ENU metres about `origin` of (N, 3) ECEF metres."""
    x, y, z = np.asarray(ecef, float).reshape(-1, 3).T
    return np.column_stack(pymap3d.ecef2enu(x, y, z, *origin))


def ecef_to_geodetic(ecef: Array) -> Array:
    """(N, 3) latitude deg, longitude deg, ellipsoidal height m of (N, 3) ECEF metres."""
    x, y, z = np.asarray(ecef, float).reshape(-1, 3).T
    return np.column_stack(pymap3d.ecef2geodetic(x, y, z))


def R_ecef_enu(origin: Origin) -> Array:
    """(3, 3) rotation that takes ENU vectors at `origin` to ECEF: for velocities and covariances."""
    lat, lon = np.radians(origin[:2])
    east = [-np.sin(lon), np.cos(lon), 0.0]
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return np.column_stack([east, north, up])

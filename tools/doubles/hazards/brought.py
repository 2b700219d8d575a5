"""A scene as somebody brings it, with the truth beside it: what is wrong in it, and whose fault that is.

The hazard is a judge who counts a true sentence as an accusation of somebody innocent: a healthy lens file is off by a
per cent, too. So whoever brings a scene states only what the kind is about; what else is off by more than it claims is
read from the truth (`off`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.observations import Observations, SiteCamera
from calib.simulation.simulation import Rows, Simulated
from calib.solving.found import Cause

OFF_SIGMAS: Final = 4.0  # a surveyed position that far off in one direction is not what its sigma says
OFF_FOCAL: Final = 0.008  # a lens file that far off may be told so: what the solver tells begins at 0.01
OFF_CLOCK_S: Final = 2e-3  # beyond its bound


@dataclass(frozen=True)
class Fault:
    """What is wrong with which cameras."""

    cause: Cause
    cameras: tuple[str, ...]


@dataclass(frozen=True)
class Brought:
    """simulated: the scene and its truth. faults: what the kind is about. note: in words, what was done.

    healthy: whether it must be solved. says_origin: whether the site file states one. time_free: no clock is vouched
    for and some are off, so that nobody can know the site's time.
    """

    simulated: Simulated
    faults: tuple[Fault, ...] = ()
    note: str = ""
    healthy: bool = False
    says_origin: bool = True
    time_free: bool = False

    @property
    def cameras(self) -> tuple[str, ...]:
        """Their names, in the scene's order."""
        return tuple(camera.id for camera in self.simulated.scene.cameras)

    @property
    def guilty(self) -> frozenset[str]:
        """Every camera that something is wrong with."""
        stated = {name for fault in (*self.faults, *off(self.simulated)) for name in fault.cameras}
        return frozenset(stated)


def off(simulated: Simulated) -> tuple[Fault, ...]:
    """What the site file says and is not so, beyond what it claims."""
    truth = {camera.id: camera for camera in simulated.network.cameras}
    sites = simulated.scene.cameras
    position = tuple(site.id for site in sites if _position_off(site, truth[site.id].centre_enu))
    lens = tuple(
        site.id
        for site in sites
        if abs(site.lens.intrinsics[0] / truth[site.id].lens.intrinsics[0] - 1) > OFF_FOCAL
        or site.lens.size_px != truth[site.id].lens.size_px
    )
    clock = tuple(
        site.id for site in sites if abs(truth[site.id].clock_offset_s) > (site.clock_bound_s or 0.0) + OFF_CLOCK_S
    )
    found = ((Cause.POSITION, position), (Cause.LENS, lens), (Cause.CLOCK, clock))
    return tuple(Fault(cause, names) for cause, names in found if names)


def _position_off(site: SiteCamera, centre_enu: np.ndarray) -> bool:
    if site.position_enu is None or site.position_covariance is None:
        return False
    sigma = np.sqrt(np.diag(site.position_covariance))
    return bool(np.any(np.abs(site.position_enu - centre_enu) > OFF_SIGMAS * sigma))


def with_rows(simulated: Simulated, rows: Mapping[str, Rows]) -> Simulated:
    """The scene in which some cameras report other rows."""
    seen = {name: Observations(own.t_unix_ns, own.pixels, own.track, None) for name, own in rows.items()}
    scene = replace(simulated.scene, observations={**simulated.scene.observations, **seen})
    return replace(simulated, scene=scene, rows={**simulated.rows, **rows})


def with_sites(simulated: Simulated, sites: Mapping[str, SiteCamera]) -> Simulated:
    """The scene in which the site file says something else of some cameras."""
    cameras = tuple(sites.get(camera.id, camera) for camera in simulated.scene.cameras)
    return replace(simulated, scene=replace(simulated.scene, cameras=cameras))

"""Lens files that are not of this camera, or not of what was detected: focal length, distortion, size, mirrored."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from calib.observations import SiteCamera
from calib.simulation.description import LensFault, Simulation
from calib.simulation.simulation import Rows, Simulated, simulate
from calib.solving.found import Cause
from edge.common.arrays import Array
from edge.lens import LensModel, pixel_to_ray
from tools.doubles.hazards import scenery
from tools.doubles.hazards.brought import Brought, Fault, with_rows, with_sites
from tools.doubles.hazards.table import Kind

OFF: Final = (0.02, 0.03, 0.05, 0.08, 0.10)  # of the focal length, guessed or of another camera
ACTION_CAMERA: Final = (-0.25, 0.06, 0.0, 0.0)  # radtan, as wide phones and action cameras have
LANDSCAPE_PX: Final = (1920, 1080)
PORTRAIT: Final[dict[str, Any]] = {"size_px": (1080, 1920), "intrinsics": (1000.0, 1000.0, 540.0, 960.0)}
MEASURED: Final[dict[str, Any]] = {"lens_error": LensFault()}  # the kind's own error is all there is


def _names(simulation: Simulation) -> tuple[str, ...]:
    return tuple(camera.id for camera in simulation.camera)


def _focal_off(rng: np.random.Generator, *, everyone: bool) -> Brought:
    simulation = scenery.usual(rng, **MEASURED)
    names = _names(simulation) if everyone else scenery.some(rng, simulation)
    off = float(rng.choice(OFF)) * float(rng.choice([-1, 1]))
    fx, fy, cx, cy = simulation.camera[0].intrinsics
    keys = {name: {"published_intrinsics": (fx * (1 + off), fy * (1 + off), cx, cy)} for name in names}
    return Brought(
        simulate(scenery.changed(simulation, keys)), (Fault(Cause.LENS, names),), f"focal {100 * off:+.0f} %"
    )


def _other_zoom(rng: np.random.Generator) -> Brought:
    """One camera has the lens file of another with a longer or wider lens."""
    simulation = scenery.usual(rng, scenery.usual_count(rng, 4), **MEASURED)
    names = scenery.some(rng, simulation)
    focal = float(rng.choice([600.0, 700.0, 1300.0, 1500.0]))
    keys = {names[0]: {"published_intrinsics": (focal, focal, 960.0, 540.0)}}
    return Brought(
        simulate(scenery.changed(simulation, keys)), (Fault(Cause.LENS, names),), f"focal {focal:g} for 1000"
    )


def _without_distortion(rng: np.random.Generator) -> Brought:
    simulation = scenery.usual(rng, distortion=ACTION_CAMERA, published_distortion=(0.0,) * 4, **MEASURED)
    return Brought(simulate(simulation), (Fault(Cause.LENS, _names(simulation)),), "distortion left out")


def _undistorted_twice(rng: np.random.Generator) -> Brought:
    """The pixels are those of undistorted pictures, the lens file has the distortion still."""
    simulated = simulate(scenery.usual(rng, distortion=ACTION_CAMERA, **MEASURED))
    lenses = {camera.id: camera.lens for camera in simulated.network.cameras}
    names = tuple(lenses)
    straight = _pixels(simulated, names, lambda pixels, name: _straightened(lenses[name], pixels))
    return Brought(straight, (Fault(Cause.LENS, names),), "distortion taken out twice")


def _straightened(lens: LensModel, pixels: Array) -> Array:
    fx, fy, cx, cy = lens.intrinsics
    return np.asarray(pixel_to_ray(lens, pixels) * (fx, fy) + (cx, cy))


def _pixels(simulated: Simulated, names: tuple[str, ...], bend: Callable[[Array, str], Array]) -> Simulated:
    """The scene in which some cameras report other pixels; rows whose pixel is none then are not reported."""
    rows = {}
    for name in names:
        own = simulated.rows[name]
        pixels = bend(own.pixels, name)
        keep = np.isfinite(pixels[:, 0])
        rows[name] = Rows(own.t_unix_ns[keep], pixels[keep], own.track[keep], own.source[keep], own.size_px[keep])
    return with_rows(simulated, rows)


def _of(site: SiteCamera, size_px: tuple[int, int], focal_px: float) -> SiteCamera:
    """The camera with the lens file of another picture size."""
    intrinsics = (focal_px, focal_px, size_px[0] / 2, size_px[1] / 2)
    return replace(site, lens=replace(site.lens, intrinsics=intrinsics, size_px=size_px))


def _other_resolution(rng: np.random.Generator, *, everyone: bool) -> Brought:
    """A lens file of the 4K mode, tracks of the 1080p mode."""
    simulation = scenery.usual(rng, None if everyone else 4, **MEASURED)
    names = _names(simulation) if everyone else scenery.some(rng, simulation)
    simulated = simulate(simulation)
    large = {site.id: _of(site, (3840, 2160), 2000.0) for site in simulated.scene.cameras if site.id in names}
    return Brought(with_sites(simulated, large), (Fault(Cause.LENS, names),), "lens file of 4K")


def _portrait(rng: np.random.Generator, *, everyone: bool) -> Brought:
    """Portrait tracks, the lens file of the landscape picture."""
    simulation = scenery.usual(rng, None if everyone else 4, **MEASURED)
    names = _names(simulation) if everyone else scenery.some(rng, simulation)
    simulated = simulate(scenery.changed(simulation, dict.fromkeys(names, PORTRAIT)))
    landscape = {site.id: _of(site, LANDSCAPE_PX, 1000.0) for site in simulated.scene.cameras if site.id in names}
    return Brought(with_sites(simulated, landscape), (Fault(Cause.LENS, names),), "landscape lens file")


def _mirrored(rng: np.random.Generator, *, axis: int, everyone: bool = True) -> Brought:
    """Pixels counted from the other side: a mirrored video, or v upwards from the bottom."""
    simulation = scenery.usual(rng, None if everyone else scenery.usual_count(rng, 4))
    names = _names(simulation) if everyone else scenery.some(rng, simulation)
    last = np.array(LANDSCAPE_PX) - 1.0

    def turned(pixels: Array, _: str) -> Array:
        other = pixels.copy()
        other[:, axis] = last[axis] - other[:, axis]
        return other

    return Brought(_pixels(simulate(simulation), names, turned), (Fault(Cause.TRACKS, names),), f"of {' '.join(names)}")


LENSES: Final = (
    Kind("focal_all", partial(_focal_off, everyone=True)),
    Kind("focal_one", partial(_focal_off, everyone=False)),
    Kind("other_zoom_one", _other_zoom),
    Kind("distortion_left_out", _without_distortion),
    Kind("distortion_twice", _undistorted_twice),
    Kind("lens_of_4k_all", partial(_other_resolution, everyone=True)),
    Kind("lens_of_4k_one", partial(_other_resolution, everyone=False)),
    Kind("portrait_all", partial(_portrait, everyone=True)),
    Kind("portrait_one", partial(_portrait, everyone=False)),
    Kind("mirrored_u_all", partial(_mirrored, axis=0)),
    Kind("v_upwards_all", partial(_mirrored, axis=1)),
    Kind("mirrored_u_one", partial(_mirrored, axis=0, everyone=False)),
)

"""Beginnings from the survey: where cameras may look if they stand where they were surveyed.

The hazard is the near-parallel ray. If the object is far against the base, or the tripods stand in a line, the relative
pose of a pair is bent beyond use by lenses a per cent off, and the scaffold lands in a basin from which the adjustment
does not come back: fifteen metres in front of the cameras instead of three kilometres away, or rolled about their line.
But the centres are known to centimetres. With them each camera's attitude is three numbers, found by Kabsch's fit of
directions for any assumed attitude and distance of one of them; the assumptions that the rays bear out are begun with.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from calib.geometry.rays import directions_cam
from calib.geometry.rotation import fit_rotation, rotation
from calib.geometry.similarity import HOLD_A_FRAME, UNCHANGED, about
from calib.geometry.twoview import reprojection, triangulate
from calib.network import Camera
from calib.observations import SiteCamera
from calib.solving.bootstrap import in_frame, to_enu
from calib.solving.clock_consensus import Clock
from calib.solving.inputs import Inputs
from calib.solving.scaffold import Pose
from calib.solving.series import even
from edge.common.arrays import Array

COMPARED_INSTANTS: Final = 60  # that the assumptions are judged by
FEWEST_INSTANTS: Final = 20  # of them that another camera must share
HEADINGS_RAD: Final = np.radians(np.arange(0.0, 360.0, 15.0))
ELEVATIONS_RAD: Final = np.radians(np.arange(-20.0, 80.0, 15.0))
ROLLS_RAD: Final = np.radians([0.0, 90.0, -90.0])  # pictures upright, and cameras on their sides
DISTANCES: Final = (0.5, 1.0, 2.0, 5.0, 15.0, 50.0, 200.0)  # of the object, in longest distances between two cameras
TRIED: Final = 4  # assumptions of each distance that are bettered by turns
TURNS: Final = 10  # of triangulating with the attitudes and fitting the attitudes to the points
APART_RAD: Final = 0.05  # between two beginnings that are not the same
BEGINNINGS: Final = 4  # beginnings that are gone on with
ROLL_STEPS: Final = 12  # about the line that cameras stand in: an adjustment comes back from half of 30 degrees


def from_survey(inputs: Inputs, clocks: dict[str, Clock]) -> list[tuple[Camera, ...]]:
    """Cameras as the survey and their longest tracks allow them to stand, the likeliest first.

    None for under three surveyed cameras, or two of which one says where up is.

    clocks: of the cameras that are to take part.
    """
    offsets = {name: clock.offset_s for name, clock in clocks.items()}
    names = [name for name in sorted(clocks) if inputs.sites[name].position_enu is not None and name in inputs.tracks]
    fewest = 2 if any(inputs.sites[name].up_cam is not None for name in names) else HOLD_A_FRAME
    if len(names) < fewest:
        return []
    first = max(names, key=lambda name: inputs.tracks[name][0].duration_s)
    names = [first, *(name for name in names if name != first)]
    longest = {name: inputs.tracks[name][0].stretched(clocks[name].rate) for name in names}
    t_s = longest[first].t_s[even(len(longest[first].t_s), COMPARED_INSTANTS)] + offsets[first]
    rays = {name: longest[name].at(t_s - offsets[name]) for name in names}
    names = [name for name in names if int(np.isfinite(rays[name][:, 0]).sum()) >= FEWEST_INSTANTS]
    if len(names) < fewest:
        return []
    centres = np.array([inputs.sites[name].position_enu for name in names], float)
    found = _kept(_bettered([rays[name] for name in names], centres))
    return [
        tuple(
            _camera(inputs.sites[name], R, centre, clocks[name])
            for name, R, centre in sorted(zip(names, attitudes, centres, strict=True), key=lambda entry: entry[0])
        )
        for attitudes in found
    ]


def _camera(site: SiteCamera, R: Array, centre: Array, clock: Clock) -> Camera:
    return replace(to_enu(Pose(R, centre, 1.0), site, UNCHANGED, clock.offset_s), clock_rate=clock.rate)


def _bettered(rays: list[Array], centres: Array) -> list[tuple[float, Array]]:
    """(misfit, attitudes (C, 3, 3)) of the assumptions that fit best, after some turns; rays: (T, 2) by camera."""
    directions = np.array([directions_cam(ray) for ray in rays])
    return sorted(
        (_turned(rays, directions, centres, R) for R in _assumed(directions, centres)), key=lambda one: one[0]
    )


def _assumed(directions: Array, centres: Array) -> Array:
    """(N, C, 3, 3) attitudes that the rays bear out, TRIED of each distance, over a grid of the first camera's."""
    spread_m = max(float(np.linalg.norm(one - two)) for one in centres for two in centres)
    first = np.array([_attitude(h, e, r) for h in HEADINGS_RAD for e in ELEVATIONS_RAD for r in ROLLS_RAD])
    seen = np.nan_to_num(directions)
    weight = np.isfinite(directions[:, :, 0]).astype(float)
    towards = np.einsum("gji,tj->gti", first, seen[0])
    chosen = []
    for distance in DISTANCES:
        points = centres[0] + distance * spread_m * towards
        own, misfit = [first], np.zeros(len(first))
        for one, centre, w in zip(seen[1:], centres[1:], weight[1:], strict=True):
            R, off = _fitted(one, points - centre, w * weight[0])
            own.append(R)
            misfit += off
        chosen.append(np.stack(own, axis=1)[np.argsort(misfit, kind="stable")[:TRIED]])
    return np.concatenate(chosen)


def _attitude(heading_rad: float, elevation_rad: float, roll_rad: float) -> Array:
    """R_cam_enu of a camera that looks there."""
    north, east = np.cos(heading_rad), np.sin(heading_rad)
    forward = np.array([east, north, 0.0]) * np.cos(elevation_rad) + [0, 0, np.sin(elevation_rad)]
    right = np.array([north, -east, 0.0])
    down = np.cross(forward, right)
    cos, sin = np.cos(roll_rad), np.sin(roll_rad)
    return np.array([cos * right + sin * down, cos * down - sin * right, forward])


def _fitted(seen: Array, towards: Array, weight: Array) -> tuple[Array, Array]:
    """Attitudes (G, 3, 3) that take directions (G, T, 3) closest to seen ones (T, 3), and the rms angle (G,)."""
    towards = towards / np.linalg.norm(towards, axis=2, keepdims=True)
    R = fit_rotation(seen, towards, weight)
    off = seen - np.einsum("gij,gtj->gti", R, towards)
    return R, np.sqrt(((off**2).sum(2) * weight).sum(1) / max(float(weight.sum()), 1.0))


def _turned(rays: list[Array], directions: Array, centres: Array, attitudes: Array) -> tuple[float, Array]:
    """Triangulate, fit the attitudes to the points, and again; the median misfit in ray units at the end."""
    seen = np.nan_to_num(directions)
    for _ in range(TURNS):
        points = triangulate(rays, list(attitudes), list(centres))
        ok = np.asarray(np.isfinite(points).all(1), float)
        points = np.nan_to_num(points, posinf=0.0, neginf=0.0)
        attitudes = np.array(
            [
                _fitted(one, (points - centre)[None], ok * np.isfinite(ray[:, 0]))[0][0]
                for one, ray, centre in zip(seen, rays, centres, strict=True)
            ]
        )
    off = [reprojection(points, ray, R, c) for ray, R, c in zip(rays, attitudes, centres, strict=True)]
    return float(np.nanmedian(np.concatenate(off))), attitudes


def _kept(found: list[tuple[float, Array]]) -> list[Array]:
    """The best few that differ."""
    kept: list[Array] = []
    for misfit, attitudes in found:
        apart = [float(np.abs(attitudes - other).max()) for other in kept]
        if np.isfinite(misfit) and all(far > APART_RAD for far in apart):
            kept.append(attitudes)
    return kept[:BEGINNINGS]


def rolled(cameras: tuple[Camera, ...], sites: dict[str, SiteCamera]) -> Iterator[tuple[Camera, ...]]:
    """The cameras turned about the line that their surveyed positions are nearest to, all the way round."""
    surveyed = np.array([sites[c.id].position_enu for c in cameras if sites[c.id].position_enu is not None], float)
    middle = surveyed.mean(0)
    along = np.linalg.svd(surveyed - middle)[2][0]
    for angle_rad in 2 * np.pi * np.arange(1, ROLL_STEPS) / ROLL_STEPS:
        about_line = about(middle, rotation(angle_rad * along))
        yield tuple(in_frame(camera, about_line) for camera in cameras)

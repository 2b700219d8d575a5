"""From cameras roughly right to a first estimate: rows that another camera supports, knots laid, flight triangulated.

Nothing here is accurate; everything here must be right to a few per cent, because the adjustment only walks downhill.
The hazard is a stretch of flight that hardly two cameras saw: it is open in some direction and bends everything.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate
from calib.adjustment.priors import READOUT_S
from calib.adjustment.projection import CameraData, site_time_s
from calib.errors import CalibrationError
from calib.geometry.similarity import Similarity
from calib.geometry.spline import ORDER, Flight, lay_knots
from calib.geometry.twoview import triangulate
from calib.network import Camera
from calib.observations import Observations, Scene, SiteCamera
from calib.solving.identity import Key
from calib.solving.scaffold import Pose
from calib.solving.series import TrackSeries, gap_to_nearest_s
from edge.common.arrays import Array

SUPPORT_S: Final = 0.25  # another camera must have seen the object this close in time
LONGEST_UNSEEN_S: Final = 1.0  # a flight is not continued across a longer gap
SHORTEST_STRETCH_S: Final = 1.0  # a stretch has nine freedoms besides its jerk
FEWEST_STRETCH_ROWS: Final = 5  # of each of a stretch's two best cameras
HIGHEST_RATE_HZ: Final = 30.0  # rows beyond it are copies of their neighbours' error


def to_enu(pose: Pose, site: SiteCamera, similarity: Similarity, offset_s: float) -> Camera:
    """A scaffold pose as a camera of the site."""
    readout = site.readout_s if site.readout_s is not None else READOUT_S
    return in_frame(Camera(site.id, site.lens, pose.R, pose.centre, offset_s, 0.0, readout), similarity)


def in_frame(camera: Camera, similarity: Similarity) -> Camera:
    """A camera after a similarity of the world it stands in."""
    centre = similarity.apply(camera.centre_enu[None])[0]
    return replace(camera, R_cam_enu=camera.R_cam_enu @ similarity.rotation.T, centre_enu=centre)


def gather(
    observations: Observations, tracks: list[TrackSeries], objects: dict[Key, int], name: str, t_mid: int
) -> CameraData:
    """A camera's rows that show an identified object, in time order, thinned to HIGHEST_RATE_HZ."""
    known = [track for track in tracks if (name, track.number) in objects]
    kept = [track.row[_thinned(track.t_s)] for track in known]
    row = np.concatenate([*kept, np.zeros(0, np.int64)])
    target = np.repeat([objects[name, track.number] for track in known], [len(rows) for rows in kept]).astype(np.int64)
    order = np.argsort(row, kind="stable")
    row, target = row[order], target[order]
    relative = np.ones(len(row))
    if observations.sigma_px is not None and len(row):
        relative = np.asarray(observations.sigma_px[row] / np.median(observations.sigma_px[row]), float)
    return CameraData((observations.t_unix_ns[row] - t_mid) * 1e-9, observations.pixels[row], target, relative)


def _thinned(t_s: Array) -> NDArray[np.int64]:
    """Rows that start a new interval of 1 / HIGHEST_RATE_HZ."""
    slot = np.floor((t_s - t_s[0]) * HIGHEST_RATE_HZ + 0.25)
    return np.flatnonzero(np.concatenate([[True], np.diff(slot) > 0]))


def supported(cameras: tuple[Camera, ...], data: tuple[CameraData, ...]) -> tuple[CameraData, ...]:
    """The rows for which another camera saw the same object within SUPPORT_S."""
    times = [site_time_s(camera, seen) for camera, seen in zip(cameras, data, strict=True)]
    kept = []
    for index, seen in enumerate(data):
        keep = np.zeros(len(seen.t_s), bool)
        for target in np.unique(seen.target):
            own = seen.target == target
            others = np.sort(
                np.concatenate(
                    [t[d.target == target] for k, (t, d) in enumerate(zip(times, data, strict=True)) if k != index]
                )
            )
            keep[own] = gap_to_nearest_s(times[index][own], others) <= SUPPORT_S
        kept.append(seen.rows(keep))
    return tuple(kept)


def lay_flight(cameras: tuple[Camera, ...], data: tuple[CameraData, ...], spacing_s: float) -> Flight:
    """Knots under everything that is supported, stretches too short to say anything left out.

    Raises CalibrationError if nothing is left.
    """
    t = np.concatenate([site_time_s(camera, seen) for camera, seen in zip(cameras, data, strict=True)])
    target = np.concatenate([seen.target for seen in data])
    seer = np.repeat(np.arange(len(data)), [len(seen.t_s) for seen in data])
    if len(t):
        flight = lay_knots(t, target, spacing_s, LONGEST_UNSEEN_S)
        stretch = flight.stretch_of(t, target)
        keep = np.array([_says_enough(t[stretch == s], seer[stretch == s]) for s in range(len(flight.spans))])
        if keep.any():
            return Flight(flight.start_s[keep], flight.spans[keep], spacing_s, flight.target[keep])
    raise CalibrationError(
        "no object was seen by two cameras at once for long enough",
        where="tracks",
        action=f"fly where at least two cameras see it for {SHORTEST_STRETCH_S:.0f} s and more",
    )


def _says_enough(t_s: Array, seer: NDArray[np.int64]) -> bool:
    """Position, velocity and acceleration of a stretch need two cameras over a while."""
    rows = np.sort(np.unique(seer, return_counts=True)[1])[::-1]
    return bool(np.ptp(t_s) >= SHORTEST_STRETCH_S and len(rows) >= 2 and rows[1] >= FEWEST_STRETCH_ROWS)


def first_control(
    flight: Flight, cameras: tuple[Camera, ...], tracks: dict[str, list[TrackSeries]], objects: dict[Key, int]
) -> Array:
    """Control points (M, 3) from triangulation at the knots; gaps bridged by straight lines."""
    control = np.empty((flight.controls, 3))
    for first, start, spans, target in zip(
        flight.first_control, flight.start_s, flight.spans, flight.target, strict=True
    ):
        knots = start + (np.arange(spans + ORDER - 1) - 1) * flight.spacing_s
        points = _triangulate_at(knots, int(target), cameras, tracks, objects)
        good = np.isfinite(points[:, 0])
        if not good.any():
            points[:] = np.mean([camera.centre_enu for camera in cameras], axis=0)
            good[:] = True
        axes = [np.interp(knots, knots[good], points[good, axis]) for axis in range(3)]
        control[first : first + len(knots)] = np.column_stack(axes)
    return control


def _triangulate_at(
    t_s: Array, target: int, cameras: tuple[Camera, ...], tracks: dict[str, list[TrackSeries]], objects: dict[Key, int]
) -> Array:
    rays, rotations, centres = [], [], []
    for camera in cameras:
        for track in tracks[camera.id]:
            if objects.get((camera.id, track.number)) == target:
                rays.append(track.at(camera.stamped_s(t_s)))
                rotations.append(camera.R_cam_enu)
                centres.append(camera.centre_enu)
    points = np.full((len(t_s), 3), np.nan)
    count = np.sum([np.isfinite(ray[:, 0]) for ray in rays], axis=0)
    enough = count >= 2
    if enough.any():
        points[enough] = triangulate([ray[enough] for ray in rays], rotations, centres)
        points[_implausible(points, cameras)] = np.nan
    return points


def _implausible(points: Array, cameras: tuple[Camera, ...]) -> NDArray[np.bool_]:
    """Points much further away than the others are: two rays that were nearly parallel."""
    away = np.linalg.norm(points - np.mean([camera.centre_enu for camera in cameras], axis=0), axis=1)
    plausible: NDArray[np.bool_] = away < 5 * np.nanmedian(away)
    return ~plausible


def first_estimate(
    scene: Scene,
    cameras: tuple[Camera, ...],
    tracks: dict[str, list[TrackSeries]],
    objects: dict[Key, int],
    *,
    t_mid: int,
    spacing_s: float,
) -> tuple[FlightEstimate, tuple[CameraData, ...]]:
    """Cameras, flight and the rows to adjust them by."""
    gathered = tuple(
        gather(scene.observations[camera.id], tracks[camera.id], objects, camera.id, t_mid) for camera in cameras
    )
    data = supported(cameras, gathered)
    flight = lay_flight(cameras, data, spacing_s)
    return FlightEstimate(cameras, flight, first_control(flight, cameras, tracks, objects)), data

"""From tracks to a first estimate: clocks aligned, scaffold built, frame found, flight laid out.

Nothing here is accurate; everything here must be right to a few per cent, because the adjustment only walks downhill.
The hazard is a survey with two positions swapped or one mistyped: the similarity would spread the error over all
cameras. Distances between cameras give it away, so the fit is examined before it is used, and what does not fit is
named and kept out.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.adjustment.flight import FlightEstimate
from calib.adjustment.priors import READOUT_S
from calib.adjustment.projection import CameraData, site_time_s
from calib.errors import CalibrationError
from calib.geometry.similarity import Similarity, best_swap, fit_similarity, fit_with_up, rms, worst_point
from calib.geometry.spline import ORDER, Flight, lay_knots
from calib.geometry.twoview import triangulate
from calib.network import Camera
from calib.observations import Observations, Scene, SiteCamera
from calib.solving.identity import Key
from calib.solving.scaffold import Pose
from calib.solving.series import TrackSeries, gap_to_nearest_s
from edge.common.arrays import Array

SUSPICIOUS_MISFIT: Final = 0.08  # of the cameras' spread: a scaffold on unrefined lenses misses its survey by a few %
CURE: Final = 0.35  # a swap or an omission that shrinks the misfit below this share of it has explained it
LOOSEST_ROLL_RAD: Final = 0.05  # 5 m at 100 m: beyond it a line of cameras is no survey
SUPPORT_S: Final = 0.25  # another camera must have seen the object this close in time
LONGEST_UNSEEN_S: Final = 1.0  # a flight is not continued across a longer gap
SHORTEST_STRETCH_S: Final = 1.0  # a stretch has nine freedoms besides its jerk
FEWEST_STRETCH_ROWS: Final = 5  # of each of a stretch's two best cameras
HIGHEST_RATE_HZ: Final = 30.0  # rows beyond it are copies of their neighbours' error


@dataclass(frozen=True)
class Georeference:
    """The scaffold's similarity to ENU; cameras whose surveyed position was rejected as an outlier, and why."""

    similarity: Similarity
    rejected: dict[str, str] = field(default_factory=dict)


def georeference(poses: dict[str, Pose], cameras: dict[str, SiteCamera]) -> Georeference:
    """The similarity that takes the scaffold to the surveyed positions, wrong ones found and named.

    Raises CalibrationError if the positions do not fix a frame: fewer than three, or in a line, and no camera says
    where up is.
    """
    names = [name for name in sorted(poses) if cameras[name].position_enu is not None]
    source = np.array([poses[name].centre for name in names]).reshape(-1, 3)
    target = np.array([cameras[name].position_enu for name in names]).reshape(-1, 3)
    roll_rad = _roll_sigma_rad(target, [cameras[name] for name in names])
    if len(names) < 3 or roll_rad > LOOSEST_ROLL_RAD:
        return Georeference(fit_with_up(source, target, _up_directions(names, roll_rad, poses, cameras)))
    fit = fit_similarity(source, target)
    spread = float(np.sqrt(((target - target.mean(0)) ** 2).sum(1).mean()))
    misfit = rms(fit.residual)
    if misfit <= SUSPICIOUS_MISFIT * spread or len(names) < 4:
        return Georeference(fit.similarity)
    return _without_wrong(names, source, target, misfit) or Georeference(fit.similarity)


def _roll_sigma_rad(positions: Array, cameras: list[SiteCamera]) -> float:
    """How well a survey fixes the roll about the line its positions are nearest to, one sigma."""
    if len(positions) < 3:
        return np.inf
    second = float(np.linalg.svd(positions - positions.mean(0), compute_uv=False)[1])
    variance = np.mean([np.trace(c.position_covariance) / 3 for c in cameras if c.position_covariance is not None])
    return float(np.sqrt(variance)) / max(second, 1e-9)


def _up_directions(names: list[str], roll_rad: float, poses: dict[str, Pose], cameras: dict[str, SiteCamera]) -> Array:
    """(U, 3) up in the scaffold's frame, from the cameras that know it. Raises CalibrationError if none helps."""
    ups = [poses[name].R.T @ up for name in sorted(poses) if (up := cameras[name].up_cam) is not None]
    if len(names) >= 2 and ups:
        return np.array(ups)
    if len(names) < 3:
        fault = f"{len(names)} calibrated cameras have a surveyed position ({', '.join(names) or 'none'}), three must"
        cure = "survey more tripods and see that all see the flight; two suffice if one says where up is"
    else:
        fault = f"the surveyed cameras stand in a line: the roll about it is open by {np.degrees(roll_rad):.0f} degrees"
        cure = "move a camera off the line, or give one of them"
    raise CalibrationError(
        fault, where="georeferencing", action=f"{cure} (up_cam and up_sigma_deg), or solve with --local"
    )


def _without_wrong(names: list[str], source: Array, target: Array, misfit: float) -> Georeference | None:
    """The fit without the positions that explain its misfit; None if nothing simple does."""
    (i, j), swapped = best_swap(source, target)
    index, without, off = worst_point(source, target)
    if swapped <= CURE * misfit and swapped <= 1.5 * without:
        order = np.arange(len(names))
        order[[i, j]] = order[[j, i]]
        finding = (
            f"the positions of {names[i]} and {names[j]} look swapped: the survey misses the cameras by "
            f"{misfit:.1f} m as it is and by {swapped:.1f} m with the two exchanged; neither was used"
        )
        return Georeference(fit_similarity(source, target[order]).similarity, {names[i]: finding, names[j]: finding})
    if without <= CURE * misfit and len(names) >= 4:
        keep = np.arange(len(names)) != index
        finding = (
            f"the position of {names[index]} looks wrong by {off:.1f} m, or its lens file is another camera's: without "
            f"it the survey misses the cameras by {without:.1f} m instead of {misfit:.1f} m; it was not used"
        )
        return Georeference(fit_similarity(source[keep], target[keep]).similarity, {names[index]: finding})
    return None


def to_enu(pose: Pose, site: SiteCamera, similarity: Similarity, offset_s: float) -> Camera:
    """A scaffold pose as a camera of the site."""
    R = pose.R @ similarity.rotation.T
    centre = similarity.apply(pose.centre[None])[0]
    readout = site.readout_s if site.readout_s is not None else READOUT_S
    return Camera(site.id, site.lens, R, centre, offset_s, 0.0, readout)


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

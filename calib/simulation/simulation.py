"""From a scene's description to what its cameras report, and the truth beside it.

`watch` computes once what would be seen without any error; `disturb` draws one trial of all errors onto it. A study of
ten thousand trials therefore pays for the geometry once. Every kind of error of every camera has a random stream of its
own, so that switching one on leaves all the others as they were.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.network import POSE_SIZE, Camera, Network
from calib.observations import Observations, Scene, SiteCamera
from calib.simulation import errors
from calib.simulation.camera import TrueCamera, TrueSighting, true_camera
from calib.simulation.description import Simulation
from calib.simulation.flight import ObjectFlight, flight
from calib.simulation.roaming import roam
from edge.common.arrays import Array
from edge.common.errors import ConfigError

# A sigma of zero would make the survey infinitely heavy: what a perfect survey is published as.
SMALLEST_SURVEY_SIGMA_M = 1e-3


class Stream(IntEnum):
    """One random stream for each kind of error."""

    NOISE = 0
    DRIFT = 1
    DROPOUT = 2
    CLUTTER = 3
    SURVEY = 4
    LENS = 5
    FRAMES = 6
    OUTLIER = 7
    ROAM = 8  # of an object, not of a camera


@dataclass(frozen=True)
class ErrorStreams:
    """The random streams of one camera (or object) in one trial, each fresh whenever it is asked for."""

    seed: int
    trial: int
    number: int

    def __getitem__(self, stream: Stream) -> np.random.Generator:
        entropy = (self.seed, self.trial, self.number, int(stream))
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy)))


@dataclass(frozen=True)
class Watched:
    """A scene without errors: per camera its stamps (F,) in ns since the start, and a sighting of each object."""

    simulation: Simulation
    flights: tuple[ObjectFlight, ...]
    cameras: tuple[TrueCamera, ...]
    stamps_ns: tuple[NDArray[np.int64], ...]
    sightings: tuple[tuple[TrueSighting, ...], ...]
    duration_s: float


@dataclass(frozen=True)
class Rows:
    """What one camera reports, with what nobody tells the solver. All (N, ...) and in time order.

    source: 1-based number of the object that is behind the row, 0 for clutter. size_px: (N, 2) true width and height.
    """

    t_unix_ns: NDArray[np.int64]
    pixels: Array
    track: NDArray[np.int64]
    source: NDArray[np.int64]
    size_px: Array


@dataclass(frozen=True)
class Simulated:
    """One trial: what is believed and seen (`scene`), and what is true (`network`, `flights`, `rows`).

    frames_unix_ns: per camera the stamps (F,) of all frames that arrive, also of those that show nothing.
    """

    scene: Scene
    network: Network
    flights: tuple[ObjectFlight, ...]
    rows: dict[str, Rows] = field(default_factory=dict)
    frames_unix_ns: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    start_unix_ns: int = 0
    duration_s: float = 0.0

    def truth_enu(self, t_unix_ns: NDArray[np.int64], number: int = 1) -> Array:
        """(N, 3) true metres of object `number` at site times t_unix_ns (N,); NaN when it does not fly."""
        return self.flights[number - 1].position_enu((np.asarray(t_unix_ns) - self.start_unix_ns) * 1e-9)


def simulate(simulation: Simulation, trial: int = 0) -> Simulated:
    """One trial of a scene. The same scene and trial give the same bytes."""
    return disturb(watch(simulation), trial)


def watch(simulation: Simulation) -> Watched:
    """What all cameras would see without any error."""
    flights = _flights(simulation)
    duration = simulation.duration_s or max(float(path.times_s[-1]) for path in flights)
    cameras = tuple(true_camera(camera, duration / 2) for camera in simulation.camera)
    stamps = tuple(camera.stamps_ns(duration) for camera in cameras)
    sightings = tuple(
        tuple(camera.watch(path, at) for path in flights) for camera, at in zip(cameras, stamps, strict=True)
    )
    return Watched(simulation, flights, cameras, stamps, sightings, duration)


def _flights(simulation: Simulation) -> tuple[ObjectFlight, ...]:
    """The path of every object: through its waypoints, or roaming for as long as the scene lasts."""
    ends = bool(simulation.object) and all(thing.waypoints_enu for thing in simulation.object)
    if simulation.duration_s is None and not ends:
        raise ConfigError(
            "no waypoint says when the scene ends", where=f"scene {simulation.name}", action="give duration_s"
        )
    streams = (ErrorStreams(simulation.seed, 0, number)[Stream.ROAM] for number in range(len(simulation.object)))
    return tuple(
        flight(thing) if thing.roam is None else roam(thing, simulation.duration_s or 0.0, stream)
        for thing, stream in zip(simulation.object, streams, strict=True)
    )


def disturb(watched: Watched, trial: int = 0) -> Simulated:
    """Draw all errors of one trial onto a watched scene."""
    simulation = watched.simulation
    streams = [ErrorStreams(simulation.seed, trial, number) for number in range(len(watched.cameras))]
    rows = {
        camera.description.id: _report(watched, stream) for camera, stream in zip(watched.cameras, streams, strict=True)
    }
    site_cameras = tuple(map(_published, watched.cameras, streams))
    observations = {
        camera.description.id: _observations(rows[camera.description.id], camera) for camera in watched.cameras
    }
    return Simulated(
        scene=Scene(simulation.name, simulation.origin, site_cameras, observations),
        network=true_network(watched),
        flights=watched.flights,
        rows=rows,
        frames_unix_ns={
            camera.description.id: watched.stamps_ns[stream.number][_arriving(watched, stream)]
            + simulation.start_unix_ns
            for camera, stream in zip(watched.cameras, streams, strict=True)
        },
        start_unix_ns=simulation.start_unix_ns,
        duration_s=watched.duration_s,
    )


def _arriving(watched: Watched, rng: ErrorStreams) -> NDArray[np.bool_]:
    """(F,) which frames of a camera arrive at all."""
    return errors.delivered(watched.cameras[rng.number], watched.stamps_ns[rng.number], rng[Stream.FRAMES])


def _report(watched: Watched, rng: ErrorStreams) -> Rows:
    """All rows of one camera: every object's noisy pixels, and the clutter."""
    simulation, camera = watched.simulation, watched.cameras[rng.number]
    stamps, sightings = watched.stamps_ns[rng.number], watched.sightings[rng.number]
    delivered = _arriving(watched, rng)
    noise, drift, dropout = rng[Stream.NOISE], rng[Stream.DRIFT], rng[Stream.DROPOUT]
    parts = [_clutter(camera, stamps[:0], rng[Stream.CLUTTER])]  # no row, for a scene of nothing but clutter
    for source, (path, sighting) in enumerate(zip(watched.flights, sightings, strict=True), start=1):
        pixels = sighting.pixels + errors.noise(camera, len(stamps), noise) + errors.drift(camera, len(stamps), drift)
        seen = delivered & np.isfinite(pixels[:, 0]) & ~errors.missed(camera, len(stamps), dropout)
        size = np.outer(1 / sighting.depth_m[seen], (path.object.width_m, path.object.height_m))
        track = _numbers(stamps[seen], source, len(watched.flights), camera.description.track_gap_s)
        shown = np.full(len(track), source)
        parts.append(Rows(stamps[seen], pixels[seen], track, shown, size * camera.lens.intrinsics[:2]))
    outlying = _with_outliers(_joined(parts), camera, rng[Stream.OUTLIER])
    everything = _joined([outlying, _clutter(camera, stamps[delivered], rng[Stream.CLUTTER])])
    track = everything.track if camera.description.numbered else np.zeros_like(everything.track)
    return replace(everything, t_unix_ns=everything.t_unix_ns + simulation.start_unix_ns, track=track)


def _numbers(stamps_ns: NDArray[np.int64], source: int, objects: int, gap_s: float) -> NDArray[np.int64]:
    """(N,) track numbers: a new one after each long gap, never one that another object has."""
    piece = np.cumsum(np.diff(stamps_ns, prepend=stamps_ns[:1]) > gap_s * 1e9)
    numbers: NDArray[np.int64] = source + piece * objects
    return numbers


def _with_outliers(rows: Rows, camera: TrueCamera, rng: np.random.Generator) -> Rows:
    """A share of the rows is anywhere in the image instead."""
    if camera.description.outlier == 0.0:
        return rows
    wrong = rng.random(len(rows.track)) < camera.description.outlier
    anywhere = rng.uniform(0, np.array(camera.lens.size_px) - 1.0, (len(wrong), 2))
    return replace(rows, pixels=np.where(wrong[:, None], anywhere, rows.pixels), source=np.where(wrong, 0, rows.source))


def _clutter(camera: TrueCamera, stamps_ns: NDArray[np.int64], rng: np.random.Generator) -> Rows:
    """False detections, Poisson in number and anywhere in the image, each with a track number of its own."""
    counts = rng.poisson(camera.description.clutter_per_frame, len(stamps_ns))
    total = int(counts.sum())
    return Rows(
        t_unix_ns=np.repeat(stamps_ns, counts),
        pixels=rng.uniform(0, np.array(camera.lens.size_px) - 1.0, (total, 2)),
        track=1_000_000 + np.arange(total),
        source=np.zeros(total, np.int64),
        size_px=rng.uniform(2.0, 20.0, (total, 2)),
    )


def _joined(parts: list[Rows]) -> Rows:
    """Rows of several objects as one, in time order."""
    stamps = np.concatenate([part.t_unix_ns for part in parts])
    order = np.argsort(stamps, kind="stable")

    def column(name: str) -> Any:
        return np.concatenate([getattr(part, name) for part in parts])[order]

    return Rows(stamps[order], column("pixels"), column("track"), column("source"), column("size_px"))


def _observations(rows: Rows, camera: TrueCamera) -> Observations:
    said = camera.description.sigma_px
    sigma = None if said is None else np.full(len(rows.track), said)
    return Observations(rows.t_unix_ns, rows.pixels, rows.track, sigma)


def _published(camera: TrueCamera, rng: ErrorStreams) -> SiteCamera:
    """What the site file says of a camera: survey and lens with this trial's errors."""
    d = camera.description
    position = covariance = None
    if d.surveyed:
        sigma = np.array(d.survey_sigma_m)
        position = np.asarray(d.centre_enu, float) + d.survey_error_m
        if d.survey_error == "gaussian":
            position = position + rng[Stream.SURVEY].normal(0.0, 1.0, 3) * sigma
        elif d.survey_error == "uniform":
            position = position + rng[Stream.SURVEY].uniform(-1.0, 1.0, 3) * sigma
        covariance = np.diag(np.maximum(sigma, SMALLEST_SURVEY_SIGMA_M) ** 2)
    return SiteCamera(
        id=d.id,
        lens=errors.published_lens(camera, rng[Stream.LENS]),
        position_enu=position,
        position_covariance=covariance,
        clock_bound_s=d.clock_bound_s,
        readout_s=d.readout_s if d.publish_readout else None,
    )


def true_network(watched: Watched) -> Network:
    """The true network at the scene's start, before any knock or clock step; its covariance is zero."""
    cameras = tuple(
        Camera(
            id=camera.description.id,
            lens=camera.lens,
            R_cam_enu=camera.R_cam_enu[0],
            centre_enu=camera.centre_enu[0],
            clock_offset_s=camera.description.clock_offset_s,
            clock_rate=camera.description.clock_rate,
            readout_s=camera.description.readout_s,
        )
        for camera in watched.cameras
    )
    size = POSE_SIZE * len(cameras)
    simulation = watched.simulation
    t_mid_unix_ns = simulation.start_unix_ns + round(watched.duration_s / 2 * 1e9)
    return Network(simulation.name, simulation.origin, t_mid_unix_ns, cameras, np.zeros((size, size)), rms_px=0.0)

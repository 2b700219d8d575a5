"""Scenes for the station's benchmarks and tests: cameras in a ring, things that roam among them, what is seen of them.

All of it is the simulator's (`calib.simulation`), so that a scene is the same on every processor. What is added here is
the network that a tracker is given: the cameras' true poses off by errors drawn from that network's own covariance, so
that nothing but the tracker is on trial.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from calib.geometry.rotation import rotation
from calib.network import POSE_SIZE, Camera, Network
from calib.observations import Frame
from calib.simulation.description import CameraSpec, ObjectSpec, Roam, Simulation
from calib.simulation.simulation import Simulated, Watched, disturb, true_network, watch
from edge.common.arrays import Array

T0_UNIX_NS: Final = 1_800_000_000 * 10**9
ORIGIN: Final = (47.4085, 8.5071, 580.0)
SHARED: Final = 0.5  # of a camera's variance, that all cameras share: a survey's errors are alike from tripod to tripod
LATENCY_S: Final = (0.02, 0.06)  # from exposure to arrival: each camera has its own, evenly between these
BIRD: Final = {"sigma_m_s2": 3.0, "tau_s": 0.8}  # turns oftener and harder than a drone


@dataclass(frozen=True)
class Spec:
    """What a scene is like. Lengths in metres, noise in pixels."""

    cameras: int = 6
    rate_hz: float = 30.0
    uavs: int = 3
    birds: int = 0
    duration_s: float = 30.0
    noise_px: float = 1.0
    dropout: float = 0.0
    clutter: float = 0.0  # false detections a frame
    radius_m: float = 120.0
    height_m: float = 50.0
    sigma_attitude_rad: float = 3e-4
    sigma_centre_m: float = 0.02
    readout_s: float = 0.0
    gap_frames: int = 30  # after so many unseen frames a camera's tracker gives a new number
    seed: int = 0


@dataclass(frozen=True)
class Scene:
    """What truly happens, without errors (`watched`), and the network that a tracker is given."""

    spec: Spec
    watched: Watched
    network: Network

    @cached_property
    def simulated(self) -> Simulated:
        """What the cameras report."""
        return disturb(self.watched)

    @property
    def truth(self) -> tuple[Camera, ...]:
        """The cameras as they truly are at the start."""
        return true_network(self.watched).cameras

    def positions(self, t_unix_ns: int) -> Array:
        """(objects, 3) true positions at an instant."""
        t_s = np.array([(t_unix_ns - T0_UNIX_NS) * 1e-9])
        return np.concatenate([flight.position_enu(t_s) for flight in self.watched.flights] or [np.empty((0, 3))])


def make(spec: Spec) -> Scene:
    """The scene of a spec; same spec, same scene, on every processor."""
    rng = np.random.default_rng(spec.seed)
    watched = watch(describe(spec, rng))
    return Scene(spec, watched, network_of(spec, watched, rng))


def network_of(spec: Spec, watched: Watched, rng: np.random.Generator) -> Network:
    """The network that a tracker is given: the true one, off by errors of its own covariance."""
    sigma = np.array([spec.sigma_attitude_rad] * 3 + [spec.sigma_centre_m] * 3)
    # Drawn part by part: a factorisation of the whole covariance hangs on the processor's own linear algebra.
    error = sigma * rng.normal(size=(spec.cameras, POSE_SIZE)) + np.sqrt(SHARED) * sigma * rng.normal(size=POSE_SIZE)
    covariance = np.asarray(np.kron(np.eye(spec.cameras) + SHARED, np.diag(sigma**2)), float)
    estimated = tuple(
        perturbed(camera, -change) for camera, change in zip(true_network(watched).cameras, error, strict=True)
    )
    # As the solver finds: of three nobody checks another's place (calib/solving/sole_witnesses.py).
    alone = tuple(camera.id for camera in estimated) if len(estimated) <= 3 else ()
    return Network("bench", ORIGIN, T0_UNIX_NS, estimated, covariance, spec.noise_px, rests_on=alone)


def describe(spec: Spec, rng: np.random.Generator) -> Simulation:
    """The description of a spec's scene."""
    return Simulation(
        name="bench",
        seed=spec.seed,
        origin=ORIGIN,
        start_unix_ns=T0_UNIX_NS,
        duration_s=spec.duration_s,
        object=tuple(_object(k, spec) for k in range(spec.uavs + spec.birds)),
        camera=tuple(_camera(k, spec, rng) for k in range(spec.cameras)),
    )


def perturbed(camera: Camera, change: Array) -> Camera:
    """A camera turned by a rotation vector (camera frame) and moved: change (6,)."""
    return replace(camera, R_cam_enu=rotation(change[:3]) @ camera.R_cam_enu, centre_enu=camera.centre_enu + change[3:])


def _object(k: int, spec: Spec) -> ObjectSpec:
    bird = k >= spec.uavs
    roam = Roam(
        home_enu=(0.0, 0.0, spec.height_m),
        spread_m=(0.35 * spec.radius_m, 0.35 * spec.radius_m, 0.5 * spec.height_m),
        **(BIRD if bird else {}),
    )
    return ObjectSpec(name=f"{'bird' if bird else 'uav'}{k}", kind="bird" if bird else "drone", roam=roam)


def _camera(k: int, spec: Spec, rng: np.random.Generator) -> CameraSpec:
    """A camera of a ring that looks at its middle; fires when it likes."""
    angle = 2 * np.pi * k / spec.cameras + rng.uniform(-0.1, 0.1)
    return CameraSpec(
        id=f"cam{k}",
        intrinsics=(1300.0, 1300.0, 959.5, 539.5),
        distortion=(-0.1, 0.02, 0.0, 0.0, 0.0),
        centre_enu=(spec.radius_m * np.cos(angle), spec.radius_m * np.sin(angle), rng.uniform(0, 4)),
        look_at_enu=(rng.uniform(-5, 5), rng.uniform(-5, 5), spec.height_m),
        frame_rate_hz=spec.rate_hz,
        frames=int(spec.duration_s * spec.rate_hz),
        phase_s=rng.uniform(0, 1 / spec.rate_hz),
        readout_s=spec.readout_s,
        noise_px=spec.noise_px,
        dropout=spec.dropout,
        clutter_per_frame=spec.clutter,
        track_gap_s=spec.gap_frames / spec.rate_hz,
    )


def frames(scene: Scene) -> Iterator[tuple[int, Frame]]:
    """(arrival time ns, frame) in the order of arrival; each camera has its own latency."""
    rng = np.random.default_rng(scene.spec.seed + 1000)
    names = list(scene.simulated.rows)
    stamps = [scene.simulated.frames_unix_ns[name] for name in names]
    delay_ns = (rng.uniform(*LATENCY_S, len(names)) * 1e9).astype(np.int64)
    owner = np.repeat(np.arange(len(names)), [len(own) for own in stamps])
    stamp = np.concatenate(stamps)
    rows = [scene.simulated.rows[name] for name in names]
    begin = np.concatenate([np.searchsorted(r.t_unix_ns, own, "left") for r, own in zip(rows, stamps, strict=True)])
    end = np.concatenate([np.searchsorted(r.t_unix_ns, own, "right") for r, own in zip(rows, stamps, strict=True)])
    arrival = stamp + delay_ns[owner]
    for k in np.lexsort((stamp, owner, arrival)).tolist():
        own, shown = rows[owner[k]], slice(begin[k], end[k])
        sigma_px = np.full(end[k] - begin[k], scene.spec.noise_px)
        frame = Frame(
            names[owner[k]], int(stamp[k]), own.pixels[shown], own.track[shown], sigma_px, own.size_px[shown, 0]
        )
        yield int(arrival[k]), frame

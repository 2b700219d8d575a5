"""Seeded scenes for the station's benchmarks and tests: cameras, many flying things, and what the cameras see of them.

Built with the calibration's own camera model, so that nothing but the tracker is on trial: the cameras' true poses
differ from the network handed to the tracker by errors drawn from that network's own covariance.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.network import POSE_SIZE, Camera, Network
from calib.observations import Frame
from edge.common.arrays import Array
from edge.lens import LensModel

T0_UNIX_NS: Final = 1_800_000_000 * 10**9
ORIGIN: Final = (47.4085, 8.5071, 580.0)
SHARED: Final = 0.5  # variance that all poses have in common, relative to each one's own
STEP_S: Final = 0.01  # of the simulated flights; between steps they are interpolated


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
    """The network the tracker is given, the cameras as they truly are, and flights (objects, steps, 3) from T0 on."""

    spec: Spec
    network: Network
    truth: tuple[Camera, ...]
    flights: Array

    def positions(self, t_unix_ns: int) -> Array:
        """(objects, 3) true positions at an instant."""
        step = (t_unix_ns - T0_UNIX_NS) * 1e-9 / STEP_S
        k = int(np.clip(step, 0, self.flights.shape[1] - 2))
        part = step - k
        return self.flights[:, k] * (1 - part) + self.flights[:, k + 1] * part


def make(spec: Spec) -> Scene:
    """The scene of a spec; same spec, same scene, on every processor."""
    rng = np.random.default_rng(spec.seed)
    truth = tuple(_camera(k, spec, rng) for k in range(spec.cameras))
    sigma = np.tile([spec.sigma_attitude_rad] * 3 + [spec.sigma_centre_m] * 3, spec.cameras)
    # A shared part as well: a survey's errors are alike from tripod to tripod.
    correlation = np.eye(len(sigma)) + SHARED * np.kron(np.ones((spec.cameras,) * 2), np.eye(POSE_SIZE))
    covariance = np.outer(sigma, sigma) * correlation
    # By Cholesky: an SVD's vectors of equal singular values are another set on every processor, and so the scene.
    unit = rng.multivariate_normal(np.zeros(len(sigma)), correlation, method="cholesky")
    error = (sigma * unit).reshape(-1, POSE_SIZE)
    estimated = tuple(perturbed(camera, -error[k]) for k, camera in enumerate(truth))
    network = Network("bench", ORIGIN, T0_UNIX_NS, estimated, covariance, spec.noise_px)
    return Scene(spec, network, truth, _flights(spec, rng))


def perturbed(camera: Camera, change: Array) -> Camera:
    """A camera turned by a rotation vector (camera frame) and moved: change (6,)."""
    return Camera(
        camera.id,
        camera.lens,
        rotation(change[:3]) @ camera.R_cam_enu,
        camera.centre_enu + change[3:],
        camera.clock_offset_s,
        camera.clock_rate,
        camera.readout_s,
    )


def rotation(vector: Array) -> Array:
    """(3, 3) rotation by a rotation vector (Rodrigues 1840)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K))


def _camera(k: int, spec: Spec, rng: np.random.Generator) -> Camera:
    angle = 2 * np.pi * k / spec.cameras + rng.uniform(-0.1, 0.1)
    centre = np.array([spec.radius_m * np.cos(angle), spec.radius_m * np.sin(angle), rng.uniform(0, 4)])
    forward = np.array([rng.uniform(-5, 5), rng.uniform(-5, 5), spec.height_m]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.vstack([right, np.cross(forward, right), forward])
    lens = LensModel("radtan", (1300.0, 1300.0, 959.5, 539.5), (-0.1, 0.02, 0.0, 0.0, 0.0), (1920, 1080), 0.2)
    return Camera(f"cam{k}", lens, R, centre, readout_s=spec.readout_s)


def _flights(spec: Spec, rng: np.random.Generator) -> Array:
    """Objects driven by coloured accelerations and drawn back to the middle; birds turn oftener and harder."""
    count, steps = spec.uavs + spec.birds, int(spec.duration_s / STEP_S) + 200
    bird = np.arange(count) >= spec.uavs
    tau, drive = np.where(bird, 0.8, 1.5)[:, None], np.where(bird, 3.0, 2.0)[:, None]
    home = np.array([0.0, 0.0, spec.height_m])
    p = home + rng.uniform(-1, 1, (count, 3)) * (0.35 * spec.radius_m, 0.35 * spec.radius_m, 0.5 * spec.height_m)
    v, a = rng.normal(0, 4.0, (count, 3)), np.zeros((count, 3))
    flights = np.empty((count, steps, 3))
    for step in range(steps):
        flights[:, step] = p
        a += -a / tau * STEP_S + drive * np.sqrt(2 / tau * STEP_S) * rng.normal(size=(count, 3))
        pull = -0.06 * (p - home) * (1.0, 1.0, 2.0) - 0.15 * v
        p = p + v * STEP_S + (a + pull) * STEP_S**2 / 2
        v = v + (a + pull) * STEP_S
    return flights


def frames(scene: Scene, latency_s: tuple[float, float] = (0.02, 0.06)) -> Iterator[tuple[int, Frame]]:
    """(arrival time ns, frame) in the order of arrival; each camera has its own phase and latency."""
    spec = scene.spec
    rng = np.random.default_rng(spec.seed + 1000)
    period_ns = int(1e9 / spec.rate_hz)
    phase = rng.integers(0, period_ns, spec.cameras)
    delay = (rng.uniform(*latency_s, spec.cameras) * 1e9).astype(np.int64)
    count = len(scene.flights)
    label = np.arange(1, count + 1)[None] + np.zeros((spec.cameras, 1), np.int64)
    unseen = np.zeros((spec.cameras, count), int)
    fresh = np.full(spec.cameras, 1000)
    due = sorted(
        (int(T0_UNIX_NS + phase[c] + n * period_ns + delay[c]), c, int(T0_UNIX_NS + phase[c] + n * period_ns))
        for c in range(spec.cameras)
        for n in range(int(spec.duration_s * spec.rate_hz))
    )
    for arrival_ns, c, stamp in due:
        pixels = seen(scene, c, stamp)
        there = np.isfinite(pixels[:, 0]) & (rng.random(count) >= spec.dropout)
        lost = there & (unseen[c] > spec.gap_frames)
        label[c, lost] = fresh[c] + np.arange(np.count_nonzero(lost))
        fresh[c] += np.count_nonzero(lost)
        unseen[c] = np.where(there, 0, unseen[c] + 1)
        real = pixels[there] + rng.normal(0, spec.noise_px, (np.count_nonzero(there), 2))
        false = rng.uniform((0, 0), (1919, 1079), (rng.poisson(spec.clutter), 2))
        labels = np.concatenate([label[c, there], fresh[c] + np.arange(len(false))])
        fresh[c] += len(false)
        both = np.vstack([real, false])
        yield arrival_ns, Frame(f"cam{c}", stamp, both, labels, np.full(len(both), spec.noise_px))


def seen(scene: Scene, camera: int, stamp: int) -> Array:
    """(objects, 2) true pixels of a frame stamped so, NaN outside the image; rolling shutter included."""
    body = scene.truth[camera]
    pixels = body.project(scene.positions(stamp))
    if body.readout_s:
        rows = np.nan_to_num(pixels[:, 1], nan=0.0)
        late = [scene.positions(stamp + int(body.readout_s * v / 1080 * 1e9))[k] for k, v in enumerate(rows)]
        pixels = body.project(np.array(late))
    inside = np.all((pixels >= 0) & (pixels <= (1919, 1079)), axis=1)
    return np.where(inside[:, None], pixels, np.nan)

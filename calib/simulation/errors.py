"""The errors of a simulated camera, drawn one kind at a time: frames, pixels, misses, lens.

Each function takes the random stream of its own kind and draws the same numbers from it whatever the others do.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from calib.simulation.camera import TrueCamera
from edge.common.arrays import Array
from edge.lens import LensModel


def delivered(camera: TrueCamera, stamps_ns: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.bool_]:
    """(F,) which frames arrive at all."""
    d = camera.description
    kept = rng.random(len(stamps_ns)) >= d.frame_drop if d.frame_drop else np.ones(len(stamps_ns), bool)
    t_s = camera.site_time_s(stamps_ns)
    for blind in d.blind:
        kept &= (t_s < blind.from_s) | (t_s > blind.to_s)
    return kept


def noise(camera: TrueCamera, count: int, rng: np.random.Generator) -> Array:
    """(count, 2) pixel errors without memory."""
    d = camera.description
    if d.noise == "uniform":
        return rng.uniform(-d.noise_px, d.noise_px, (count, 2))
    return rng.normal(0.0, 1.0, (count, 2)) * d.noise_px


def drift(camera: TrueCamera, count: int, rng: np.random.Generator) -> Array:
    """(count, 2) first-order Gauss-Markov pixel errors, stationary from the first frame on."""
    d = camera.description
    if d.drift_px == 0.0:
        return np.zeros((count, 2))
    kept = np.exp(-1.0 / (d.frame_rate_hz * d.drift_s))
    driven = rng.normal(0.0, d.drift_px * np.sqrt(1 - kept**2), (count, 2))
    driven[0] /= np.sqrt(1 - kept**2)
    drift: Array = lfilter([1.0], [1.0, -kept], driven, axis=0)
    return drift


def missed(camera: TrueCamera, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(count,) frames in which the detector misses the object; misses last `dropout_length_s` on average."""
    d = camera.description
    if d.dropout == 0.0:
        return np.zeros(count, bool)
    length = max(1.0, d.dropout_length_s * d.frame_rate_hz)
    if length == 1.0 or d.dropout == 1.0:
        return rng.random(count) < d.dropout
    # Alternate geometric runs of seen and missed frames whose means are in the ratio asked for.
    means = np.array([length * (1 - d.dropout) / d.dropout, length])
    starts_missing = int(rng.random() < d.dropout)
    runs = rng.geometric(1 / np.maximum(1.0, means), (count + 1, 2)).ravel()[starts_missing:]
    states = (np.arange(len(runs)) + starts_missing) % 2 == 1
    enough = int(np.searchsorted(np.cumsum(runs), count)) + 1
    return np.repeat(states[:enough], runs[:enough])[:count]


def published_lens(camera: TrueCamera, rng: np.random.Generator) -> LensModel:
    d, error = camera.description, camera.description.lens_error
    fx, fy, cx, cy = d.published_intrinsics or d.intrinsics
    k1, *others = d.published_distortion if d.published_distortion is not None else d.distortion
    focal, u, v, bent = rng.normal(0.0, 1.0, 4) * (error.focal, error.centre_px, error.centre_px, error.k1)
    intrinsics = (fx * (1 + focal), fy * (1 + focal), cx + u, cy + v)
    return replace(camera.lens, intrinsics=intrinsics, distortion=(k1 + bent, *others))

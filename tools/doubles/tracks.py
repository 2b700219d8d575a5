"""Tracks messages made of pixels, as a camera box would send them. Of edge alone: a box in a process starts at once."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edge.common.arrays import Array
from edge.lens import LensModel, pixel_to_ray
from edge.messages import Detection, Tracks

SIZE_PX = (12.0, 8.0)  # of every object: what a drone of half a metre is at 60 m
SCORE = 0.9  # a detector that is sure of it
# Of anything: what it says is looked at by nobody, only how much it is.
DETECTION = Detection(
    track=1,
    u_px=640.0,
    v_px=360.0,
    ray_x=0.01,
    ray_y=0.01,
    width_px=8.0,
    height_px=6.0,
    score=SCORE,
    status="confirmed",
)


@dataclass(frozen=True)
class BoxCamera:
    """What a box says of its camera in each message."""

    lens: LensModel
    readout_s: float | None = 0.0  # 0: a global shutter; None: not known
    clock_bound_s: float | None = 1e-3


@dataclass(frozen=True)
class SeenFrame:
    """One frame: pixels (K, 2) raw, rays (K, 2), labels (K,) track numbers, sigma_px (K,) if the detector says it."""

    t_unix_ns: int
    pixels: Array
    rays: Array
    labels: NDArray[np.int64]
    sigma_px: Array | None = None
    width_px: Array | None = None  # (K,) of the boxes; None: SIZE_PX of all


def rays_of(lens: LensModel, pixels: list[Array]) -> list[Array]:
    """The rays (K, 2) of many frames' pixels (K, 2): all at once, for the inverse of a lens costs by the call."""
    if not pixels:
        return []
    rays = pixel_to_ray(lens, np.concatenate(pixels))
    return np.split(rays, np.cumsum([len(own) for own in pixels])[:-1])


def tracks_message(camera: BoxCamera, epoch: int, seq: int, seen: SeenFrame) -> Tracks:
    """A frame as its box would send it; what has no ray in the lens model is left out."""
    sigmas = [None] * len(seen.pixels) if seen.sigma_px is None else seen.sigma_px.tolist()
    widths = [SIZE_PX[0]] * len(seen.pixels) if seen.width_px is None else seen.width_px.tolist()
    rows = zip(seen.pixels.tolist(), seen.rays.tolist(), seen.labels.tolist(), sigmas, widths, strict=True)
    return Tracks(
        t_unix_ns=seen.t_unix_ns,
        seq=seq,
        epoch=epoch,
        clock_bound_s=camera.clock_bound_s,
        size_px=camera.lens.size_px,
        readout_s=camera.readout_s,
        detections=[
            Detection(
                track=track,
                u_px=u,
                v_px=v,
                ray_x=x,
                ray_y=y,
                width_px=width,
                height_px=SIZE_PX[1],
                score=SCORE,
                sigma_px=sigma,
                status="confirmed",
            )
            for (u, v), (x, y), track, sigma, width in rows
            if math.isfinite(x)
        ],
    )

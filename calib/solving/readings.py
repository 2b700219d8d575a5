"""Other ways to read a camera's rows: as if its lens file were another's, or its pixels counted from the other side.

The hazard is a lens file that is not refused and not right. It is of another zoom, of the 4K mode while the detector
sees 1080p, of the landscape picture of a phone that was held upright: each is a lens, and nothing in it looks wrong.
What tells is that the rows, read as they should have been, fit what the other cameras saw.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.observations import Observations
from calib.solving.found import Cause
from calib.solving.series import TrackSeries
from edge.common.arrays import Array
from edge.lens import LensModel, pixel_to_ray

FOCAL_FACTORS: Final = tuple(np.geomspace(0.35, 2.85, 26).tolist())  # 9 % apart: half of one leaves most rows within
SIZE_FACTORS: Final = (1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 3.0)  # between the picture sizes of one camera


@dataclass(frozen=True)
class Reading:
    """One way to read rows. what: that they fit, in words; cure: what to do if that is how they must be read."""

    cause: Cause
    what: str
    cure: str
    lens: LensModel
    mirrored: bool = False

    def tracks(self, observations: Observations, tracks: list[TrackSeries]) -> list[TrackSeries]:
        """Tracks read that way; rows that have no ray then are left out."""
        read = []
        for track in tracks:
            rays = self._rays(observations.pixels[track.row])
            keep = np.isfinite(rays[:, 0])
            if keep.any():
                read.append(replace(track, t_s=track.t_s[keep], rays=rays[keep], row=track.row[keep]))
        return read

    def _rays(self, pixels: Array) -> Array:
        width = self.lens.size_px[0]
        read = np.column_stack([width - 1 - pixels[:, 0], pixels[:, 1]]) if self.mirrored else pixels
        return pixel_to_ray(self.lens, read)


def readings(lens: LensModel) -> Iterator[Reading]:
    """Every way that is tried for one camera."""
    yield Reading(
        Cause.TRACKS,
        "a mirrored picture: u is counted from the right, or v from the bottom",
        "count pixels from the top left of the picture, as the camera gives it",
        lens,
        mirrored=True,
    )
    yield from other_sizes(lens)
    yield from (_of_focal(lens, factor) for factor in FOCAL_FACTORS)


def other_sizes(lens: LensModel) -> Iterator[Reading]:
    """The lens of the same camera in its other modes: held upright, or of another picture size."""
    fx, fy, cx, cy = lens.intrinsics
    width, height = lens.size_px
    yield _of_size(lens, (fy, fx, cy, cx), (height, width), "use the lens file of the way it was held")
    for factor in SIZE_FACTORS:
        size = (round(factor * width), round(factor * height))
        scaled = (factor * fx, factor * fy, factor * cx, factor * cy)
        yield _of_size(lens, scaled, size, "use the lens file of the picture size that the detector sees")


def _of_size(
    lens: LensModel, intrinsics: tuple[float, float, float, float], size_px: tuple[int, int], cure: str
) -> Reading:
    (width, height), (was_width, was_height) = size_px, lens.size_px
    what = f"a picture of {width} x {height}, and not of {was_width} x {was_height} as the lens file says"
    return Reading(Cause.LENS, what, cure, replace(lens, intrinsics=intrinsics, size_px=size_px))


def _of_focal(lens: LensModel, factor: float) -> Reading:
    fx, fy, cx, cy = lens.intrinsics
    what = f"a focal length of about {fx * factor:.0f} px, and not {fx:.0f} as the lens file says"
    cure = "use its own lens file, of the zoom that it was set to"
    return Reading(Cause.LENS, what, cure, replace(lens, intrinsics=(fx * factor, fy * factor, cx, cy)))

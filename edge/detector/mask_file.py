"""The file of a camera's mask: its regions, and the size of the pictures they were drawn on."""

from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from edge.common.errors import ConfigError
from edge.common.settings import load
from edge.config import CameraConfig, Section
from edge.detector.mask import Mask, Region
from edge.messages import Pixel, SizePx


class RegionConfig(Section, frozen=True, kw_only=True):
    """One region of the picture that is left out."""

    name: Annotated[str, Meta(max_length=64, description="what is there, for messages")] = ""
    corners_px: Annotated[
        tuple[tuple[Pixel, Pixel], ...], Meta(min_length=3, max_length=1000, description="u, v of each, around it")
    ]


class MaskConfig(Section, frozen=True, kw_only=True):
    """Regions of a camera's picture in which nothing is looked for: what moves there all day."""

    size_px: Annotated[SizePx, Meta(description="width and height of the pictures they were drawn on")]
    region: Annotated[tuple[RegionConfig, ...], Meta(min_length=1, max_length=200, description="one [[region]] each")]


def load_mask(camera: CameraConfig, config_file: Path, size_px: tuple[int, int]) -> Mask | None:
    """A camera's mask, its file looked for beside the configuration; None without. Raises ConfigError."""
    return read_mask(config_file.parent / camera.mask, size_px) if camera.mask else None


def read_mask(file: Path, size_px: tuple[int, int]) -> Mask:
    """The mask in a file, for pictures of size_px (width, height). Raises ConfigError."""
    config = load(file, MaskConfig)
    if tuple(config.size_px) != tuple(size_px):
        width, height = config.size_px
        what = f"was drawn on pictures of {width} x {height}, the camera's are {size_px[0]} x {size_px[1]}"
        raise ConfigError(what, where=str(file), action="draw its corners on a picture of the camera, and set size_px")
    regions = [
        Region(f"region {one.name!r}" if one.name else f"region {number}", np.array(one.corners_px, dtype=np.float64))
        for number, one in enumerate(config.region, start=1)
    ]
    try:
        return Mask.of(size_px, regions)
    except ValueError as error:
        raise ConfigError(str(error), where=str(file), action="correct its corners: u, v in order around it") from error

"""What is behind the object: sky, clouds that drift, the sun, and trees that never keep still.

The hazard is a backdrop that is too easy: on a static camera it is moving leaves and the edges of clouds that look like
small objects. Everything is drawn once a camera; a frame costs one shift of the clouds and one warp of the trees.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.network import Camera
from calib.simulation.description import Weather
from edge.common.arrays import Array

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]

COARSE: Final = 8  # bearings are computed for every 8th pixel: they change slowly, and the lens inverse is not free
HORIZON_BGR: Final = np.array([214.0, 203.0, 188.0])
ZENITH_BGR: Final = np.array([186.0, 134.0, 84.0])
CLOUD_BGR: Final = np.array([38.0, 54.0, 70.0])  # added where a cloud is thickest
LEAF_BGR: Final = np.array([38.0, 62.0, 50.0])
SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG = 215.0, 38.0
DRIFT_PX_S: Final = 2.0  # of the clouds, to the left: 10 m/s at 4 km and 800 px
CLOUD_SLOPE: Final = 2.3  # of their spectrum: real ones have no edges as sharp as an object's
SWAY_HZ: Final = (0.45, 1.1)  # of branches and of twigs
SWAY_PX: Final = 2.2  # at 1000 px focal length
NOISE_MARGIN: Final = 256  # px by which the bank of noise is larger than a frame


@dataclass(frozen=True)
class Trees:
    """The part of the image that trees cover: its first row, picture, matte (0..1) and two sway fields in pixels.

    ground: row of the picture from which on it covers all and stands still; sway, columns and rows end there.
    """

    top: int
    ground: int
    picture: Image
    matte: Float32
    sway: tuple[Float32, Float32]
    columns: Float32
    rows: Float32


@dataclass(frozen=True)
class Backdrop:
    """All that is drawn once for one camera. clouds: (H, 2 W, 3), periodic, to drift for ever."""

    sky: Image
    clouds: Image
    trees: Trees | None
    noise: Image

    def behind(self, t_s: float) -> Image:
        """Sky and clouds at t_s seconds of the scene: (H, W, 3) uint8."""
        width = self.sky.shape[1]
        whole, part = divmod(DRIFT_PX_S * t_s % width, 1.0)
        here, next_column = (self.clouds[:, int(whole) + step : int(whole) + step + width] for step in (0, 1))
        # Two weighted slices are a sixth of the price of a general warp.
        moved = cv2.addWeighted(here, 1 - part, next_column, part, 0.0)
        return np.asarray(cv2.add(self.sky, moved), np.uint8)

    def cover(self, image: Image, t_s: float) -> Float32 | None:
        """Draw the trees over an image, in place. Returns their matte from row `trees.top` on, or None without any."""
        if self.trees is None:
            return None
        trees = self.trees
        slow, quick = (np.float32(np.sin(2 * np.pi * hertz * t_s)) for hertz in SWAY_HZ)
        columns = trees.columns + slow * trees.sway[0] + quick * trees.sway[1]
        picture, matte = (
            cv2.remap(source, columns, trees.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            for source in (trees.picture, trees.matte)
        )
        ground = trees.top + trees.ground
        image[trees.top : ground] = cv2.blendLinear(picture, image[trees.top : ground], matte, 1 - matte)
        image[ground:] = trees.picture[trees.ground :]
        return np.concatenate([matte, trees.matte[trees.ground :]])

    def grain(self, image: Image, rng: np.random.Generator) -> Image:
        """The image with sensor noise."""
        height, width = image.shape[:2]
        y, x = rng.integers(0, NOISE_MARGIN, 2)
        return np.asarray(cv2.addWeighted(image, 1.0, self.noise[y : y + height, x : x + width], 1.0, -128.0), np.uint8)


def backdrop(camera: Camera, weather: Weather, rng: np.random.Generator) -> Backdrop:
    """Draw what a camera has behind its objects."""
    width, height = camera.lens.size_px
    elevation, azimuth, from_sun = _bearings_deg(camera)
    share = np.clip(elevation / 90.0, 0, 1)[..., None] ** 0.6
    sky = HORIZON_BGR * (1 - share) + ZENITH_BGR * share
    if weather.sun:
        sky = sky + _glare(from_sun)[..., None]
    noise = rng.normal(128.0, weather.sensor_noise, (height + NOISE_MARGIN, width + NOISE_MARGIN, 3))
    return Backdrop(
        sky=_image(sky),
        clouds=_clouds(width, height, weather.clouds, rng),
        trees=_trees(camera, elevation, azimuth, weather.foliage, rng),
        noise=_image(noise),
    )


def _image(values: Array | Float32) -> Image:
    return np.asarray(np.clip(np.round(values), 0, 255), np.uint8)


def _bearings_deg(camera: Camera) -> tuple[Float32, Float32, Float32]:
    """Elevation, azimuth and angle from the sun of every pixel: three (H, W)."""
    width, height = camera.lens.size_px
    u, v = np.meshgrid(np.arange(0, width + COARSE, COARSE), np.arange(0, height + COARSE, COARSE))
    bearings = np.nan_to_num(camera.bearings_enu(np.column_stack([u.ravel(), v.ravel()]).astype(float)))
    azimuth, elevation = np.radians([SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG])
    level = np.cos(elevation)
    sun = np.array([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)])
    # Interpolated as vectors: an azimuth jumps by 360 degrees somewhere.
    fine = cv2.resize(bearings.reshape(*u.shape, 3).astype(np.float32), (u.shape[1] * COARSE, u.shape[0] * COARSE))[
        :height, :width
    ]
    up = np.asarray(np.degrees(np.arcsin(np.clip(fine[..., 2], -1, 1))), np.float32)
    heading = np.asarray(np.degrees(np.arctan2(fine[..., 0], fine[..., 1])), np.float32)
    return up, heading, np.degrees(np.arccos(np.clip(fine @ sun.astype(np.float32), -1, 1)))


def _glare(from_sun_deg: Float32) -> Float32:
    """Brightness added around the sun: a disc, its corona, and a wide veil."""
    veil = 40.0 * np.exp(-((from_sun_deg / 25.0) ** 2)) + 120.0 * np.exp(-((from_sun_deg / 4.0) ** 2))
    return np.asarray(veil + 255.0 * (from_sun_deg < 0.5), np.float32)


def _turbulence(height: int, width: int, slope: float, rng: np.random.Generator) -> Float32:
    """(height, width) periodic noise whose amplitude falls with frequency to the power `slope`; mean 0, sigma 1."""
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None]
    radius = np.hypot(fy * height / width, fx)
    radius[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.normal(size=(height, width))) * radius**-slope
    field = np.fft.irfft2(spectrum, s=(height, width))
    return np.asarray(field / field.std(), np.float32)


def _clouds(width: int, height: int, cover: float, rng: np.random.Generator) -> Image:
    """(H, 2 W, 3) brightness that clouds add, the same in both halves."""
    field = _turbulence(height, width, CLOUD_SLOPE, rng)
    threshold = np.quantile(field, 1 - max(cover, 1e-3))
    thickness = np.clip((field - threshold) / 1.2, 0, 1) if cover > 0 else np.zeros_like(field)
    return np.tile(_image(thickness[..., None] * CLOUD_BGR), (1, 2, 1))


def _trees(
    camera: Camera, elevation: Float32, azimuth: Float32, foliage: float, rng: np.random.Generator
) -> Trees | None:
    """Tree tops along the horizon, and all below; None where the camera does not see so low."""
    height, width = elevation.shape
    skyline = _skyline_deg(azimuth, foliage, rng)
    leaves = _turbulence(height, width, 0.9, rng)
    matte = np.clip((skyline + 0.5 * leaves - elevation) / 0.25 + 0.5, 0, 1)
    if foliage == 0.0:
        matte = np.clip(-elevation / 0.1 + 0.5, 0, 1)
    rows = np.flatnonzero(matte.max(axis=1) > 0)
    if len(rows) == 0:
        return None
    top = max(0, int(rows[0]) - 4)
    light = 1.0 + 0.35 * leaves + 0.2 * _turbulence(height, width, 1.3, rng)
    picture = _image(light[..., None] * LEAF_BGR)
    # Only what rises above the ground moves.
    strength = foliage * SWAY_PX * camera.lens.intrinsics[0] / 1000.0 * np.clip(elevation / 2.0 + 0.3, 0, 1)
    restless = np.flatnonzero(((strength > 0) | (matte < 1)).any(axis=1))
    ground = int(restless[-1]) + 1 if len(restless) else top
    fields = [
        np.asarray((strength * _turbulence(height, width, slope, rng))[top:ground], np.float32) for slope in (2.0, 1.2)
    ]
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(ground - top, dtype=np.float32))
    whole = np.asarray(matte[top:], np.float32)
    return Trees(top, ground - top, picture[top:], whole, (fields[0], fields[1]), u, v)


def _skyline_deg(azimuth: Float32, foliage: float, rng: np.random.Generator) -> Float32:
    """How high the trees stand at each azimuth."""
    profile = _turbulence(8, 2048, 1.0, rng)[0]
    index = ((azimuth + 180.0) / 360.0 * len(profile)).astype(np.intp) % len(profile)
    return np.asarray(foliage * (3.0 + 2.5 * profile[index]), np.float32)

"""A bench scene as the messages that boxes would send: what a station is fed with in benchmarks and tests."""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from calib.geodesy import enu_to_geodetic
from calib.network import Camera
from calib.observations import Frame
from edge.messages import Detection, Fix, Lens, Tracks, camera_key, encode
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Scene, frames

SITE = "bench"


class Sent(NamedTuple):
    """One message: when it arrives, under which key, its bytes."""

    arrival_ns: int
    key: str
    payload: bytes


def lens_message(camera: Camera) -> Lens:
    """What the camera's box says of its lens."""
    return Lens.of(camera.lens)


def fix_message(camera: Camera, sigma_m: float = 0.02) -> Fix:
    """What the camera's box says of its position."""
    latitude, longitude, height = enu_to_geodetic(camera.centre_enu[None], ORIGIN)[0].tolist()
    return Fix(
        t_unix_ns=T0_UNIX_NS,
        lat_deg=latitude,
        lon_deg=longitude,
        height_m=height,
        quality=4,
        sigma_m=(sigma_m, sigma_m, 2 * sigma_m),
        frame="WGS 84",
        samples=100,
        of="lens",
    )


def tracks_message(
    frame: Frame, camera: Camera, seq: int, epoch: int = 1, clock_bound_s: float | None = 1e-3
) -> Tracks:
    """A frame as its box would send it."""
    fx, fy, cx, cy = camera.lens.intrinsics
    rays = (frame.pixels - (cx, cy)) / (fx, fy)  # distorted still: the station uses the raw pixel, and this is quick
    return Tracks(
        t_unix_ns=frame.t_unix_ns,
        seq=seq,
        epoch=epoch,
        clock_bound_s=clock_bound_s,
        size_px=camera.lens.size_px,
        readout_s=camera.readout_s,
        detections=[
            Detection(
                track=int(label),
                u_px=float(pixel[0]),
                v_px=float(pixel[1]),
                ray_x=float(ray[0]),
                ray_y=float(ray[1]),
                width_px=12.0,
                height_px=8.0,
                score=0.9,
                sigma_px=float(sigma),
                status="confirmed",
            )
            for label, pixel, ray, sigma in zip(frame.label, frame.pixels, rays, frame.sigma_px, strict=True)
        ],
    )


def messages(scene: Scene, site: str = SITE) -> Iterator[Sent]:
    """Lenses and fixes first, then every frame in the order of arrival."""
    cameras = {camera.id: camera for camera in scene.truth}
    for camera in cameras.values():
        yield Sent(T0_UNIX_NS, camera_key(site, camera.id, "lens"), encode(lens_message(camera)))
        yield Sent(T0_UNIX_NS, camera_key(site, camera.id, "fix"), encode(fix_message(camera)))
    seq: Counter[str] = Counter()
    for arrival_ns, frame in frames(scene):
        message = tracks_message(frame, cameras[frame.camera], seq[frame.camera])
        seq[frame.camera] += 1
        yield Sent(arrival_ns, camera_key(site, frame.camera, "tracks"), encode(message))

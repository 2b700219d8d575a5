"""A bench scene as the messages that boxes would send: what a station is fed with in benchmarks and tests."""

from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from calib.geodesy import enu_to_geodetic
from calib.network import Camera
from calib.observations import Frame
from edge.messages import Fix, Lens, camera_key, encode
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Scene, frames
from tools.doubles.tracks import BoxCamera, SeenFrame, rays_of, tracks_message

SITE: Final = "bench"
EPOCH: Final = 1  # no box is started twice
CLOCK_BOUND_S: Final = 0.001  # what a box under chrony states of its clock


class Sent(NamedTuple):
    """One message: when it arrives, under which key, its bytes."""

    arrival_ns: int
    key: str
    payload: bytes


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
        frame="ITRF2020",
        samples=100,
        of="lens",
    )


def messages(scene: Scene, site: str = SITE) -> Iterator[Sent]:
    """Lenses and fixes first, then every frame in the order of arrival."""
    yield from state_messages(scene, site)
    yield from tracks_messages(scene, frames(scene), site)


def state_messages(scene: Scene, site: str = SITE) -> Iterator[Sent]:
    """What each box says of its lens and its position."""
    for camera in scene.truth:
        yield Sent(T0_UNIX_NS, camera_key(site, camera.id, "lens"), encode(Lens.of(camera.lens)))
        yield Sent(T0_UNIX_NS, camera_key(site, camera.id, "fix"), encode(fix_message(camera)))


def tracks_messages(
    scene: Scene, stream: Iterator[tuple[int, Frame]], site: str = SITE, clock_bound_s: float | None = CLOCK_BOUND_S
) -> Iterator[Sent]:
    """(arrival ns, frame) of a stream as their boxes would send them. clock_bound_s: as all of them state it."""
    seq: Counter[str] = Counter()
    for arrival_ns, name, camera, seen in seen_frames(scene, stream, clock_bound_s):
        message = tracks_message(camera, EPOCH, seq[name], seen)
        seq[name] += 1
        yield Sent(arrival_ns, camera_key(site, name, "tracks"), encode(message))


def seen_frames(
    scene: Scene, stream: Iterator[tuple[int, Frame]], clock_bound_s: float | None = CLOCK_BOUND_S
) -> Iterator[tuple[int, str, BoxCamera, SeenFrame]]:
    """(arrival ns, camera's id, camera, frame with its rays) of a stream."""
    ready = list(stream)
    cameras = {camera.id: BoxCamera(camera.lens, camera.readout_s, clock_bound_s) for camera in scene.truth}
    rays = {
        name: iter(rays_of(camera.lens, [frame.pixels for _, frame in ready if frame.camera == name]))
        for name, camera in cameras.items()
    }
    for arrival_ns, frame in ready:
        own = next(rays[frame.camera])
        seen = SeenFrame(frame.t_unix_ns, frame.pixels, own, frame.label, frame.sigma_px, frame.width_px)
        yield arrival_ns, frame.camera, cameras[frame.camera], seen

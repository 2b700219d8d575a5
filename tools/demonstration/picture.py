"""One picture of a finished demo: what the cameras saw, and where the objects were said to be."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from calib.geodesy import ecef_to_enu
from calib.simulation.camera import TrueSighting
from calib.simulation.description import CameraSpec
from calib.simulation.simulation import Watched
from calib.station.archive import recording
from edge.common.arrays import Array
from edge.common.errors import SkyfixError
from edge.messages import Detection, Tracks, camera_of_key, decode
from tools.doubles.listener import Position

mpl.use("Agg")
from matplotlib import pyplot as plt

CAMERAS_SHOWN: Final = 3
HIT_PX: Final = 3.0  # from the truth: this detection is the object
CROP_PX: Final = 22  # half width of the enlarged part
Image = NDArray[np.uint8]
INK, SIGNAL = "#1b2a3a", "#d4502a"


def draw(watched: Watched, folder: Path, positions: Sequence[Position], start_unix_ns: int) -> Path:
    """picture.png below the demo's folder: one frame of each camera above, map and heights below."""
    path = sorted((folder / "recording").glob("*.mcap"))[-1]
    figure = plt.figure(figsize=(12, 8), facecolor="white", layout="constrained")
    grid = figure.add_gridspec(2, 2 * CAMERAS_SHOWN, height_ratios=[1, 1.8])
    for k, camera in enumerate(watched.cameras[:CAMERAS_SHOWN]):
        name = camera.description.id
        number, detection = _largest(_frames(path, name, start_unix_ns, camera.description), watched.sightings[k][0])
        axes = figure.add_subplot(grid[0, 2 * k : 2 * k + 2])
        _frame(axes, _image(folder / "video" / f"{name}.mp4", number), detection, name)
    enu = ecef_to_enu(np.array([p.ecef_m for p in positions], float).reshape(-1, 3), watched.simulation.origin)
    t_s = np.array([p.time_ns - start_unix_ns for p in positions]) * 1e-9
    _map(figure.add_subplot(grid[1, :CAMERAS_SHOWN]), watched, enu)
    _heights(figure.add_subplot(grid[1, CAMERAS_SHOWN:]), watched, t_s, enu)
    figure.savefig(folder / "picture.png", dpi=110)
    plt.close(figure)
    return folder / "picture.png"


def _frames(path: Path, name: str, start_unix_ns: int, camera: CameraSpec) -> Iterator[tuple[int, Detection]]:
    """Frame numbers and detections of one camera in a recording."""
    for message in recording.read(path):
        if camera_of_key(message.key) == name and message.key.endswith("/tracks"):
            tracks = decode(message.payload, Tracks, where=message.key)
            t_s = (tracks.t_unix_ns - start_unix_ns) * 1e-9 - camera.phase_s
            yield from ((round(t_s * camera.frame_rate_hz), d) for d in tracks.detections if d.status == "confirmed")


def _largest(frames: Iterator[tuple[int, Detection]], sighting: TrueSighting) -> tuple[int, Detection]:
    """The frame, and the detection of the object in it, in which the object looks largest."""
    hits = [(number, d) for number, d in frames if np.hypot(*(sighting.pixels[number] - (d.u_px, d.v_px))) < HIT_PX]
    if not hits:
        raise SkyfixError("a box never saw the first object", where="picture", action="look at the logs")
    return max(hits, key=lambda hit: hit[1].width_px)


def _frame(axes: Any, image: Image, detection: Detection, name: str) -> None:
    """A frame with what the box saw in it, enlarged in a corner."""
    axes.imshow(image)
    u, v = detection.u_px, detection.v_px
    axes.plot(u, v, "o", mfc="none", mec=SIGNAL, ms=14, mew=1.5)
    # On the side where the object is not.
    left = 0.01 if u > image.shape[1] / 2 else 0.68
    corner = axes.inset_axes((left, 0.62, 0.31, 0.37))
    corner.imshow(image, interpolation="nearest")
    corner.set(xlim=(u - CROP_PX, u + CROP_PX), ylim=(v + CROP_PX * 0.7, v - CROP_PX * 0.7), xticks=[], yticks=[])
    for side in corner.spines.values():
        side.set(color=SIGNAL, linewidth=1.5)
    axes.set(xticks=[], yticks=[])
    axes.set_title(f"{name}: what edge-node found, {detection.width_px:.0f} px wide", fontsize=10, color=INK)


def _image(video: Path, number: int) -> Image:
    """One frame of a video, RGB."""
    capture = cv2.VideoCapture(str(video))
    capture.set(cv2.CAP_PROP_POS_FRAMES, number)
    read, image = capture.read()
    capture.release()
    if not read:
        raise SkyfixError(f"has no frame {number}", where=str(video), action="look at the video")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _map(axes: Any, watched: Watched, enu: Array) -> None:
    """Seen from above: cameras, true paths, and every position received."""
    for path in watched.flights:
        true = path.position_enu(np.linspace(path.times_s[0], path.times_s[-1], 2000))
        axes.plot(true[:, 0], true[:, 1], color=INK, lw=1, alpha=0.45, label=f"{path.object.name}, truth")
    axes.plot(enu[:, 0], enu[:, 1], ".", color=SIGNAL, ms=2.5, label="MAVLink positions")
    for camera in watched.cameras:
        east, north, _ = camera.centre_enu[0]
        axes.plot(east, north, "^", color=INK, ms=9)
        axes.annotate(camera.description.id, (east, north), xytext=(7, 5), textcoords="offset points", color=INK)
    reach = 1.3 * max(float(np.abs(camera.centre_enu[0, :2]).max()) for camera in watched.cameras)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="east, m", ylabel="north, m")
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    axes.grid(alpha=0.2)


def _heights(axes: Any, watched: Watched, t_s: Array, enu: Array) -> None:
    """Height over time: the truth, and every position received."""
    t = np.linspace(0, watched.duration_s, 2000)
    true_m = [path.position_enu(t)[:, 2] for path in watched.flights]
    for height_m in true_m:
        axes.plot(t, height_m, color=INK, lw=1, alpha=0.45)
    axes.plot(t_s, enu[:, 2], ".", color=SIGNAL, ms=2.5)
    highest = max(float(np.nanmax(height_m)) for height_m in true_m)
    axes.set(xlim=(0, watched.duration_s), ylim=(0, 1.3 * highest), xlabel="time, s", ylabel="height, m")
    axes.grid(alpha=0.2)

"""Pixel formats by decoders: `python -m tools.bench.edge_formats`: a Markdown table of what each gives of one clip.

ffmpeg makes a clip of each format; it is read as for the shipped model (grey), as for a model that wants colours, and
by OpenCV's bare luma, which is what is not to be believed. A cell is the least likeness (correlation) of a picture with
what was filmed: 0.97 and more is the same picture; or the words with which it is refused.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from edge.capture.decoding import likeness, pixel_format, retrieve_luma
from edge.capture.frame import Image
from edge.capture.grey import grey
from edge.capture.video import VideoFile
from edge.common.errors import SourceError

CLIP_PX: Final = (320, 240)
CLIP_FRAMES: Final = 8
H264: Final = "-c:v libx264 -crf 4 -preset ultrafast"
CLIPS: Final = {
    "h264 yuv420p.mp4": f"{H264} -pix_fmt yuv420p",
    "h264 yuv422p.mp4": f"{H264} -pix_fmt yuv422p",
    "h264 yuv444p.mp4": f"{H264} -pix_fmt yuv444p",
    "h264 yuvj420p.mp4": f"{H264} -pix_fmt yuvj420p",
    "h264 yuv420p10.mp4": f"{H264} -pix_fmt yuv420p10le",
    "h264 yuv422p10.mp4": f"{H264} -pix_fmt yuv422p10le",
    "hevc yuv420p10.mp4": "-c:v libx265 -preset ultrafast -crf 8 -x265-params log-level=none -pix_fmt yuv420p10le",
    "h264 tff.ts": f"{H264} -flags +ildct+ilme -x264opts tff=1 -pix_fmt yuv420p",
    "mpeg2 tff.ts": "-c:v mpeg2video -q:v 2 -flags +ildct+ilme -top 1",
    "mpeg2.ts": "-c:v mpeg2video -q:v 2",
    "mpeg4.avi": "-c:v mpeg4 -q:v 2",
    "vp9.webm": "-c:v libvpx-vp9 -crf 10 -b:v 0 -deadline realtime -cpu-used 8",
    "mjpeg yuvj422p.avi": "-c:v mjpeg -q:v 2 -pix_fmt yuvj422p",
    "prores.mov": "-c:v prores_ks -profile:v 2 -pix_fmt yuv422p10le",
    "ffv1 gray.mkv": "-c:v ffv1 -pix_fmt gray",
    "ffv1 gray10.mkv": "-c:v ffv1 -pix_fmt gray10le",
    "ffv1 gray12.mkv": "-c:v ffv1 -pix_fmt gray12le",
    "ffv1 gray16.mkv": "-c:v ffv1 -pix_fmt gray16le",
    "ffv1 yuv422p10.mkv": "-c:v ffv1 -pix_fmt yuv422p10le",
    "ffv1 bgr0.mkv": "-c:v ffv1 -pix_fmt bgr0",
    "png gray16be.mkv": "-c:v png -pix_fmt gray16be",
    "png rgb24.mov": "-c:v png -pix_fmt rgb24",
    "png rgba.mov": "-c:v png -pix_fmt rgba",
    "qtrle.mov": "-c:v qtrle -pix_fmt rgb24",
    "raw yuyv422.avi": "-c:v rawvideo -pix_fmt yuyv422",
    "raw uyvy422.mov": "-c:v rawvideo -pix_fmt uyvy422",
    "raw bgr24.avi": "-c:v rawvideo -pix_fmt bgr24",
    "raw nv12.mkv": "-c:v rawvideo -pix_fmt nv12",
    "raw y800.avi": "-c:v rawvideo -pix_fmt gray -vtag Y800",
}


def filmed() -> list[Image]:
    """A dot that flies over a sky with a ramp and noise."""
    rng = np.random.default_rng(18)
    x, y = np.meshgrid(np.arange(CLIP_PX[0]), np.arange(CLIP_PX[1]))
    sky = 150.0 + 60 * x / CLIP_PX[0]
    shown = []
    for k in range(CLIP_FRAMES):
        cover = np.clip(7.5 - np.hypot(x - 40 - 20 * k, y - 60 - 9 * k), 0, 1)
        image = sky + (30 - sky) * cover + rng.normal(0, 1.5, sky.shape)
        shown.append(np.clip(image, 0, 255).astype(np.uint8))
    return shown


def make(file: Path, options: str, images: list[Image]) -> None:
    """A clip of the images, as ffmpeg makes it."""
    head = f"ffmpeg -y -loglevel error -f rawvideo -pix_fmt gray -s {CLIP_PX[0]}x{CLIP_PX[1]} -r 25 -i -".split()
    data = b"".join(image.tobytes() for image in images)
    subprocess.run([*head, *options.split(), str(file)], input=data, check=True, capture_output=True)


def as_read(file: Path, images: list[Image], *, colour: bool) -> str:
    """What a box gives of a clip."""
    try:
        video = VideoFile(str(file), t0_unix_ns=10**18, bound_s=0.0, colour=colour)
        read = [frame.image for frame in iter(video.read, None)]
    except SourceError as error:
        return f"refused: {error.what}"
    alike = min(likeness(grey(one), wanted) for one, wanted in zip(read, images, strict=False))
    return f"{alike:.3f}" if len(read) == len(images) else f"{len(read)} of {len(images)} pictures"


def bare_luma(file: Path, images: list[Image]) -> tuple[str, str]:
    """OpenCV's word for the format, and how alike its bare luma is."""
    capture: Any = cv2.VideoCapture(str(file), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    alike = []
    for wanted in images:
        capture.grab()
        ok, image = retrieve_luma(capture)
        alike.append(likeness(image, wanted) if ok and image.dtype == np.uint8 and image.ndim == 2 else 0.0)
    return pixel_format(capture).encode("unicode_escape").decode(), f"{min(alike):.3f}"


def main() -> int:
    """Make, read, print."""
    images = filmed()
    print("| clip | OpenCV's format | grey | colour | OpenCV's bare luma |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, options in CLIPS.items():
            file = Path(folder) / name.replace(" ", "_")
            make(file, options, images)
            form, bare = bare_luma(file, images)
            read = [as_read(file, images, colour=colour) for colour in (False, True)]
            print(f"| {name} | {form} | {read[0]} | {read[1]} | {bare} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""How far RTSP stamps are from the sender's clock: `python -m tools.bench.edge_stamps [--seconds 600]`.

A camera of our own, whose clock is 3 s off and whose pictures carry their number, sends over loopback with jitter; each
frame's stamp is compared with the instant at which that picture was taken, and with the bound that the frame claims.
"""

import argparse
import sys

import numpy as np

from edge.capture.live import RtspStream, open_rtsp
from edge.common.utc import UtcMapping
from tools.doubles.rtsp_camera import RtspCamera

BITS = 16
SHIFT_S = 3.0
FPS = 25.0


def numbered(k: int) -> np.ndarray:
    """A picture that says its number in black and white stripes."""
    image = np.full((240, 320, 3), 60, np.uint8)
    for bit in range(BITS):
        image[100:140, bit * 20 : bit * 20 + 20] = 255 if (k >> bit) & 1 else 0
    return image


def number(image: np.ndarray) -> int:
    """The number that a picture says."""
    return sum(int(image[120, bit * 20 + 10] > 128) << bit for bit in range(BITS))


def measure(seconds: float, *, reports: bool, drift_ppm: float) -> str:
    """One line of figures for a camera with or without sender reports."""
    jitter = np.random.default_rng(1).exponential(0.005, 10_000)
    with RtspCamera(
        numbered,
        FPS,
        clock_shift_s=SHIFT_S if reports else 0.0,
        reports=reports,
        drift_ppm=drift_ppm,
        delay_s=lambda k: float(jitter[k % len(jitter)]),
    ) as camera:
        stream = RtspStream(open_rtsp(camera.url, 2.0), camera.url, colour=False, date=UtcMapping().date)
        errors, dishonest, frame = [], 0, None
        for _ in range(round(seconds * FPS)):
            frame = stream.read()
            if frame is None:
                break
            errors.append((frame.t_unix_ns - camera.taken[number(frame.image)]) / 1e6)
            dishonest += frame.bound_s is not None and abs(errors[-1]) > frame.bound_s * 1e3
        stream.close()
    off = np.abs(errors)
    source = frame.time_source if frame else "none"
    middle, high, worst = np.percentile(off, [50, 99, 100])
    figures = f"error p50 {middle:.2f} p99 {high:.2f} max {worst:.2f} ms; beyond its bound {dishonest}"
    return f"{source}, drift {drift_ppm:g} ppm: {len(off)} frames, {figures}"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each of the three cameras")
    seconds = parser.parse_args().seconds
    for reports, drift_ppm in ((True, 0.0), (True, 50.0), (False, 0.0)):
        print(measure(seconds, reports=reports, drift_ppm=drift_ppm), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""How far RTSP stamps are from the truth: `python -m tools.bench.edge_stamps [--seconds 600] [--seeds 20]`.

A camera of our own, whose pictures carry their number, sends over loopback with jitter; each
frame's stamp is compared with the instant at which that picture was taken, and with the bound that the frame claims.
"""

import argparse
import sys

import numpy as np

from edge.capture.live import RtspStream, open_rtsp
from edge.capture.witnessed_stream import WitnessedStream
from edge.common.utc import Dated, UtcMapping
from tools.doubles.rtsp_camera import RtspCamera
from tools.doubles.streams import UTC_NS, StreamScene, mixtures, scenes, uneven

BITS = 16
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


def kinds(seed: int) -> dict[str, StreamScene]:
    """Every way in which streams lie."""
    return scenes(seed) | mixtures(seed) | uneven(seed)


def measure_scene(name: str, seeds: range, seconds: float) -> str:
    """One line of figures of streams that lie in one way (tools/doubles/streams.py), in virtual time, seeds of them."""
    frames = bounded = outside = 0
    worst_s, bounds = 0.0, []
    for seed in seeds:
        clock = WitnessedStream()
        for frame in kinds(seed)[name].frames(seconds, np.random.default_rng(seed)):
            stamp = clock.stamp(frame.stream_ns, frame.arrival_ns, frame.sent_unix_ns, lambda t: Dated(t + UTC_NS, 0.0))
            frames += 1
            if stamp.bound_s is None:
                continue
            error_s = abs(stamp.t_unix_ns - frame.true_unix_ns) / 1e9
            bounded, outside = bounded + 1, outside + (error_s > stamp.bound_s)
            worst_s = max(worst_s, error_s)
            bounds.append(stamp.bound_s)
    figures = f"error max {worst_s:.3f} s; bound p50 {np.median(bounds):.3f} s; beyond its bound {outside}"
    return f"{name}: {frames} frames, {bounded} with a bound; {figures}"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each of the three cameras")
    parser.add_argument("--seeds", type=int, default=20, help="of each kind of stream that lies")
    parser.add_argument("--first-seed", type=int, default=0, help="of those; fresh ones tell more than known ones")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    seconds = arguments.seconds
    for reports, drift_ppm in ((True, 0.0), (True, 50.0), (False, 0.0)):
        print(measure(seconds, reports=reports, drift_ppm=drift_ppm), flush=True)
    for name in kinds(0):
        print(measure_scene(name, seeds, min(seconds, 60.0)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

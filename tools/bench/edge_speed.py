"""What a frame costs: `python -m tools.bench.edge_speed VIDEO [--model FILE]`: from the file to messages, on one core.

CPU time is what counts on a box that others share, so it is what is reported, decoding included; frames a second are
those of this run. With a user's model the bare session is timed beside it, for that is the ceiling: the library's own
defaults on as many threads as this run has cores, the same input over and over, no video. Give the run as many workers.
"""

import argparse
import os
import sys
import time

import numpy as np
import onnxruntime

from edge.capture.video import VideoFile
from edge.common.errors import SkyfixError
from edge.config import DetectorConfig, GateConfig
from edge.detector.full_frame import input_spec
from edge.detector.opening import open_detector
from edge.detector.session import open_model
from edge.lens import LensModel
from edge.messages import encode
from edge.pipeline import CameraFacts, Pipeline, SideBySide

T0_UNIX_NS = 1_780_000_000 * 10**9


def measure(path: str, config: DetectorConfig, frames: int) -> dict[str, float]:
    """CPU milliseconds and frames a second of the whole way from file to encoded messages."""
    detector = open_detector(config, background=False)
    source = VideoFile(path, t0_unix_ns=T0_UNIX_NS, bound_s=0.0, colour=detector.colour)
    first = source.read()
    assert first is not None
    width, height = first.size_px
    lens = LensModel(
        "radtan", (width, width, (width - 1) / 2, (height - 1) / 2), (-0.05, 0.0, 0.0, 0.0), (width, height)
    )
    pipeline = Pipeline(CameraFacts("bench", lens, 0.0, GateConfig(), 1), detector, lambda: 0.0)
    side_by_side = SideBySide(pipeline, config.workers) if not detector.remembers and config.workers > 1 else None
    step = pipeline.step if side_by_side is None else side_by_side.step
    count, sent = 0, 0
    cpu, wall = time.process_time(), time.perf_counter()
    while count < frames and (frame := source.read()) is not None:
        sent += sum(len(encode(message)) for message in step(frame))
        count += 1
    if side_by_side is not None:
        sent += sum(len(encode(message)) for message in side_by_side.flush())
        side_by_side.close()
    spent, passed = time.process_time() - cpu, time.perf_counter() - wall
    counters = pipeline.counters()
    detector.close()
    crops = counters.get("detector_crops", 0.0) / max(1, count)
    return {
        "frames": count,
        "cpu_ms": spent / count * 1e3,
        "fps": count / passed,
        "crops": crops,
        "bytes": sent / count,
    }


def decode_only(path: str, frames: int, *, colour: bool) -> float:
    """CPU milliseconds a frame of decoding alone."""
    source = VideoFile(path, t0_unix_ns=T0_UNIX_NS, bound_s=0.0, colour=colour)
    cpu, count = time.process_time(), 0
    while count < frames and source.read() is not None:
        count += 1
    return (time.process_time() - cpu) / max(1, count) * 1e3


def bare_session(model_file: str, config: DetectorConfig, cores: int, runs: int) -> tuple[float, float]:
    """Runs a second and CPU milliseconds a run of the model alone, on so many threads."""
    spec = input_spec(open_model(model_file), config.input_size_px)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = cores
    session = onnxruntime.InferenceSession(model_file, options, providers=["CPUExecutionProvider"])
    shape = (1, spec.channels, spec.size_px[1], spec.size_px[0])
    image = np.zeros(shape if spec.channels_first else (1, *shape[2:], shape[1]), spec.dtype)
    session.run(None, {spec.name: image})
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(runs):
        session.run(None, {spec.name: image})
    return runs / (time.perf_counter() - wall), (time.process_time() - cpu) / runs * 1e3


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video")
    parser.add_argument("--model", default="", help="a user's ONNX model; the shipped one without")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1, help="frames side by side, for a user's model")
    parser.add_argument("--scan-period-s", type=float, default=1.0)
    parser.add_argument("--cores", type=int, default=1, help="how many cores the process is kept to")
    arguments = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: arguments.cores])
    config = DetectorConfig(model=arguments.model, workers=arguments.workers, scan_period_s=arguments.scan_period_s)
    try:
        found = measure(arguments.video, config, arguments.frames)
        decoding_ms = decode_only(arguments.video, arguments.frames, colour=bool(arguments.model))
        print(f"{found['frames']:.0f} frames: {found['cpu_ms']:.2f} ms CPU a frame, {found['fps']:.1f} frames/s")
        print(
            f"of which decoding {decoding_ms:.2f} ms; {found['crops']:.1f} crops and {found['bytes']:.0f} bytes a frame"
        )
        if arguments.model:
            runs, cpu_ms = bare_session(arguments.model, config, arguments.cores, 50)
            share = found["fps"] / runs
            print(f"bare session: {runs:.1f} runs/s, {cpu_ms:.2f} ms CPU a run; this run reaches {share:.2f} of it")
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

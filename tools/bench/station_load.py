"""What one core sustains: CPU time a message, in the station's core with recording and MAVLink encoding.

`python -m tools.bench.station_load --cameras 6 100 --uavs 5`. CPU time, not wall time: other programs on the computer
do not count. The knee is where messages a second times CPU a message reaches one core.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from calib.station.archive.recording import Recorder
from calib.station.config import EndpointSection, MavlinkSection
from calib.station.core.station import Station
from calib.station.outputs.mavlink.identity import identity_of
from calib.station.outputs.mavlink.messages import MavlinkContext
from calib.station.outputs.mavlink.port import MavlinkPort
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.core_station import station_for
from tools.doubles.flight import ORIGIN, Scene, Spec, make


def calibrated(scene: Scene) -> Station:
    """A calibrated station."""
    station = station_for(scene)
    station.adopt(scene.network)
    return station


def port() -> MavlinkPort:
    """Both profiles."""
    endpoint = EndpointSection(url="udp:127.0.0.1:9", profile=["gcs", "ecef"])
    options = MavlinkSection()
    context = MavlinkContext(ORIGIN, 1, identity_of(options, "bench", Path()), undulation_m=47.0)
    return MavlinkPort(endpoint, options, context, None)


def run(scene: Scene, stream: Iterator[Sent], folder: Path) -> tuple[np.ndarray, int]:
    """CPU ms of every message, from bytes received to MAVLink frames ready; and frames made."""
    station, out, recorder = calibrated(scene), port(), Recorder(folder, SITE, min_free_mb=1)
    spent, made = [], 0
    for sent in stream:
        began = time.process_time_ns()
        recorder.write(sent.key, sent.payload, sent.arrival_ns)
        targets = station.handle(sent.key, sent.payload, sent.arrival_ns)
        made += len(out.targets(targets, sent.arrival_ns, True)) if targets else 0
        spent.append((time.process_time_ns() - began) * 1e-6)
        tick = station.tick(sent.arrival_ns)
        spent[-1] += 0.0 if not tick.publish else (time.process_time_ns() - began) * 1e-6 - spent[-1]
    recorder.close()
    return np.array(spent), made


def main() -> None:
    """One line for each number of cameras."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, nargs="+", default=[6, 25, 50, 100])
    parser.add_argument("--uavs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--rate", type=float, default=30.0)
    options = parser.parse_args()
    for cameras in options.cameras:
        spec = Spec(cameras=cameras, uavs=options.uavs, rate_hz=options.rate, duration_s=options.seconds)
        scene = make(spec)
        ready = list(messages(scene))
        with tempfile.TemporaryDirectory() as folder:
            spent, made = run(scene, iter(ready), Path(folder))
        settled = spent[len(spent) // 3 :]
        core = float(np.mean(settled)) * 1e-3 * cameras * options.rate
        p50, p99 = np.percentile(settled, (50, 99))
        print(
            f"{cameras:4d} cameras x {options.rate:g} Hz x {options.uavs}: CPU ms/message mean {np.mean(settled):.3f}, "
            f"p50 {p50:.3f}, p99 {p99:.3f}; {core:.2f} of a core; {made} frames; seed 0",
            flush=True,
        )


if __name__ == "__main__":
    main()

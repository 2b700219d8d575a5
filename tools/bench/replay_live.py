"""A track folder or recording replayed into a live base-station; what came out over MAVLink against the truth.

`python -m tools.bench.replay_live ../shared/data/eth3 --speed 10 --align yaw`

Real programs on real Zenoh and UDP: the replay says what the boxes said, at the speed asked for, the listener is
independent. Times to first position are in flight seconds. Everything lands in out/replay_live.
"""

import argparse
import shutil
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from calib.geodesy import Origin, ecef_to_enu
from calib.scoring.alignment import ALIGNMENTS
from calib.scoring.consistency import Stated
from calib.scoring.timing import Path as Track
from calib.scoring.trajectory import evaluate
from calib.station.app import main as base_station
from calib.station.archive.replay_source import ReplaySource, open_source
from calib.station.commands.score import read_truth, table
from edge.common.errors import SkyfixError
from tools.demonstration.processes import Programs
from tools.doubles.base import base_config
from tools.doubles.listener import LOST, Listener, Position
from tools.doubles.ports import free_endpoint
from tools.doubles.truth import sent_covariances

OUTPUT: Final = Path("out") / "replay_live"
TAIL_S: Final = 3.0  # after the last message, for what is still under way


def base_toml(source: ReplaySource, listen: str, mavlink_url: str) -> str:
    """A base for these cameras; their positions come from their own fixes."""
    endpoint = {"url": mavlink_url, "profile": ["ecef"], "rate_hz": 200.0}
    mavlink = {"simulated": True, "endpoint": [endpoint]}
    return tomli_w.dumps(base_config(source.site, source.cameras, listen, mavlink=mavlink))


def run(source: ReplaySource, speed: float, folder: Path) -> tuple[list[Position], int]:
    """Replay into a fresh base; all positions heard, and the replay's exit code (1: something was lost)."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with ExitStack() as stack:
        listener = stack.enter_context(Listener())
        programs = stack.enter_context(Programs(folder / "log"))
        listen = free_endpoint()
        config = folder / "base.toml"
        config.write_text(base_toml(source, listen, listener.url), encoding="utf-8")
        base = programs.start("base-station", "base-station", "run", "--config", str(config))
        code = base_station(["replay", str(source.path), "--speed", str(speed), "--connect", listen])
        time.sleep(TAIL_S)
        programs.check()
        base.stop()
        return listener.positions, code


def heard_path(positions: list[Position], origin: Origin) -> tuple[Track, Stated]:
    """Every position of every track in time order, one a time: the flight as a receiver would draw it, its sigma."""
    times = np.array([position.time_ns for position in positions], np.int64)
    _, first = np.unique(times, return_index=True)
    kept = [positions[k] for k in first.tolist()]
    enu = ecef_to_enu(np.array([position.ecef_m for position in kept], float), origin)
    cameras = np.array([position.cameras for position in kept], np.int64)
    covariance = sent_covariances([position.covariance for position in kept], origin)
    return Track(np.asarray(times[first] * 1e-9, float), enu), Stated(covariance, cameras)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, metavar="FOLDER_OR_RECORDING")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--truth", type=Path, help="default: truth.csv in the folder")
    parser.add_argument("--align", choices=ALIGNMENTS, default="yaw")
    return parser.parse_args()


def main() -> int:
    """Replay, score, print."""
    arguments = _arguments()
    try:
        source = open_source(arguments.source)
        began = time.monotonic()
        positions, code = run(source, arguments.speed, OUTPUT)
        took_s = time.monotonic() - began
        heard = [position for position in positions if position.state != LOST]
        if not heard:
            raise SkyfixError("no position came", where=str(OUTPUT), action="see the log there")
        first_ns = min(message.t_ns for message in source.messages(epoch=0))
        origin = (source.folder and source.folder.site.origin) or (0.0, 0.0, 0.0)
        path, stated = heard_path(heard, origin)
        truth = read_truth(arguments.truth or arguments.source / "truth.csv")
        result = evaluate(path, truth, arguments.align, stated=stated)
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    tracks = sorted({position.track for position in heard})
    print(f"{len(heard)} positions of {len(tracks)} tracks in {took_s:.0f} s")
    print(f"first position {(heard[0].time_ns - first_ns) * 1e-9:.1f} s of flight after the first message")
    print(table(result))
    print("the replay lost nothing" if code == 0 else "the replay lost messages: see above")
    return code


if __name__ == "__main__":
    sys.exit(main())

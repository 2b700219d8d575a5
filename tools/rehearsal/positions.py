"""Wait for MAVLink positions on this network: `python -m tools.rehearsal.positions PORT COUNT SECONDS`.

An independent receiver (tools/doubles/listener.py); run on a machine's network, it says how many came and when. With a
scene and the instant (UTC, ns) at which it began, it says too how far they are from the truth.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Final

import numpy as np

from calib.simulation.simulation import watch
from calib.station.archive.scene_file import load
from tools.demonstration.score import errors_m
from tools.doubles.listener import LOST, Listener, Position

NEAR_M: Final = 2.0  # half of them at least: small pictures, a calibration of seconds, and still a true position


def rmse_m(positions: list[Position], scene_file: Path, began_unix_ns: int) -> float:
    """Of all positions but farewells, against the scene's first object. m."""
    scene = load(scene_file)
    kept = [position for position in positions if position.state != LOST]
    errors = errors_m(kept, watch(scene).flights, began_unix_ns, scene.origin)[:, 0]
    return float(np.sqrt(np.mean(np.square(errors))))


def main() -> int:
    """0 if enough came in time, and were true."""
    parser = argparse.ArgumentParser()
    for name, kind in (("port", int), ("count", int), ("within_s", float)):
        parser.add_argument(name, type=kind)
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--began", type=int, default=0)
    options = parser.parse_args()
    began_s = time.monotonic()
    with Listener(options.port) as listener:
        print("listening", flush=True)
        first_s = time.monotonic() - began_s if listener.wait(1, options.within_s) else None
        enough = listener.wait(options.count, max(0.0, options.within_s - (time.monotonic() - began_s)))
        told: dict[str, float | None] = {"first_s": first_s, "positions": len(listener.positions)}
        if options.scene and enough:
            told["rmse_m"] = round(rmse_m(list(listener.positions), options.scene, options.began), 3)
    print(json.dumps(told), flush=True)
    return 0 if enough and (told.get("rmse_m") or 0.0) < NEAR_M else 1


if __name__ == "__main__":
    sys.exit(main())

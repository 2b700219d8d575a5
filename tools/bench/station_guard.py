"""How soon the guard notices a knocked camera or a stepped clock, and how often it cries wolf.

`python -m tools.bench.station_guard --scenes 10 --quiet-hours 0.5`. Only raw frames go in, as in the station.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from tools.doubles.faults import FAULTS, VICTIM, faulty_frames, findings
from tools.doubles.flight import Spec, frames, make

EVENT_S = 12.0


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=10)
    parser.add_argument("--quiet-hours", type=float, default=0.2, help="of simulated time in which nothing happens")
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--uavs", type=int, default=3)
    parser.add_argument("--birds", type=int, default=0)
    parser.add_argument("--rate", type=float, default=15.0)
    options = parser.parse_args()
    spec = Spec(cameras=options.cameras, uavs=options.uavs, birds=options.birds, rate_hz=options.rate, duration_s=30.0)
    for fault in FAULTS:
        delays, wrong, missed, reasons = [], 0, 0, set()
        for seed in range(options.scenes):
            scene = make(replace(spec, seed=seed))
            found = findings(scene, faulty_frames(scene, fault, EVENT_S))
            right = [(at_s, f) for at_s, f in found if f.camera == VICTIM and at_s > EVENT_S]
            wrong += len(found) - len(right[:1])
            missed += not right
            delays += [right[0][0] - EVENT_S] if right else []
            reasons |= {right[0][1].reason} if right else set()
        worst = max(delays, default=0.0)
        spread = f"median {np.median(delays):.1f} s, worst {worst:.1f} s" if delays else "never noticed"
        print(f"{fault.name}: {spread}; missed {missed}, others accused {wrong}, of {options.scenes}")
        print(f"    {sorted(reasons)[:3]}", flush=True)
    quiet(replace(spec, duration_s=60.0), options.quiet_hours)


def quiet(spec: Spec, hours: float) -> None:
    """Scenes in which nothing happens."""
    began, alarms, seconds, seed = time.monotonic(), 0, 0.0, 1000
    while seconds < hours * 3600:
        scene = make(replace(spec, seed=seed))
        alarms += len(findings(scene, frames(scene)))
        seconds += spec.duration_s
        seed += 1
    took_s = time.monotonic() - began
    print(f"false alarms: {alarms} in {seconds / 3600:.2f} simulated hours (took {took_s:.0f} s, seeds from 1000)")


if __name__ == "__main__":
    main()

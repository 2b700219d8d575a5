"""How soon the guard notices a knocked camera or a stepped clock, and how often it cries wolf.

`python -m tools.bench.station_guard --scenes 10 --quiet-hours 0.5`. Only raw frames go in, as in the station.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.guarding.monitor import Finding, Guard
from calib.observations import Frame
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make, perturbed

CALL_NS = 100_000_000  # as the station's loop asks
EVENT_S = 12.0


@dataclass(frozen=True)
class Fault:
    """What happens to camera 2 at EVENT_S."""

    name: str
    turn_deg: float = 0.0
    step_s: float = 0.0
    tilt_deg_per_s: float = 0.0


FAULTS = (
    Fault("knocked by 0.3 degrees", turn_deg=0.3),
    Fault("clock stepped by 50 ms", step_s=0.05),
    Fault("tilting 0.05 degrees a second", tilt_deg_per_s=0.05),
)


def faulty_frames(scene: Scene, fault: Fault, event_s: float = EVENT_S) -> Iterator[tuple[int, Frame]]:
    """The scene's frames, camera 2's as they are with the fault."""
    rng = np.random.default_rng(scene.spec.seed + 77)
    axis = np.append(rng.normal(size=2), 0.0)  # across the view: a roll about it would hardly show in its middle
    axis /= np.linalg.norm(axis)
    event_ns = T0_UNIX_NS + round(event_s * 1e9)
    turned = _turned(scene, axis * np.radians(fault.turn_deg))
    before, after = frames(scene), frames(turned)
    for (arrival_ns, frame), (_, other) in zip(before, after, strict=True):
        if arrival_ns < event_ns or frame.camera != "cam2":
            yield arrival_ns, frame
        elif fault.step_s:
            yield arrival_ns, replace(frame, t_unix_ns=frame.t_unix_ns + round(fault.step_s * 1e9))
        elif fault.tilt_deg_per_s:
            tilt_px = np.radians(fault.tilt_deg_per_s * (arrival_ns - event_ns) * 1e-9) * 1300
            yield arrival_ns, replace(frame, pixels=frame.pixels + np.array([0.0, tilt_px]))
        else:
            yield arrival_ns, other


def _turned(scene: Scene, vector: np.ndarray) -> Scene:
    change = np.concatenate([vector, np.zeros(3)])
    return replace(scene, truth=tuple(perturbed(c, change) if c.id == "cam2" else c for c in scene.truth))


def watch(scene: Scene, stream: Iterator[tuple[int, Frame]]) -> list[tuple[float, Finding]]:
    """What the guard finds, when; a camera found is left out as the station would."""
    guard = Guard()
    guard.trust(scene.network)
    found, due_ns = [], 0
    for arrival_ns, frame in stream:
        guard.observe(frame)
        if arrival_ns >= due_ns:
            due_ns = arrival_ns + CALL_NS
            for finding in guard.findings(frame.t_unix_ns):
                guard.ignore(finding.camera)
                found.append(((arrival_ns - T0_UNIX_NS) * 1e-9, finding))
    return found


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
            found = watch(scene, faulty_frames(scene, fault))
            right = [(at_s, f) for at_s, f in found if f.camera == "cam2" and at_s > EVENT_S]
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
        alarms += len(watch(scene, frames(scene)))
        seconds += spec.duration_s
        seed += 1
    took_s = time.monotonic() - began
    print(f"false alarms: {alarms} in {seconds / 3600:.2f} simulated hours (took {took_s:.0f} s, seeds from 1000)")


if __name__ == "__main__":
    main()

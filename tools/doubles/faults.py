"""What goes wrong with a camera of a scene: knocked, its clock stepped, slowly tilting. And what the guard makes of it.

Only raw frames go in, as in the station; cam2 is the one it happens to.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from calib.guarding.monitor import Finding, Guard
from calib.observations import Frame
from calib.simulation.description import Bump
from calib.simulation.simulation import watch
from tools.doubles.box_messages import CLOCK_BOUND_S
from tools.doubles.flight import T0_UNIX_NS, Scene, frames

VICTIM: Final = "cam2"
CALL_NS: Final = 100_000_000  # as the station's loop asks


@dataclass(frozen=True)
class CameraFault:
    """What happens to the victim."""

    name: str
    turn_deg: float = 0.0
    step_s: float = 0.0
    tilt_deg_per_s: float = 0.0


KNOCKED: Final = CameraFault("knocked by 0.3 degrees", turn_deg=0.3)
CLOCK_STEPPED: Final = CameraFault("clock stepped by 50 ms", step_s=0.05)
TILTING: Final = CameraFault("tilting 0.05 degrees a second", tilt_deg_per_s=0.05)
FAULTS: Final = (KNOCKED, CLOCK_STEPPED, TILTING)


def faulty_frames(
    scene: Scene, fault: CameraFault, event_s: float, victim: str = VICTIM
) -> Iterator[tuple[int, Frame]]:
    """The scene's frames, the victim's as they are with the fault from event_s on."""
    event_ns = T0_UNIX_NS + round(event_s * 1e9)
    for arrival_ns, frame in frames(_knocked(scene, fault.turn_deg, event_s, victim) if fault.turn_deg else scene):
        late_s = (arrival_ns - event_ns) * 1e-9
        if frame.camera != victim or late_s < 0:
            yield arrival_ns, frame
            continue
        tilt_px = np.radians(fault.tilt_deg_per_s * late_s) * _focal_px(scene, victim)
        stamp_ns = frame.t_unix_ns + round(fault.step_s * 1e9)
        yield arrival_ns, replace(frame, t_unix_ns=stamp_ns, pixels=frame.pixels + np.array([0.0, tilt_px]))


def findings(
    scene: Scene,
    stream: Iterator[tuple[int, Frame]],
    bound_s: float | None = CLOCK_BOUND_S,
    said_s: dict[str, float | None] | None = None,
) -> list[tuple[float, Finding]]:
    """What the guard finds, and when (s); a camera found is left out as the station would.

    bound_s: what all state of their clocks, but for those of said_s.
    """
    guard = Guard()
    guard.trust(scene.network)
    for camera in scene.network.cameras:
        guard.state_clock(camera.id, (said_s or {}).get(camera.id, bound_s))
    found, due_ns = [], 0
    for arrival_ns, frame in stream:
        guard.observe(frame)
        if arrival_ns >= due_ns:
            due_ns = arrival_ns + CALL_NS
            for finding in guard.findings(frame.t_unix_ns):
                if finding.camera is None:
                    guard.forget()
                else:
                    guard.ignore(finding.camera)
                found.append(((arrival_ns - T0_UNIX_NS) * 1e-9, finding))
    return found


def _focal_px(scene: Scene, victim: str) -> float:
    return next(camera.lens.intrinsics[1] for camera in scene.truth if camera.id == victim)


def _knocked(scene: Scene, turn_deg: float, event_s: float, victim: str) -> Scene:
    """The same scene, with the same errors, the victim turned at event_s."""
    rng = np.random.default_rng(scene.spec.seed + 77)
    axis = rng.normal(size=2)  # across the view: a roll about it would hardly show in its middle
    x, y = (axis / np.linalg.norm(axis) * turn_deg).tolist()
    knock = Bump(at_s=event_s, rotation_deg=(x, y, 0.0))
    before = scene.watched.simulation
    cameras = tuple(
        msgspec.structs.replace(camera, bump=(knock,)) if camera.id == victim else camera for camera in before.camera
    )
    return replace(scene, watched=watch(msgspec.structs.replace(before, camera=cameras)))

"""The configurations of a demo site: three boxes, one base, all on loopback and all below one folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from calib.simulation.description import CameraSpec, Simulation
from edge.common.arrays import Array
from tools.demonstration.receivers import UNDULATION_M
from tools.doubles.base import base_config

ANTENNA_ABOVE_LENS_M: Final = 0.12  # on the tripod's head
FOCAL_SIGMA_PX: Final = 1.5  # what `edge-node lens` says after an ordinary session with a chessboard
RESOLVE_S: Final = 15.0
CLOCK_BOUND_S: Final = 0.001  # one computer, one clock: nothing else keeps it apart


@dataclass(frozen=True)
class Ports:
    """Ports on loopback."""

    zenoh: int
    mavlink: int
    status: int


def antenna_enu(camera: CameraSpec) -> Array:
    """(3,) where the RTK antenna of a tripod is."""
    east, north, up = camera.centre_enu
    return np.array([east, north, up + ANTENNA_ABOVE_LENS_M])


@dataclass(frozen=True)
class Inputs:
    """What a box is fed with: its video, its receiver's port, and when the scene begins (UTC)."""

    video: Path
    device: str
    start_unix_ns: int


def box(name: str, camera: CameraSpec, inputs: Inputs, ports: Ports) -> str:
    """edge.toml of one tripod of the site `name`; its video begins at the scene's start plus the camera's phase."""
    first_frame_unix_ns = inputs.start_unix_ns + round(camera.phase_s * 1e9)
    # A camera hands a frame over when its last row has been read, not when its first is exposed.
    delivery_ns = round((camera.exposure_s / 2 + camera.readout_s) * 1e9)
    config: dict[str, Any] = {
        "site": name,
        "camera": [
            {
                "id": camera.id,
                "readout_s": camera.readout_s,
                "source": {
                    "path": str(inputs.video),
                    "realtime": True,
                    "t0_unix_ns": first_frame_unix_ns,
                    "bound_s": 0.0,
                    "start_at_unix_ns": first_frame_unix_ns + delivery_ns,
                },
                "lens": {
                    "model": camera.lens,
                    "intrinsics": list(camera.published_intrinsics or camera.intrinsics),
                    "distortion": list(camera.published_distortion or camera.distortion),
                    "size_px": list(camera.size_px),
                    "focal_sigma_px": FOCAL_SIGMA_PX,
                },
            }
        ],
        "link": {"connect": [f"tcp/127.0.0.1:{ports.zenoh}"]},
        "gnss": {
            "device": inputs.device,
            "service": "own-base",
            "frame": "ITRF2020",
            "lever_arm_m": [0.0, 0.0, ANTENNA_ABOVE_LENS_M],
        },
        "clock": {"source": "assumed", "assumed_bound_s": CLOCK_BOUND_S},
    }
    return tomli_w.dumps(config)


def base(scene: Simulation, ports: Ports) -> str:
    """base.toml of the field computer; relative paths are beside the file."""
    config = base_config(
        scene.name,
        [camera.id for camera in scene.camera],
        f"tcp/127.0.0.1:{ports.zenoh}",
        site={"undulation_m": UNDULATION_M},
        # A flight of a minute: the first calibration, from its first seconds, is refined while it lasts.
        calibration={"resolve_s": RESOLVE_S},
        mavlink={
            "simulated": True,
            "endpoint": [{"url": f"udp:127.0.0.1:{ports.mavlink}", "profile": ["gcs", "ecef"]}],
        },
        recording={"folder": "recording", "min_free_mb": 50},
        status={"port": ports.status, "page": True},
    )
    return tomli_w.dumps(config)

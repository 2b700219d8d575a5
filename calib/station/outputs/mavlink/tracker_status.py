"""The station's standing in MAVLink's words: masks of cameras, and one state of the system. Pure.

The hazard is a green heartbeat from a station that is blind. So the state is that of what is needed to send a true
position: without a camera it stands by, and blind, with fewer than two calibrated ones, it is critical. A station at
fault sends no heartbeat at all (output.py).
"""

from collections.abc import Iterable
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.core.calibration import Phase
from calib.station.outputs.mavlink.messages import TrackerStatus
from calib.station.outputs.output import StationStanding

MASK_BITS: Final = 32  # cameras beyond have no bit
REPLAYED_MS: Final = 10_000.0  # a recording played again was exposed long ago: that is no latency
MAV_STATES: Final = {
    Phase.COLLECTING: common.MAV_STATE_CALIBRATING,
    Phase.CALIBRATED: common.MAV_STATE_ACTIVE,
    Phase.SUSPECT: common.MAV_STATE_CRITICAL,
    Phase.BLIND: common.MAV_STATE_CRITICAL,
}


def tracker_status(standing: StationStanding) -> TrackerStatus:
    """The fields of TRACKER_STATUS and HEARTBEAT."""
    cameras, latency_ms = standing.cameras, standing.latency_ms
    return TrackerStatus(
        t_unix_ns=standing.t_unix_ns,
        uptime_ms=standing.uptime_ms,
        configured=_mask(True for _ in cameras),
        online=_mask(camera.online for camera in cameras),
        synced=_mask(camera.synced for camera in cameras),
        calibrated=_mask(camera.calibrated for camera in cameras),
        latency_ms=latency_ms if latency_ms is not None and 0 <= latency_ms < REPLAYED_MS else None,
        confirmed=standing.confirmed,
        tentative=standing.tentative,
        system_status=system_status(standing),
    )


def system_status(standing: StationStanding) -> int:
    """MAV_STATE: the worst of what is needed to send a true position."""
    if not any(camera.online for camera in standing.cameras):
        return int(common.MAV_STATE_STANDBY)
    return int(MAV_STATES[standing.phase])


def _mask(bits: Iterable[bool]) -> int:
    return sum(1 << k for k, bit in enumerate(bits) if bit and k < MASK_BITS)

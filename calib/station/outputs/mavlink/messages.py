"""What is sent in MAVLink about targets and the station: which message, which field, which value when unknown.

The hazard is the receiver. Ground-control programs ignore validity flags, draw heights as above sea level whatever the
type says, take a message without coordinates for a refresh, and crash or wrap where a field overflows. So what cannot
be stated truly is not sent at all, and every number is brought into its field's range here, because pymavlink raises
where C wraps. Sources per rule: MAVLink's common.xml, and what QGroundControl, Mission Planner and MAVProxy do with it.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import common

from calib.geodesy import Origin, enu_to_geodetic
from calib.station.core.outgoing import UPPER, OutgoingTarget
from calib.station.outputs.mavlink import dialect
from calib.tracking.estimates import TargetState

ICAO_BAND: Final = 0x3FFF  # unallocated by ICAO; MAVProxy draws this band as drones
HEADING_FROM_M_S: Final = 1.0  # slower than that a course over ground is noise
UINT32: Final = 0xFFFFFFFF  # time_boot_ms wraps after 49.7 days
CALLSIGN_LETTERS: Final = 8
STATUS_BYTES: Final = 50  # of a STATUSTEXT chunk

TRACK_STATES: Final = {
    TargetState.TENTATIVE: dialect.TRACK_STATE_TENTATIVE,
    TargetState.CONFIRMED: dialect.TRACK_STATE_CONFIRMED,
    TargetState.COASTING: dialect.TRACK_STATE_COASTING,
    TargetState.LOST: dialect.TRACK_STATE_LOST,
}

for _id, _kind in dialect.mavlink_map.items():  # so that pymavlink's own parser and sender know our messages
    common.mavlink_map.setdefault(_id, _kind)


@dataclass(frozen=True)
class Identity:
    """What tells a station from others on one network.

    component_gcs, component_ecef: who sends what is for ground stations, and what is in ECEF; two, because a receiver
    that does not know our dialect reports what it can't read of a shared one as lost, 66 %. icao_first, icao_count:
    addresses its tracks are drawn under. callsign: what theirs begin with, up to four letters.
    """

    component_gcs: int
    component_ecef: int
    icao_first: int
    icao_count: int
    callsign: str


@dataclass(frozen=True)
class MavlinkContext:
    """What all messages of a station share. undulation_m: geoid above ellipsoid, None if no gcs endpoint needs it."""

    origin: Origin
    epoch: int
    identity: Identity
    simulated: bool = False
    undulation_m: float | None = None


@dataclass(frozen=True)
class TrackerStatus:
    """The station's own health. Masks by the configuration's order; latency: 95th percentile, None if unknown."""

    t_unix_ns: int
    uptime_ms: int
    configured: int
    online: int
    synced: int
    calibrated: int
    latency_ms: float | None
    confirmed: int
    tentative: int
    system_status: int = common.MAV_STATE_BOOT


def target_track_ecef(
    target: OutgoingTarget, context: MavlinkContext, synced: bool
) -> dialect.MAVLink_target_track_ecef_message:
    """TARGET_TRACK_ECEF 45000."""
    flags = dialect.TRACK_FLAGS_VELOCITY_VALID | dialect.TRACK_FLAGS_COV_VALID
    flags |= dialect.TRACK_FLAGS_TIME_SYNCED if synced else 0
    flags |= dialect.TRACK_FLAGS_DEGRADED if target.degraded else 0
    flags |= 0 if target.verified else dialect.TRACK_FLAGS_UNVERIFIED
    flags |= dialect.TRACK_FLAGS_SIMULATED if context.simulated else 0
    return dialect.MAVLink_target_track_ecef_message(
        time_usec=target.t_unix_ns // 1000,
        pos=target.ecef_m.tolist(),
        vel=target.velocity_ecef_m_s.tolist(),
        cov=target.covariance[UPPER].tolist(),
        gdop=math.nan,  # says less than the covariance, which is there
        track_id=target.track & UINT32,
        meas_age=_within(target.age_s * 1e3, 0, UINT32),
        camera_mask=target.camera_mask,
        epoch=context.epoch & 0xFFFF,
        flags=flags,
        state=TRACK_STATES[target.state],
        camera_count=_within(len(target.cameras), 0, 255),
        quality=_within(target.quality * 100, 0, 100),
    )


def adsb_vehicle(target: OutgoingTarget, context: MavlinkContext) -> common.MAVLink_adsb_vehicle_message:
    """ADSB_VEHICLE 246: position, course and height above sea level of somebody else's aircraft."""
    assert context.undulation_m is not None
    latitude, longitude, height_m = enu_to_geodetic(target.position_enu[None], context.origin)[0].tolist()
    east, north, up = target.velocity_enu.tolist()
    speed = math.hypot(east, north)
    flags = common.ADSB_FLAGS_VALID_COORDS | common.ADSB_FLAGS_VALID_ALTITUDE | common.ADSB_FLAGS_VALID_VELOCITY
    flags |= common.ADSB_FLAGS_VALID_CALLSIGN | common.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
    flags |= common.ADSB_FLAGS_VALID_HEADING if speed >= HEADING_FROM_M_S else 0
    flags |= common.ADSB_FLAGS_SIMULATED if context.simulated else 0
    return common.MAVLink_adsb_vehicle_message(
        ICAO_address=icao(target.track, context.identity),
        lat=round(latitude * 1e7),
        lon=round(longitude * 1e7),
        altitude_type=common.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        altitude=round((height_m - context.undulation_m) * 1e3),
        heading=round(math.degrees(math.atan2(east, north)) % 360 * 100) % 36000,
        hor_velocity=_within(speed * 100, 0, 65535),
        ver_velocity=_within(up * 100, -32767, 32767),
        callsign=callsign(target.track, context.identity),
        emitter_type=common.ADSB_EMITTER_TYPE_UAV,
        tslc=_within(math.floor(target.age_s), 0, 255),
        flags=flags,
        squawk=0,  # receivers read another as an obstacle's radius
    )


def icao(track: int, identity: Identity) -> int:
    """The address a track is drawn under: one of the station's, reused only after all its others."""
    return (track - 1) % identity.icao_count + identity.icao_first


def callsign(track: int, identity: Identity) -> bytes:
    """Eight characters of its own for each track; equal ones make ground stations blink."""
    number = str((track - 1) % identity.icao_count + 1)
    return (identity.callsign + number.zfill(CALLSIGN_LETTERS - len(identity.callsign))).encode("ascii") + b"\0"


def heartbeat(status: TrackerStatus) -> common.MAVLink_heartbeat_message:
    """HEARTBEAT of a component that is no vehicle and no ground station."""
    return common.MAVLink_heartbeat_message(
        type=common.MAV_TYPE_ADSB,
        autopilot=common.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=status.system_status,
        mavlink_version=3,
    )


def system_time(status: TrackerStatus, now_unix_ns: int) -> common.MAVLink_system_time_message:
    """SYSTEM_TIME. now_unix_ns: UTC that others may set themselves by, so never a recording's; 0: none."""
    return common.MAVLink_system_time_message(
        time_unix_usec=now_unix_ns // 1000, time_boot_ms=status.uptime_ms & UINT32
    )


def tracker_status(status: TrackerStatus, context: MavlinkContext) -> dialect.MAVLink_tracker_status_message:
    """TRACKER_STATUS 45001."""
    return dialect.MAVLink_tracker_status_message(
        time_usec=status.t_unix_ns // 1000,
        uptime_ms=status.uptime_ms & UINT32,
        cameras_configured=status.configured,
        cameras_online=status.online,
        cameras_synced=status.synced,
        cameras_calibrated=status.calibrated,
        latency_ms=65535 if status.latency_ms is None else _within(status.latency_ms, 0, 65534),
        epoch=context.epoch & 0xFFFF,
        tracks_confirmed=_within(status.confirmed, 0, 255),
        tracks_tentative=_within(status.tentative, 0, 255),
    )


def status_texts(severity: int, text: str, number: int) -> list[common.MAVLink_statustext_message]:
    """STATUSTEXT in as many chunks as it takes; `number` tells long texts apart."""
    raw = text.encode("ascii", "replace")
    chunks = [raw[k : k + STATUS_BYTES] for k in range(0, len(raw), STATUS_BYTES)] or [b""]
    ident = 0 if len(chunks) == 1 else number % 65535 + 1
    return [
        common.MAVLink_statustext_message(severity, chunk.ljust(STATUS_BYTES, b"\0"), ident, k)
        for k, chunk in enumerate(chunks[:8])
    ]


def _within(value: float, low: int, high: int) -> int:
    return int(np.clip(round(value), low, high)) if math.isfinite(value) else high

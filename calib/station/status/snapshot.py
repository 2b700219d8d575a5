"""The station's status, put together from its parts once a second."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.geodesy import Origin, enu_to_geodetic
from calib.station.core.calibration import Phase
from calib.station.core.intake import CameraIntake
from calib.station.core.outgoing import OutgoingTarget
from calib.station.core.station import Station
from calib.station.status.status import CameraStatus, EndpointStatus, PairStatus, StationStatus, TargetStatus
from edge import __version__
from edge.common.units import NS

UPPER_3X3: Final = np.triu_indices(3)  # of a covariance, as it is published


@dataclass(frozen=True)
class StationView:
    """What a status is made of: the station's core, and what the loop round it knows.

    epoch: this start's number. began_ns: its instant. latency_ms: median and 99th percentile, received to sent.
    recording, recording_folder: the file that is written now, and where it lies. free_mb: on that disk.
    """

    station: Station
    epoch: int
    began_ns: int
    solving: bool
    latency_ms: tuple[float, float] | None
    endpoints: Sequence[EndpointStatus]
    recording: str | None
    recording_folder: str | None
    free_mb: int | None
    counters: Mapping[str, float]


def snapshot(view: StationView, now_ns: int) -> StationStatus:
    """How everything is at now_ns. The station's health must have been assessed before."""
    station = view.station
    network, report = station.calibration.network, station.calibration.report
    now_unix_ns = station.now_unix_ns(now_ns)
    assert station.health is not None
    standing = station.standing
    return StationStatus(
        site=station.config.site.name,
        version=__version__,
        epoch=view.epoch,
        t_unix_ns=now_unix_ns,
        uptime_s=(now_ns - view.began_ns) / NS,
        phase=standing.phase.value,
        reason=standing.reason,
        action=standing.action,
        first_solve_s=station.config.calibration.first_solve_s,
        origin=station.positions.origin if network is None else network.origin,
        frame=station.frame.label,
        frame_sigma_m=station.frame.sigma_m,
        network=None if network is None else network.fingerprint,
        rms_px=None if network is None else network.rms_px,
        sigma_m=None if report is None or standing.phase is Phase.COLLECTING else report.sigma_m,
        solving=view.solving,
        cameras=[_camera(station, box, now_ns) for box in station.intake.cameras.values()],
        pairs=_pairs(station),
        targets=[] if network is None else _targets(station.current(now_unix_ns), network.origin),
        tentative=0 if station.tracker is None else station.tracker.tentative,
        latency_ms=view.latency_ms,
        endpoints=list(view.endpoints),
        recording=view.recording,
        recording_folder=view.recording_folder,
        free_mb=view.free_mb,
        health=station.health,
        counters=dict(sorted(station.health.counters.items())) | dict(view.counters),
    )


def _pairs(station: Station) -> list[PairStatus]:
    residuals = station.guard.residual_mrad
    return [
        PairStatus(
            one=pair.one,
            other=pair.other,
            shared_s=pair.shared_s,
            residual_mrad=residuals.get((pair.one, pair.other)),
        )
        for pair in station.calibration.pairs(station.window)
    ]


def _camera(station: Station, box: CameraIntake, now_ns: int) -> CameraStatus:
    network = station.calibration.network
    calibrated = None if network is None else network.camera(box.id)
    place = station.positions.of(box.id, box)
    item = next(item for item in station.health.items if item.name == f"camera {box.id}") if station.health else None
    return CameraStatus(
        id=box.id,
        online=box.online(now_ns, station.config.tracking.stale_s),
        present=box.present,
        last_frame_s=None if box.last_ns is None else (now_ns - box.last_ns) / NS,
        detections_per_frame=box.detections,
        clock_bound_s=box.clock_bound_s,
        clock_offset_s=None if calibrated is None else calibrated.clock_offset_s,
        surveyed=station.positions.known(box.id, box),
        calibrated=box.id in station.calibration.trusted,
        suspect=station.calibration.suspects.get(box.id, ""),
        missed=box.counters["missed"],
        reason="" if item is None else item.reason,
        muted=box.id in station.muted,
        centre_enu=None if place is None else _triple(place[0]),
        receiver=box.said_of("gnss"),
        counters=dict(box.counters),
    )


def _targets(targets: list[OutgoingTarget], origin: Origin) -> list[TargetStatus]:
    positions_enu = np.array([target.position_enu for target in targets]).reshape(-1, 3)
    places = enu_to_geodetic(positions_enu, origin).tolist()
    return [_target(target, _triple(place)) for target, place in zip(targets, places, strict=True)]


def _target(target: OutgoingTarget, geodetic: tuple[float, float, float]) -> TargetStatus:
    return TargetStatus(
        track=target.track,
        state=target.state.value,
        enu_m=_triple(target.position_enu),
        velocity_enu_m_s=_triple(target.velocity_enu),
        covariance_enu_m2=tuple(target.position_covariance_enu[UPPER_3X3].tolist()),
        geodetic=geodetic,
        cameras=list(target.cameras),
        age_s=target.age_s,
        sigma_m=target.sigma_m,
    )


def _triple(vector: np.ndarray | Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z

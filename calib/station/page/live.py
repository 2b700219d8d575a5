"""What the page has received, and what a browser gets of it ten times a second. Pure: time is handed in.

The hazard is the frozen picture that looks alive. Every frame says how old what it shows is, and a browser that gets no
frames says so itself (static/station.js).
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import numpy as np

from calib.geodesy import Origin, R_ecef_enu, ecef_to_enu
from calib.station.status.status import StationStatus
from edge.common.arrays import Array
from edge.lens import LensModel, pixel_to_ray
from edge.messages import Health, NetworkCamera, NetworkMessage, Targets, Tracks

TRAIL_S: Final = 60.0  # of a target's way that is drawn
TRAIL_STEP_S: Final = 0.2
COVERAGE_CELL_M: Final = 10.0  # of the map of where two cameras saw something
SIGHT_CELLS: Final = 4000
RAY_S: Final = 0.5  # a ray is drawn so long after its frame


@dataclass
class Sight:
    """What one camera saw last. t_s: when it came; seen: (N, 6) u, v, width, height px, track, confirmed."""

    t_s: float
    size_px: tuple[int, int]
    rays: Array
    seen: list[list[float]]


@dataclass
class Trail:
    """Where a target was: seconds and ENU metres."""

    points: deque[tuple[float, list[float]]] = field(default_factory=lambda: deque(maxlen=int(TRAIL_S / TRAIL_STEP_S)))


class Live:
    """All that is known of now."""

    def __init__(self) -> None:
        self.status: StationStatus | None = None
        self.received_s = -np.inf
        self.health: dict[str, Health] = {}
        self.previews: dict[str, tuple[int, bytes]] = {}
        self.coverage: dict[tuple[int, int], int] = {}
        self._network: NetworkMessage | None = None
        self._targets: Targets | None = None
        self._targets_s = -np.inf
        self._sights: dict[str, Sight] = {}
        self._trails: dict[int, Trail] = {}

    def take(self, name: str, payload: bytes, now_s: float) -> None:
        """One packet. Raises msgspec.MsgspecError if it is not what its name says."""
        kind, _, camera = name.partition("/")
        if kind == "status":
            self.status, self.received_s = msgspec.json.decode(payload, type=StationStatus), now_s
        elif kind == "network":
            self._network = msgspec.json.decode(payload, type=NetworkMessage)
        elif kind == "targets":
            self._take_targets(msgspec.json.decode(payload, type=Targets), now_s)
        elif kind == "tracks":
            self._sights[camera] = _sight(msgspec.json.decode(payload, type=Tracks), now_s)
        elif kind == "health":
            self.health[camera] = msgspec.json.decode(payload, type=Health)
        elif kind == "preview":
            self.previews[camera] = (self.previews.get(camera, (0, b""))[0] + 1, payload)

    @property
    def origin(self) -> Origin | None:
        """Of the ENU frame."""
        if self._network is not None and self._network.origin is not None:
            return self._network.origin
        return None if self.status is None else self.status.origin

    def focal_px(self) -> dict[str, float]:
        """Each calibrated camera's focal length, px: what turns milliradians into pixels."""
        cameras = [] if self._network is None else self._network.cameras
        return {camera.id: (camera.lens.intrinsics[0] + camera.lens.intrinsics[1]) / 2 for camera in cameras}

    def _take_targets(self, message: Targets, now_s: float) -> None:
        self._targets, self._targets_s = message, now_s
        origin = self.origin
        if origin is None or not message.targets:
            return
        places = ecef_to_enu(np.array([target.ecef_m for target in message.targets]), origin)
        for target, place in zip(message.targets, places.tolist(), strict=True):
            trail = self._trails.setdefault(target.track, Trail())
            if not trail.points or now_s - trail.points[-1][0] >= TRAIL_STEP_S:
                trail.points.append((now_s, [round(v, 2) for v in place]))
            if len(target.cameras) >= 2 and len(self.coverage) < SIGHT_CELLS:
                cell = (int(place[0] // COVERAGE_CELL_M), int(place[1] // COVERAGE_CELL_M))
                self.coverage[cell] = self.coverage.get(cell, 0) + 1
        for track in [track for track, trail in self._trails.items() if now_s - trail.points[-1][0] > TRAIL_S]:
            del self._trails[track]

    # What a browser gets

    def frame(self, now_s: float) -> dict[str, Any]:
        """The moving part: targets and rays."""
        return {
            "age_s": None if self.status is None else round(now_s - self.received_s, 2),
            "targets": self._target_rows(now_s),
            "rays": self._ray_rows(now_s),
            "sights": {
                camera: {"size": sight.size_px, "seen": sight.seen, "age_s": round(now_s - sight.t_s, 2)}
                for camera, sight in self._sights.items()
            },
            "previews": {camera: number for camera, (number, _) in self.previews.items()},
        }

    def scene(self) -> dict[str, Any]:
        """The rest: cameras, phase, trails, coverage; once a second is enough."""
        status = self.status
        return {
            "site": "" if status is None else status.site,
            "origin": self.origin,
            "phase": "" if status is None else status.phase,
            "cameras": self._camera_rows(),
            "trails": {track: [point for _, point in trail.points] for track, trail in self._trails.items()},
            "coverage": [[east, north, count] for (east, north), count in self.coverage.items()],
            "cell_m": COVERAGE_CELL_M,
        }

    def _target_rows(self, now_s: float) -> list[dict[str, Any]]:
        origin = self.origin
        if self._targets is None or origin is None or now_s - self._targets_s > 1.0:
            return []
        return target_rows(self._targets, origin)

    def _ray_rows(self, now_s: float) -> list[dict[str, Any]]:
        if self._network is None:
            return []
        rows = []
        for camera in self._network.cameras:
            sight = self._sights.get(camera.id)
            if sight is not None and now_s - sight.t_s < RAY_S and len(sight.rays):
                rotation = np.array(camera.R_cam_enu).reshape(3, 3)
                rows.append({"camera": camera.id, "from": camera.centre_enu, "to": _towards(sight.rays, rotation)})
        return rows

    def _camera_rows(self) -> list[dict[str, Any]]:
        known = {} if self._network is None else {camera.id: camera for camera in self._network.cameras}
        rows = []
        for camera in [] if self.status is None else self.status.cameras:
            calibrated = known.get(camera.id)
            place = calibrated.centre_enu if calibrated is not None else camera.centre_enu
            level = "fail" if not camera.online else "warn" if camera.suspect or camera.muted else "ok"
            row: dict[str, Any] = {
                "id": camera.id,
                "level": level,
                "at": place,
                "reason": camera.suspect or camera.reason,
            }
            if calibrated is not None:
                row["corners"] = corners(calibrated)
            rows.append(row)
        return rows


def target_rows(message: Targets, origin: Origin) -> list[dict[str, Any]]:
    """Targets in ENU metres, with the upper triangle of the position's covariance (ee, en, eu, nn, nu, uu)."""
    if not message.targets:
        return []
    to_enu = R_ecef_enu(origin).T
    places = ecef_to_enu(np.array([target.ecef_m for target in message.targets]), origin)
    rows = []
    for target, place in zip(message.targets, places, strict=True):
        covariance = np.zeros((6, 6))
        covariance[np.triu_indices(6)] = target.covariance
        position = covariance[:3, :3] + np.triu(covariance[:3, :3], 1).T
        spread = to_enu @ position @ to_enu.T
        rows.append(
            {
                "id": target.track,
                "state": target.state,
                "at": np.round(place, 2).tolist(),
                "velocity": np.round(to_enu @ np.array(target.velocity_m_s), 2).tolist(),
                "spread": [float(f"{v:.4g}") for v in spread[np.triu_indices(3)]],
                "cameras": target.cameras,
                "age_s": target.age_s,
                "verified": target.verified,
            }
        )
    return rows


def corners(camera: NetworkCamera) -> list[list[float]]:
    """Unit vectors (ENU) to the four corners of a camera's image; fewer where its lens model ends before them."""
    lens = LensModel.of(camera.lens)
    right, bottom = lens.size_px[0] - 1.0, lens.size_px[1] - 1.0
    rays = pixel_to_ray(lens, np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]]))
    rays = rays[np.all(np.isfinite(rays), axis=1)]
    return _towards(rays, np.array(camera.R_cam_enu).reshape(3, 3))


def _sight(message: Tracks, now_s: float) -> Sight:
    rays = np.array([[d.ray_x, d.ray_y] for d in message.detections], float).reshape(-1, 2)
    seen = [
        [round(v, 1) for v in (d.u_px, d.v_px, d.width_px, d.height_px)]
        + [float(d.track), float(d.status == "confirmed")]
        for d in message.detections
    ]
    return Sight(now_s, message.size_px, rays, seen)


def _towards(rays: Array, R_cam_enu: Array) -> list[list[float]]:
    directions = np.column_stack([rays, np.ones(len(rays))]) @ R_cam_enu
    unit: list[list[float]] = np.round(directions / np.linalg.norm(directions, axis=1, keepdims=True), 5).tolist()
    return unit

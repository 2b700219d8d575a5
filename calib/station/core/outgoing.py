"""Targets as they leave the station: out of the site's local frame, into the Earth's, checked once more.

The hazard is a wrong aircraft on somebody's map. What leaves here is finite, has a covariance that is one, lies where
an object near this site can be, and is not more uncertain than useful; anything else is dropped and counted. While rays
contradict each other and nobody knows yet which camera is wrong, every position is as uncertain as that could make it.
Whether one is too uncertain is judged within the site; what leaves it is also as uncertain as the site's place on the
Earth, where nobody said which reference frame its positions are in.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.geodesy import Origin, R_ecef_enu, enu_to_ecef
from calib.network import Camera
from calib.reference_frame import ReferenceFrame
from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.targets import MISLED
from edge.common.arrays import Array
from edge.messages import Target

UPPER: Final = np.triu_indices(6)
VERIFYING_CAMERAS: Final = 3  # two rays cross somewhere whatever one of them is; a third one has to meet them
FARTHEST_M: Final = 100_000.0  # from the site's origin: nothing optical sees farther


@dataclass(frozen=True)
class OutgoingTarget:
    """A target in ECEF metres; covariance (6, 6) in ECEF axes; sigma_m: its largest one sigma of position."""

    track: int
    state: TargetState
    t_unix_ns: int
    ecef_m: Array
    position_enu: Array
    velocity_ecef_m_s: Array
    velocity_enu: Array
    covariance: Array
    position_covariance_enu: Array
    cameras: tuple[str, ...]
    camera_mask: int
    age_s: float
    quality: float
    sigma_m: float
    degraded: bool
    verified: bool  # three cameras or more agree, of a site whose claims others check: no single one decides

    def message(self) -> Target:
        """As it goes out over Zenoh."""
        x, y, z = self.ecef_m.tolist()
        vx, vy, vz = self.velocity_ecef_m_s.tolist()
        return Target(
            track=self.track,
            state=self.state.value,
            ecef_m=(x, y, z),
            velocity_m_s=(vx, vy, vz),
            covariance=self.covariance[UPPER].tolist(),
            cameras=list(self.cameras),
            age_s=self.age_s,
            verified=self.verified,
        )


class TargetExport:
    """Estimates of the site's frame as targets in WGS 84. Cached per origin: this runs for every frame."""

    def __init__(self, cameras: Iterable[str], min_cameras: int, max_sigma_m: float) -> None:
        self._bit = {camera: 1 << k if k < 32 else 0 for k, camera in enumerate(cameras)}
        self._min_cameras, self._max_sigma_m = min_cameras, max_sigma_m
        self._doubted_enu, self._doubt_rad = np.zeros(3), 0.0
        self._frame_m = 0.0
        self._origin: Origin | None = None
        self._R = np.eye(3)
        self._origin_ecef = np.zeros(3)
        self.refused = 0

    def _move_to(self, origin: Origin) -> None:
        if origin != self._origin:
            self._origin, self._R = origin, R_ecef_enu(origin)
            self._origin_ecef = enu_to_ecef(np.zeros((1, 3)), origin)[0]

    def doubt(self, camera: Camera | None, miss_rad: float) -> None:
        """From now on rays may be off by miss_rad, those of that camera if anyone's; None: nothing is doubted."""
        self._doubt_rad = 0.0 if camera is None else miss_rad
        if camera is not None:
            self._doubted_enu = camera.centre_enu

    def placed_in(self, frame: ReferenceFrame) -> None:
        """From now on the site's positions are in this frame: what is sent may all be off by its sigma, alike."""
        self._frame_m = frame.sigma_m

    def _covariance(self, e: TargetEstimate) -> Array:
        """With what is doubted now. It is not the filter's: it goes as it came."""
        if not self._doubt_rad or not np.isfinite(e.position_enu).all():
            return e.covariance
        doubt_m = MISLED * self._doubt_rad * float(np.linalg.norm(e.position_enu - self._doubted_enu))
        return e.covariance + np.diag([doubt_m**2] * 3 + [0.0] * 3)

    def to_wgs84(self, estimates: Iterable[TargetEstimate], origin: Origin) -> list[OutgoingTarget]:
        """The estimates that may be sent, as they are sent."""
        self._move_to(origin)
        checked = [self._one(estimate) for estimate in estimates]
        self.refused += sum(target is None for target in checked)
        return [target for target in checked if target is not None]

    def _one(self, e: TargetEstimate) -> OutgoingTarget | None:
        R, P = self._R, self._covariance(e)
        sane = np.isfinite(P).all() and np.isfinite(e.position_enu).all() and np.isfinite(e.velocity_enu).all()
        if not sane or np.abs(e.position_enu).max() > FARTHEST_M:
            return None
        spread = np.linalg.eigvalsh(P)
        sigma_m = float(np.sqrt(max(np.linalg.eigvalsh(P[:3, :3])[-1], 0.0)))
        if spread[0] < -1e-9 * spread[-1] or (sigma_m > self._max_sigma_m and e.state is not TargetState.LOST):
            return None
        P = P + np.diag([self._frame_m**2] * 3 + [0.0] * 3)
        turned = np.empty((6, 6))
        turned[:3, :3], turned[:3, 3:] = R @ P[:3, :3] @ R.T, R @ P[:3, 3:] @ R.T
        turned[3:, :3], turned[3:, 3:] = turned[:3, 3:].T, R @ P[3:, 3:] @ R.T
        return OutgoingTarget(
            track=e.track,
            state=e.state,
            t_unix_ns=e.t_unix_ns,
            ecef_m=self._origin_ecef + R @ e.position_enu,
            position_enu=e.position_enu,
            velocity_ecef_m_s=R @ e.velocity_enu,
            velocity_enu=e.velocity_enu,
            covariance=turned,
            position_covariance_enu=P[:3, :3],
            cameras=e.cameras,
            camera_mask=sum(self._bit.get(camera, 0) for camera in e.cameras),
            age_s=e.age_s,
            quality=e.quality,
            sigma_m=float(np.hypot(sigma_m, self._frame_m)),
            degraded=self._degraded(e),
            verified=_verified(e),
        )

    def _degraded(self, e: TargetEstimate) -> bool:
        contested = bool(e.denied_by) and e.witnesses < VERIFYING_CAMERAS
        return len(e.cameras) < self._min_cameras or contested or e.state is not TargetState.CONFIRMED


def _verified(e: TargetEstimate) -> bool:
    """Whether no single camera, by what it sees or by what it claims of itself, could have put it elsewhere."""
    return e.witnesses >= VERIFYING_CAMERAS and not e.rests_on and e.state is TargetState.CONFIRMED

"""What the station says of itself: its network as a message, and what changed as sentences.

The hazard is the sentence said too often: an operator who reads the same one twice a minute reads none. So a check is
told when its level changes, and the phase when it does.
"""

import numpy as np

from calib.network import Camera, Network
from calib.station.core.calibration import Standing
from edge.common.arrays import Array
from edge.common.health import HealthLevel
from edge.messages import Health, NetworkCamera, NetworkMessage
from edge.messages import Lens as LensMessage

Origin = tuple[float, float, float]
Sentence = tuple[HealthLevel, str]


def network_message(
    standing: Standing, network: Network | None, site_origin: Origin | None, t_unix_ns: int
) -> NetworkMessage:
    """State, reason, next action, and the network in force. site_origin: of the site, while there is no network."""
    return NetworkMessage(
        t_unix_ns=t_unix_ns,
        state=standing.phase.value,
        reason=standing.reason,
        action=standing.action,
        origin=site_origin if network is None else network.origin,
        cameras=[] if network is None else [_camera_message(network, camera) for camera in network.cameras],
        rms_px=None if network is None else network.rms_px,
    )


def _camera_message(network: Network, camera: Camera) -> NetworkCamera:
    sigma = np.sqrt(np.maximum(np.diag(network.pose_covariance(camera.id)), 0.0))
    a, b, c, d, e, f, g, h, i = camera.R_cam_enu.ravel().tolist()
    return NetworkCamera(
        id=camera.id,
        R_cam_enu=(a, b, c, d, e, f, g, h, i),
        centre_enu=_triple(camera.centre_enu),
        sigma_attitude_rad=_triple(sigma[:3]),
        sigma_centre_m=_triple(sigma[3:]),
        clock_offset_s=camera.clock_offset_s,
        clock_rate=camera.clock_rate,
        readout_s=camera.readout_s,
        lens=LensMessage.of(camera.lens),
    )


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


class News:
    """What an operator was told last."""

    def __init__(self) -> None:
        self._phase = ""
        self._levels: dict[str, str] = {}

    def since(self, health: Health, standing: Standing) -> list[Sentence]:
        """What changed since the last time, what matters most first."""
        sentences: list[Sentence] = []
        for item in health.items:
            if self._levels.get(item.name, "ok") != item.level:
                words = item.reason if item.level != "ok" else "well again"
                sentences.append((item.level, f"{item.name}: {words}"))
        self._levels = {item.name: item.level for item in health.items}
        if standing.phase.value != self._phase:
            sentences.insert(0, ("ok", f"{standing.phase.value}: {standing.reason}"))
        self._phase = standing.phase.value
        return sentences

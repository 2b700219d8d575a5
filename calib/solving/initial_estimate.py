"""The initial estimate that the bundle adjustment starts from: cameras roughly right, by a scaffold or a network.

The hazard of an earlier network is that it may describe a site that has moved since. It is only a start: the
adjustment, its residuals and the cameras' own survey decide what becomes of it.
"""

from dataclasses import dataclass, field, replace

from calib.adjustment.priors import trusted_clocks
from calib.errors import CalibrationError
from calib.geometry.similarity import UNCHANGED
from calib.network import Camera, Network
from calib.solving.bootstrap import to_enu
from calib.solving.clocks import FAR_S, NEAR_S, align_all
from calib.solving.georeference import Georeference, georeference
from calib.solving.identity import Key, identify
from calib.solving.inputs import Inputs
from calib.solving.scaffold import Pose, build, threshold_ray
from calib.solving.strain import Believed


@dataclass(frozen=True)
class InitialEstimate:
    """cameras in their frame; objects: which track shows which; doubts: what of the survey it does not rest on.

    shares: of each camera's rows that its first pose explains. gauge: for a local frame, the two cameras that hold it
    (the first's pose, the direction and length to the second).
    """

    cameras: tuple[Camera, ...]
    objects: dict[Key, int]
    doubts: tuple[Believed, ...] = ()
    gauge: tuple[str, str] | None = None
    shares: dict[str, float] = field(default_factory=dict)


def from_scaffold(inputs: Inputs, *, local: bool, clock_search_s: float = NEAR_S) -> InitialEstimate:
    """Cameras from nothing but tracks and survey. Raises CalibrationError with what is missing."""
    trusted = trusted_clocks(inputs.sites)
    offsets = align_all(inputs.tracks, clock_search_s, trusted)
    if len(offsets) < len(inputs.tracks) and clock_search_s < FAR_S:
        offsets = align_all(inputs.tracks, FAR_S, trusted)
    scaffold = build(inputs.tracks, offsets)
    objects = _objects(inputs, offsets, scaffold.poses)
    frame = Georeference(UNCHANGED) if local else georeference(scaffold, inputs.sites)
    shares = {name: pose.share for name, pose in scaffold.poses.items()}
    cameras = tuple(
        to_enu(scaffold.poses[name], inputs.sites[name], frame.similarity, offsets[name])
        for name in sorted(scaffold.poses)
    )
    return InitialEstimate(cameras, objects, frame.doubts, scaffold.pair if local else None, shares)


def from_network(inputs: Inputs, start: Network) -> InitialEstimate:
    """Cameras as an earlier network has them. Raises CalibrationError if fewer than two are still there."""
    seconds = (inputs.t_mid_unix_ns - start.t_mid_unix_ns) * 1e-9
    cameras = tuple(
        replace(camera, clock_offset_s=camera.clock_offset_s + camera.clock_rate * seconds)
        for camera in start.cameras
        if camera.id in inputs.tracks
    )
    if len(cameras) < 2:
        raise CalibrationError(
            f"{len(cameras)} cameras of the earlier network saw anything", where=start.site, action="calibrate anew"
        )
    poses = {camera.id: Pose(camera.R_cam_enu, camera.centre_enu, 1.0) for camera in cameras}
    return InitialEstimate(cameras, _objects(inputs, {c.id: c.clock_offset_s for c in cameras}, poses))


def _objects(inputs: Inputs, offsets: dict[str, float], poses: dict[str, Pose]) -> dict[Key, int]:
    threshold = threshold_ray([inputs.tracks[name] for name in poses])
    return identify(inputs.tracks, offsets, poses, threshold)

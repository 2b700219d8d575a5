"""The initial estimate that the bundle adjustment starts from: cameras roughly right, by a scaffold or a network.

The hazard of an earlier network is that it may describe a site that has moved since. It is only a start: the
adjustment, its residuals and the cameras' own survey decide what becomes of it.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from calib.errors import CalibrationError
from calib.geometry.similarity import UNCHANGED
from calib.network import Camera, Network
from calib.solving.bootstrap import to_enu
from calib.solving.clock_consensus import Clock
from calib.solving.georeference import Georeference, georeference
from calib.solving.identity import Key, identify
from calib.solving.inputs import Inputs
from calib.solving.reasons import refuse_alone, refuse_bent, too_few_poses
from calib.solving.scaffold import Pose, Scaffold, build, threshold_ray
from calib.solving.series import TrackSeries
from calib.solving.strain import Believed


@dataclass(frozen=True)
class InitialEstimate:
    """cameras in their frame; objects: which track shows which, of `tracks`, which are cut where they change their
    object; doubts: what of the survey it does not rest on.

    shares: of each camera's rows that its first pose explains. gauge: for a local frame, the two cameras that hold it
    (the first's pose, the direction and length to the second).
    """

    cameras: tuple[Camera, ...]
    objects: dict[Key, int]
    doubts: tuple[Believed, ...] = ()
    gauge: tuple[str, str] | None = None
    shares: dict[str, float] = field(default_factory=dict)
    tracks: dict[str, list[TrackSeries]] = field(default_factory=dict)


def from_scaffold(inputs: Inputs, clocks: dict[str, Clock], *, local: bool) -> InitialEstimate:
    """Cameras from nothing but tracks and survey. clocks: of the cameras that are to take part.

    Raises CalibrationError with what is missing.
    """
    tracks, offsets = at_pace(inputs.tracks, clocks), {name: clock.offset_s for name, clock in clocks.items()}
    refuse_alone(inputs, tracks)
    scaffold = build(tracks, offsets)
    refuse_bent(inputs, tracks, offsets, scaffold)
    objects, cut = _objects(inputs.tracks, clocks, scaffold.poses)
    frame = Georeference(UNCHANGED) if local else _georeferenced(inputs, tracks, offsets, scaffold)
    shares = {name: pose.share for name, pose in scaffold.poses.items()}
    cameras = tuple(
        replace(
            to_enu(scaffold.poses[name], inputs.sites[name], frame.similarity, offsets[name]),
            clock_rate=clocks[name].rate,
        )
        for name in sorted(scaffold.poses)
    )
    gauge = scaffold.pair if local else None
    return InitialEstimate(cameras, objects, frame.doubts, gauge, shares, cut)


def at_pace(tracks: dict[str, list[TrackSeries]], clocks: dict[str, Clock]) -> dict[str, list[TrackSeries]]:
    """The tracks with the rates of their cameras' clocks taken out; their offsets stay in."""
    return {
        name: [track.stretched(clocks[name].rate) for track in own] for name, own in tracks.items() if name in clocks
    }


def _georeferenced(
    inputs: Inputs, tracks: dict[str, list[TrackSeries]], offsets: dict[str, float], scaffold: Scaffold
) -> Georeference:
    """Raises CalibrationError, with why cameras have no pose if it is for want of them."""
    try:
        return georeference(scaffold, inputs.sites)
    except CalibrationError as refusal:
        reason = too_few_poses(inputs, tracks, offsets, scaffold)
        if reason is None:
            raise
        raise reason from refusal


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
    return begun(inputs, cameras, {camera.id: Clock(camera.clock_offset_s, camera.clock_rate) for camera in cameras})


def begun(inputs: Inputs, cameras: tuple[Camera, ...], clocks: dict[str, Clock]) -> InitialEstimate:
    """The estimate that cameras in ENU begin with. clocks: theirs."""
    poses = {camera.id: Pose(camera.R_cam_enu, camera.centre_enu, 1.0) for camera in cameras}
    objects, cut = _objects(inputs.tracks, clocks, poses)
    return InitialEstimate(cameras, objects, tracks=cut)


def _objects(
    tracks: dict[str, list[TrackSeries]], clocks: dict[str, Clock], poses: dict[str, Pose]
) -> tuple[dict[Key, int], dict[str, list[TrackSeries]]]:
    """Which track shows which object, and all tracks, cut where they change it, by the stamps as they came."""
    seen, offsets = at_pace(tracks, clocks), {name: clock.offset_s for name, clock in clocks.items()}
    found = identify(seen, offsets, poses, threshold_ray([seen[name] for name in poses]))
    stamped = {name: _as_stamped(own, tracks[name]) for name, own in found.tracks.items()}
    return found.objects, {**tracks, **stamped}


def _as_stamped(own: list[TrackSeries], whole: list[TrackSeries]) -> list[TrackSeries]:
    """Pieces of tracks with the times of the whole ones."""
    t_s = np.full(max(int(track.row.max()) for track in whole) + 1, np.nan)
    for track in whole:
        t_s[track.row] = track.t_s
    return [replace(track, t_s=t_s[track.row]) for track in own]

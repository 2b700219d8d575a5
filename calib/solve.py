"""The four steps, one call: scaffold, resect, georeference, refine.

The hazard is a calibration that fails without saying why, or worse, one camera that spoils all others and is not
named. Each step here may refuse with a reason and a next action; a camera that does not fit is left out, named, and
tried again once the others are refined, because a lens or a clock that is off by two per cent looks hopeless before.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calib.bootstrap import Georeference, first_estimate, georeference, to_enu
from calib.bundle import Adjusted, Problem, adjust
from calib.clocks import FAR_S, NEAR_S, align_all
from calib.errors import CalibrationError
from calib.evidence import gather
from calib.flight import Estimate
from calib.identity import Key, identify
from calib.network import Camera, Network
from calib.observations import Scene, SiteCamera
from calib.priors import camera_priors
from calib.projection import CameraData
from calib.rejoin import rejoin
from calib.scaffold import Pose, Scaffold, build, threshold_ray
from calib.series import Track, split_tracks
from calib.solution import (
    Report,
    Solution,
    camera_covariance,
    camera_reports,
    network_of,
    rms_px,
    trajectory_of,
    weakest,
)
from calib.weights import Weights

COARSE_KNOTS_S: Final = 0.5  # a UAV's acceleration changes in half a second; finer knots come where the pixels ask
FIRST_SIGMA_RAY: Final = 0.005  # what the first estimate is good for, in ray units
FEWEST_INLIERS: Final = 0.5  # share of a camera's rows within the noise, below which it does not belong
FEWEST_ROWS: Final = 30  # of a camera: below it there is nothing to align


@dataclass(frozen=True)
class SolveOptions:
    """How to solve. local: no survey, a frame of its own with the scaffold's baseline as unit. clock_search_s: how far
    clocks may be off; a camera that aligns nowhere within it is searched for within two minutes. evidence: gather what
    the report shows besides, which costs about as much as solving.
    """

    local: bool = False
    evidence: bool = False
    clock_search_s: float = NEAR_S
    knots_s: float = COARSE_KNOTS_S


def solve(scene: Scene, options: SolveOptions = SolveOptions(), start: Network | None = None) -> Solution:
    """Calibrate a scene.

    start: a network to begin with, instead of a scaffold. Raises CalibrationError, with what to do, if the
    observations or the survey do not determine the network.
    """
    work = _Work.of(scene, options)
    cameras, frame = work.from_network(start) if start else work.from_scaffold()
    adjusted, problem = work.refine(cameras, frame)
    while True:
        back = rejoin(adjusted.estimate, work.tracks, work.sites, work.objects)
        if not back:
            break
        joined = tuple(sorted((*adjusted.estimate.cameras, *back), key=lambda camera: camera.id))
        adjusted, problem = work.refine(joined, frame)
        if len(adjusted.estimate.cameras) < len(joined):
            break
    return work.answer(adjusted, problem, frame)


@dataclass
class _Work:
    """What one solve knows and finds out as it goes."""

    scene: Scene
    options: SolveOptions
    t_mid_unix_ns: int
    sites: dict[str, SiteCamera]
    tracks: dict[str, list[Track]]
    objects: dict[Key, int]
    left_out: dict[str, str]

    @classmethod
    def of(cls, scene: Scene, options: SolveOptions) -> "_Work":
        sites = {camera.id: camera for camera in scene.cameras}
        usable = {name: seen for name, seen in scene.observations.items() if len(seen) >= FEWEST_ROWS and name in sites}
        left_out = dict.fromkeys(sorted(set(sites) - set(usable)), "it saw next to nothing")
        if len(usable) < 2:
            raise CalibrationError(
                f"only {len(usable)} cameras saw anything", where=scene.site, action="check that the detectors run"
            )
        ends = [(int(seen.t_unix_ns[0]), int(seen.t_unix_ns[-1])) for seen in usable.values()]
        t_mid = (int(np.median([e[0] for e in ends])) + int(np.median([e[1] for e in ends]))) // 2
        tracks = {name: split_tracks(seen, sites[name].lens, t_mid) for name, seen in sorted(usable.items())}
        for name in [name for name, own in tracks.items() if not own]:
            left_out[name] = "it has no track of ten rows within its lens model: check its lens file and resolution"
            del tracks[name]
        return cls(scene, options, t_mid, sites, tracks, {}, left_out)

    def from_scaffold(self) -> tuple[tuple[Camera, ...], Georeference]:
        """Cameras in ENU from nothing but tracks and survey."""
        offsets = align_all(self.tracks, self.options.clock_search_s)
        if len(offsets) < len(self.tracks) and self.options.clock_search_s < FAR_S:
            offsets = align_all(self.tracks, FAR_S)
        scaffold = build(self.tracks, offsets)
        poses = self._without_unlikely(scaffold)
        self.objects = identify(self.tracks, offsets, poses, threshold_ray([self.tracks[name] for name in poses]))
        frame = self._frame(poses)
        cameras = tuple(
            to_enu(poses[name], self.sites[name], frame.similarity, offsets[name]) for name in sorted(poses)
        )
        return cameras, frame

    def _without_unlikely(self, scaffold: Scaffold) -> dict[str, Pose]:
        return dict(scaffold.poses)

    def _frame(self, poses: dict[str, Pose]) -> Georeference:
        return georeference(poses, self.sites)

    def from_network(self, start: Network) -> tuple[tuple[Camera, ...], Georeference]:
        """Cameras as an earlier network has them."""
        known = tuple(camera for camera in start.cameras if camera.id in self.tracks)
        seconds = (self.t_mid_unix_ns - start.t_mid_unix_ns) * 1e-9
        cameras = tuple(replace(c, clock_offset_s=c.clock_offset_s + c.clock_rate * seconds) for c in known)
        offsets = {camera.id: camera.clock_offset_s for camera in cameras}
        poses = {camera.id: Pose(camera.R_cam_enu, camera.centre_enu, 1.0) for camera in cameras}
        self.objects = identify(self.tracks, offsets, poses, threshold_ray([self.tracks[name] for name in poses]))
        return cameras, self._frame(poses)

    def refine(self, cameras: tuple[Camera, ...], frame: Georeference) -> tuple[Adjusted, Problem]:
        """Adjust; cameras whose rows the result does not explain are left out and the rest adjusted again."""
        while True:
            estimate, data = first_estimate(
                self.scene,
                cameras,
                self.tracks,
                self.objects,
                t_mid=self.t_mid_unix_ns,
                spacing_s=self.options.knots_s,
            )
            problem = Problem(data, camera_priors(cameras, self.sites, frame.disbelieved))
            adjusted = adjust(problem, estimate, self._first_weights(estimate, data))
            return adjusted, problem

    def _first_weights(self, estimate: Estimate, data: tuple[CameraData, ...]) -> Weights:
        hops = np.linalg.norm(np.diff(estimate.control, axis=0), axis=1)
        speed = float(np.median(hops)) / estimate.flight.spacing_s
        sigma = np.array([FIRST_SIGMA_RAY * camera.lens.intrinsics[0] for camera in estimate.cameras])
        interval = np.array([np.median(np.diff(seen.t_s)) for seen in data])
        return Weights(sigma, interval, 0.0, max(speed, 1e-3) ** 2)

    def answer(self, adjusted: Adjusted, problem: Problem, frame: Georeference) -> Solution:
        """Network, trajectory and report."""
        network = network_of(adjusted, problem, self.scene.site, self.scene.origin, self.t_mid_unix_ns)
        trajectory = trajectory_of(adjusted, problem, self.t_mid_unix_ns)
        return Solution(network, trajectory, self._report(adjusted, problem, frame))

    def _report(self, adjusted: Adjusted, problem: Problem, frame: Georeference) -> Report:
        surveyed = {name: site.position_enu for name, site in self.sites.items() if site.position_enu is not None}
        cameras = camera_reports(adjusted, problem, surveyed, {name: site.lens for name, site in self.sites.items()})
        misfits = np.array([c.survey_misfit_m for c in cameras if c.survey_misfit_m and c.id not in frame.disbelieved])
        present = {camera.id for camera in cameras}
        left_out = {name: why for name, why in self.left_out.items() if name not in present}
        for name in sorted(set(self.tracks) - present - set(left_out)):
            left_out[name] = "no pose explains its track: check its clock, its lens file and what it detects"
        name, sigma, direction = weakest(adjusted, problem)
        return Report(
            cameras=cameras,
            left_out=tuple(sorted(left_out.items())),
            findings=frame.findings,
            rms_px=rms_px(adjusted, problem),
            survey_rms_m=float(np.sqrt((misfits**2).sum(1).mean())) if len(misfits) else None,
            rounds=adjusted.rounds,
            flight_s=float((adjusted.estimate.flight.end_s - adjusted.estimate.flight.start_s).sum()),
            jerk_density=adjusted.weights.jerk_density,
            weakest_camera=name,
            weakest_sigma_m=sigma,
            weakest_direction_enu=direction,
            evidence=gather(adjusted, problem, camera_covariance(adjusted, problem)) if self.options.evidence else None,
        )

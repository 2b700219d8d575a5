"""Multiple-target tracking from rays: which detection is which object, and where each is, with a true covariance.

A measurement is one camera's pixel at that pixel's own exposure time: nothing is interpolated and no two cameras need
fire together. The hazards are two. A target that is not there: so new tracks stay tentative until two cameras have seen
them for a while and no camera that should see them denies them. And a target that is not where it is reported to be: so
a target nobody has seen for a while coasts, with a covariance that grows, and is then deleted, once and for all.

Time here is site time: seconds since the network's own epoch. The caller says what "now" is.
"""

from collections import Counter, deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.network import Network, pose_of
from calib.observations import Frame
from calib.sighting import CameraView, Sighting
from calib.tracking.association import MISSED, Pairing, PossiblePairs, pair
from calib.tracking.common_now import CommonNow
from calib.tracking.denials import Denials
from calib.tracking.estimates import TargetEstimate
from calib.tracking.filterbank import FilterBank, Look, PredictedStates, Rays
from calib.tracking.initiation import initiate
from calib.tracking.lone import LoneTargets
from calib.tracking.numbering import PictureNumbers
from calib.tracking.options import TrackerOptions
from calib.tracking.pixel_errors import Looks, PixelErrors
from calib.tracking.pixelbias import with_bias
from calib.tracking.reports import NotUsed, TargetReports, spread
from calib.tracking.searches import SEARCHES, STRAIGHT
from calib.tracking.track_scores import AssociationEvidence, TrackScores
from calib.tracking.tracklets import LooseRay, NewTrack, could_be, tracklets
from calib.tracking.twins import twins
from edge.common.arrays import Array

SCAN_S: Final = 0.1  # s between searches for new tracks
LOOSE_RAYS: Final = 4000  # kept at most; a detector in flood must not slow the loop
HALF_OUTSIDE_PX: Final = 12.0  # a target so near the image's edge may be half outside: not seeing it proves nothing
TENTATIVE_S: Final = 1.5  # s a tentative target may go unseen
TOO_FAST: Final = 1.5  # times the greatest speed: a target that was believed is given more than a new one
SIGMA_OF_RANGE: Final = 0.3  # of its range that a target's sigma may be: beyond, a filter about its guess is none
LEARNT_PX: Final = 0.2  # px: a lasting error that changed by less goes on counting as before
LEARNT: Final = 0.2  # of itself: likewise
SUREST_PX: Final = 0.02  # px: no detector is surer of an object's middle, whatever it says
MISLED: Final = 2.0  # times what one camera's ray is off, a target may be: two rays that cross at 30 degrees


@dataclass(frozen=True)
class _Scan:
    """One frame of camera `number`: how it should see each target (N,), its rays and their labels (K,), when."""

    number: int
    sighting: Sighting
    rays: Rays
    label: NDArray[np.int64]
    t_s: float


class Tracker:
    """All targets of a site. `observe` what comes, `advance` to now, read `estimates`; `exchange` the network."""

    def __init__(self, network: Network, options: TrackerOptions | None = None, first_track: int = 1) -> None:
        self._options = options or TrackerOptions()
        self._bank = FilterBank(with_bias(network), self._options.motion)
        self._scores = TrackScores(len(network.cameras))
        self._errors = PixelErrors(len(network.cameras))
        self._denials = Denials(network.cameras)
        self._loose: deque[LooseRay] = deque(maxlen=LOOSE_RAYS)
        self._next_track = first_track
        self._common = CommonNow()
        self._lone = LoneTargets()
        self._numbering: dict[str, PictureNumbers] = {}
        self._lasting_px = np.zeros(len(network.cameras))
        self._reports = TargetReports(self._bank, self._scores, self._options, self._denials, self._common)
        self._farewells: list[TargetEstimate] = []
        self._late_s: dict[str, float] = {}
        self._newest_s = -np.inf
        self._scanned_s = -np.inf
        self.counters: Counter[str] = Counter()
        self._adopt(network)

    def _adopt(self, network: Network) -> None:
        self._network = network
        self._told = with_bias(network)
        self._views = [CameraView.of(camera) for camera in network.cameras]
        # By name, for they outlast a network: targets are held by the numbers of objects in a camera's picture.
        for camera in network.cameras:
            self._numbering.setdefault(camera.id, PictureNumbers(min(camera.lens.intrinsics[:2])))
        self._number = {camera.id: k for k, camera in enumerate(network.cameras)}

    @property
    def network(self) -> Network:
        """The network in force."""
        return self._network

    @property
    def newest_s(self) -> float:
        """Site time of the newest frame that counted; -inf before the first."""
        return self._newest_s

    @property
    def next_track(self) -> int:
        """The number the next target will get: to be kept across a restart."""
        return self._next_track

    def site_time_s(self, t_unix_ns: int) -> float:
        """Site time of an instant of UTC."""
        return self.network.since_mid_s(t_unix_ns)

    def exchange(self, network: Network) -> None:
        """Go on with another network, without a jump."""
        shift_s = (self.network.t_mid_unix_ns - network.t_mid_unix_ns) * 1e-9
        kept = [self._number.get(camera.id, -1) for camera in network.cameras]
        self._errors.exchange(kept)
        self._lasting_px = self._errors.lasting_px
        self._bank.exchange(with_bias(network, self._lasting_px))
        self._scores.exchange(kept, shift_s)
        self._denials.exchange(network.cameras, kept, shift_s)
        self._common.shift(shift_s)
        self._lone.shift(shift_s)
        for numbers in self._numbering.values():
            numbers.shift(shift_s)
        self._newest_s += shift_s
        self._scanned_s += shift_s
        self._loose.clear()
        self._adopt(network)

    def observe(self, frame: Frame) -> list[int]:
        """Take one frame; returns the numbers of the targets that it moved, or that waited for it to be moved."""
        number = self._number.get(frame.camera)
        if number is None:
            self.counters["uncalibrated"] += 1
            return []
        t_s, rows_s = self._exposed_s(number, frame)
        self._common.note(frame.camera, t_s)
        now_s, horizon_s = self._common.now_s, self._options.reorder_horizon_s
        # What waited is older than what comes now, and the numbers of a picture's objects go on from frame to frame.
        moved = [track for held in self._common.due(now_s) for track in self._take_held(held)]
        if t_s < now_s - horizon_s:
            self.counters["late"] += 1
            self._late_s[frame.camera] = max(now_s - t_s, self._late_s.get(frame.camera, 0.0))
        elif t_s > now_s + horizon_s:
            self.counters["early"] += 1
            self.counters["overflown"] += not self._common.hold(frame, t_s)
        else:
            moved += self._take(number, frame, t_s, rows_s)
        return moved

    def _exposed_s(self, number: int, frame: Frame) -> tuple[float, Array]:
        """Site times of a frame's middle row, and (K,) of its detections' rows."""
        camera = self.network.cameras[number]
        rows_s = camera.site_time_s(
            np.full(len(frame.pixels) + 1, frame.t_unix_ns),
            np.append(frame.pixels[:, 1], (camera.lens.size_px[1] - 1) / 2),
            self.network.t_mid_unix_ns,
        )
        return float(rows_s[-1]), rows_s[:-1]

    def _take_held(self, frame: Frame) -> list[int]:
        """A frame whose time has come; its camera may have been taken out meanwhile.

        Several seconds of frames may come due at once: targets are looked after in between, as if they had not waited.
        """
        number = self._number.get(frame.camera)
        if number is None:
            return []
        moved = self._take(number, frame, *self._exposed_s(number, frame))
        self._farewells += self._scan(self._newest_s)
        return moved

    def _take(self, number: int, frame: Frame, t_s: float, rows_s: Array) -> list[int]:
        self._newest_s = max(self._newest_s, t_s)
        sigma_px = np.maximum(frame.sigma_px, SUREST_PX) * np.sqrt(self._errors.white[number])
        rays = Rays(frame.pixels, rows_s - t_s, sigma_px)
        label = self._numbering[frame.camera].number(frame.label, frame.pixels, frame.sigma_px, t_s)
        self._lone.note(frame.camera, label, t_s)
        taken, moved = self._associate(number, label, rays, t_s)
        for k in np.nonzero(~taken)[0]:
            u, v = frame.pixels[k]
            self._loose.append(
                LooseRay(number, int(label[k]), float(rows_s[k]), float(u), float(v), float(sigma_px[k]))
            )
        return moved

    def _associate(
        self, number: int, label: NDArray[np.int64], rays: Rays, t_s: float
    ) -> tuple[NDArray[np.bool_], list[int]]:
        taken = np.zeros(len(rays.pixels), bool)
        if not len(self._bank):
            return taken, []
        self._bank.watch(self._scores.watching(t_s))
        prediction = self._bank.predict(t_s)
        scan = _Scan(number, self._views[number].sight(prediction.state[:, :3]), rays, label, t_s)
        same = self._scores.holds(number, label)
        pairing = self._pair(scan, prediction, scan.sighting.valid[:, None], same)
        self._hit(scan, prediction, pairing)
        taken[pairing.detection] = True
        missed = scan.sighting.valid & self._views[number].inside(scan.sighting.pixels, HALF_OUTSIDE_PX)
        missed[pairing.which] = False
        again = self._follow_turns(scan, prediction, same & missed[:, None] & ~taken[None])
        taken[again.detection] = True
        missed[again.which] = False
        self._miss(scan, np.nonzero(missed)[0])
        return taken, [self._scores.track[k] for k in (*pairing.which, *again.which)]

    def _pair(
        self, scan: "_Scan", prediction: PredictedStates, possible: NDArray[np.bool_], same: NDArray[np.bool_]
    ) -> Pairing:
        expected = self._bank.expect(prediction, scan.sighting, scan.number)
        size_px = self.network.cameras[scan.number].lens.size_px
        return pair(expected, scan.rays, size_px, PossiblePairs(possible, same, self._scores.confirmed))

    def _hit(self, scan: "_Scan", prediction: PredictedStates, pairing: Pairing) -> None:
        if not len(pairing):
            return
        which, detection = pairing.which, pairing.detection
        look = Look(scan.number, self._views[scan.number], scan.sighting.chosen(which), scan.rays.chosen(detection))
        innovation_px, mahalanobis2 = self._bank.update(prediction, which, look)
        self._learn(scan, pairing, innovation_px)
        evidence = AssociationEvidence(scan.label[detection], pairing.gain - mahalanobis2 / 2, mahalanobis2)
        self._scores.hit(scan.number, which, scan.t_s, evidence)

    def _miss(self, scan: "_Scan", which: NDArray[np.intp]) -> None:
        self._scores.miss(scan.number, which, MISSED)
        size_px = self.network.cameras[scan.number].lens.size_px
        self._denials.miss(scan.number, which, scan.sighting.pixels[which], size_px, scan.t_s)

    def _learn(self, scan: "_Scan", pairing: Pairing, innovation_px: Array) -> None:
        """How wrong this camera's pixels are, by targets that are believed."""
        sure = self._scores.confirmed[pairing.which]
        which, detection = pairing.which[sure], pairing.detection[sure]
        if not len(which):
            return
        size_px = self.network.cameras[scan.number].lens.size_px
        self._denials.hit(scan.number, which, scan.rays.pixels[detection], size_px, scan.t_s)
        by_pose, at = scan.sighting.by_pose[which], pose_of(scan.number)
        by_pose_px2 = np.einsum("kij,jl,kil->k", by_pose, self._told.covariance[at, at], by_pose) / 2
        claimed_px2 = scan.rays.sigma_px[detection] ** 2 / self._errors.white[scan.number]
        watching = self._scores.watching(scan.t_s)[which]
        looks = Looks(scan.rays.pixels[detection], innovation_px[sure], claimed_px2, by_pose_px2, watching)
        self._errors.learn(scan.number, which, scan.t_s, looks)

    def _follow_turns(self, scan: "_Scan", prediction: PredictedStates, held: NDArray[np.bool_]) -> Pairing:
        """A target that its camera missed, and a detection outside its gate that bears its number: it has turned.

        held: (N, K) what targets and detections that may be so.
        """
        possible = held & self._scores.followed(scan.t_s)[:, None]
        which = np.nonzero(possible.any(axis=1))[0]
        if len(which):
            which = which[self._scores.astray(scan.number, which, scan.t_s)]
            possible &= np.isin(np.arange(len(possible)), which)[:, None]
        turning = self._bank.turning(prediction, which) if len(which) else prediction
        pairing = self._pair(scan, turning, possible, possible)
        self._hit(scan, turning, pairing)
        self._bank.alarm(pairing.which)
        self.counters["turned"] += len(pairing)
        return pairing

    def advance(self, now_s: float) -> list[TargetEstimate]:
        """Let time pass: track initiation, confirmation, deletion. Returns the final estimates of targets lost now."""
        lost, self._farewells = self._farewells + self._scan(now_s), []
        return lost

    def _scan(self, now_s: float) -> list[TargetEstimate]:
        if now_s - self._scanned_s < SCAN_S:
            return []
        self._scanned_s = now_s
        self._initiate_tracks(min(now_s, self._common.now_s))
        for k in self._scores.confirm():
            self._continue_lone(k)
        self._denials.weigh(self._bank.state[:, :3], self._scores.watched_by(now_s), now_s)
        self._scores.hold_back_unseen(now_s)
        self._allow_for_what_stays()
        return self._delete_tracks(now_s)

    def _allow_for_what_stays(self) -> None:
        """Filter with what was learnt of cameras' lasting errors, when it has changed by more than a little."""
        learnt_px = self._errors.lasting_px
        if (np.abs(learnt_px - self._lasting_px) > LEARNT_PX + LEARNT * self._lasting_px).any():
            self._lasting_px = learnt_px
            self._bank.exchange(with_bias(self._network, learnt_px))

    def _initiate_tracks(self, now_s: float) -> None:
        """Search up to what two cameras have come to: the newest of a fast one has no company yet."""
        self._loose = deque((ray for ray in self._loose if ray.t_s >= now_s - STRAIGHT.span_s), maxlen=LOOSE_RAYS)
        for search in SEARCHES:
            if len(self._loose) < 2:
                return
            found = tracklets(self._loose, self._bank.network, search, now_s)
            initiated = initiate(found, self._bank.network, self._options, search, now_s)
            for new in initiated:
                self._add(new)
            used = {member for new in initiated for member in new.seen_by}
            if used:
                self._loose = deque((r for r in self._loose if (r.camera, r.label) not in used), maxlen=LOOSE_RAYS)

    def _add(self, new: NewTrack) -> None:
        self._bank.add(new.state, new.covariance, new.with_poses, new.t_s)
        self._scores.add(self._next_track, new.t_s, new.seen_by)
        self._errors.add()
        self._denials.add()
        self._next_track += 1
        self.counters["born"] += 1

    def _continue_lone(self, k: int) -> None:
        """A target that is believed now may be one that a camera never lost from sight: it gets that one's number."""
        seen = {(self.network.cameras[c].id, int(self._scores.label[k, c])) for c in self._scores.seen_by(k)}
        heir = self._lone.heir(seen)
        if heir is not None:
            self._scores.track[k] = heir

    def _delete_tracks(self, now_s: float) -> list[TargetEstimate]:
        silent_s = now_s - self._scores.last_s
        confirmed = self._scores.confirmed
        deleted = silent_s > np.where(confirmed, self._options.coast_s, TENTATIVE_S)
        deleted |= self._scores.denied | self._too_fast() | twins(self._bank, self._scores)
        outvoted = confirmed & self._denials.outvoted(self._scores.watched_by(now_s))
        self.counters["outvoted"] += int(np.count_nonzero(outvoted & ~deleted))
        deleted |= outvoted
        sigma_m, range_m = spread(self._bank.state, self._bank.covariance, self.network.centres_enu)
        alone = confirmed & ~deleted & (sigma_m > self._options.most_sigma_m(range_m))
        alone &= self._scores.watching(now_s) == 1
        for k in np.nonzero(alone)[0].tolist():
            self._leave_alone(k, now_s)
        ended = self._end(deleted | alone | (sigma_m > SIGMA_OF_RANGE * range_m), now_s)
        return ended + self._lone.end(now_s - self._options.coast_s)

    def _too_fast(self) -> NDArray[np.bool_]:
        limit_m_s = TOO_FAST * self._options.limits.max_speed_m_s
        states = zip(self._bank.state, self._bank.covariance, strict=True)
        return np.array([not could_be(state[3:6], covariance, limit_m_s) for state, covariance in states], bool)

    def _leave_alone(self, k: int, now_s: float) -> None:
        """A target that a single camera sees is no longer filtered; it keeps its number (lone.py)."""
        (watching,) = self._scores.seen_by(k, now_s)
        camera, label = self.network.cameras[watching].id, int(self._scores.label[k, watching])
        farewell = self._reports.farewell(k, now_s)
        self._lone.keep(self._scores.track[k], (camera, label), float(self._scores.last_s[k]), farewell)

    def dismiss(self) -> list[TargetEstimate]:
        """Nothing that was seen is believed any more: all targets end. Returns the farewells of confirmed ones."""
        return self._end(np.ones(len(self._bank), bool), self.newest_s) + self._lone.end(np.inf)

    def distrust(self, camera_id: str, miss_rad: float) -> list[TargetEstimate]:
        """A camera's rays were off by miss_rad for a while: what they did to targets is taken back.

        Targets that it has lately seen become uncertain by as much as its rays were off; those that hang on it and one
        other camera alone end. Returns the final estimates of confirmed ones.
        """
        number = self._number.get(camera_id)
        if number is None:
            return []
        lost = self._lone.end(np.inf, camera_id)
        self._denials.forget(number)
        if not len(self._bank):
            return lost
        seen = self._scores.seen_lately(number)
        self._scores.forget(number)
        self._loose = deque((ray for ray in self._loose if ray.camera != number), maxlen=LOOSE_RAYS)
        away_m = np.linalg.norm(self._bank.state[:, :3] - self.network.cameras[number].centre_enu, axis=1)
        self._bank.widen(np.where(seen, MISLED * miss_rad * away_m, 0.0))
        alone = seen & (self._scores.watching(self.newest_s) < 2)
        return self._end(alone, self.newest_s) + lost

    def _end(self, ended: NDArray[np.bool_], now_s: float) -> list[TargetEstimate]:
        if not ended.any():
            return []
        gone = [
            k for k in np.nonzero(ended & self._scores.confirmed)[0].tolist() if self._scores.track[k] not in self._lone
        ]
        lost = [self._reports.farewell(k, now_s) for k in gone]
        self.counters["lost"] += len(lost)
        self._bank.keep(~ended)
        self._scores.keep(~ended)
        self._errors.keep(~ended)
        self._denials.keep(~ended)
        return lost

    def refused(self) -> NotUsed:
        """What was not used, and why, since this was asked last."""
        late_s, self._late_s = self._late_s, {}
        return NotUsed(late_s, self._reports.too_uncertain(), self._reports.contested())

    def estimates(self, now_s: float, tracks: set[int] | None = None) -> list[TargetEstimate]:
        """All targets that are confirmed (or those of `tracks`), each at the time of its last measurement."""
        return self._reports.at_last(now_s, tracks)

    def predicted(self, now_s: float) -> list[TargetEstimate]:
        """All targets that are confirmed, each taken to now, on or back, with what that adds to its covariance."""
        return self._reports.moved_on(now_s)

    @property
    def alone(self) -> int:
        """How many targets have kept their number, and have no position, as one camera alone sees them."""
        return len(self._lone)

    @property
    def confirmed(self) -> int:
        """How many targets are confirmed or coasting."""
        return int(np.count_nonzero(self._scores.confirmed))

    @property
    def tentative(self) -> int:
        """How many targets are tentative."""
        return int(np.count_nonzero(~self._scores.confirmed))

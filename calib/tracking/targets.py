"""Multiple-target tracking from rays: which detection is which object, and where each is, with a true covariance.

A measurement is one camera's pixel at that pixel's own exposure time: nothing is interpolated and no two cameras need
fire together. The hazards are two. A target that is not there: so new tracks stay tentative until two cameras have seen
them for a while and no camera that should see them denies them. And a target that is not where it is reported to be: so
a target nobody has seen for a while coasts, with a covariance that grows, and is then deleted, once and for all.

Time here is site time: seconds since the network's own epoch. The caller says what "now" is.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.network import Network
from calib.observations import Frame
from calib.sighting import CameraView
from calib.tracking.association import GATE, assign
from calib.tracking.common_now import CommonNow
from calib.tracking.filterbank import Expected, FilterBank, Look, Rays
from calib.tracking.initiation import STRAIGHT_S, initiate
from calib.tracking.options import TrackerOptions
from calib.tracking.pixelbias import with_bias
from calib.tracking.track_scores import AssociationEvidence, TrackScores
from calib.tracking.tracklets import LooseRay, NewTrack, tracklets
from edge.common.arrays import Array

SCAN_S: Final = 0.1  # s between searches for new tracks
LOOSE_RAYS: Final = 4000  # kept at most; a detector in flood must not slow the loop
COASTS_AFTER_S: Final = 0.5  # s without a measurement: several frames of the slowest camera
HALF_OUTSIDE_PX: Final = 12.0  # a target so near the image's edge may be half outside: not seeing it proves nothing
SAME_LABEL_BONUS: Final = 4.0  # squared sigma: what a camera's own track number is worth where two targets cross
DETECTED: Final = 0.8  # how often a camera that sees a target reports it
CLUTTER_A_FRAME: Final = 1.0
MISSED: Final = math.log(1 - DETECTED)  # log-likelihood that a target that is there is not reported
TENTATIVE_S: Final = 1.5  # s a tentative target may go unseen
MISLED: Final = 2.0  # times what one camera's ray is off, a target may be: two rays that cross at 30 degrees
TWIN_SIGMA2: Final = 12.0  # squared normalised distance within which two targets are one object, 3 degrees of freedom


class TargetState(StrEnum):
    """The life of a target."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(frozen=True)
class TargetEstimate:
    """Where a target is. covariance: (6, 6) of position and velocity, ENU. age_s: since its last measurement."""

    track: int
    state: TargetState
    t_unix_ns: int
    position_enu: Array
    velocity_enu: Array
    covariance: Array
    cameras: tuple[str, ...]
    age_s: float
    quality: float


class Tracker:
    """All targets of a site. `observe` what comes, `advance` to now, read `estimates`; `exchange` the network."""

    def __init__(self, network: Network, options: TrackerOptions | None = None, first_track: int = 1) -> None:
        self._options = options or TrackerOptions()
        self._bank = FilterBank(with_bias(network), self._options.motion)
        self._scores = TrackScores(len(network.cameras))
        self._loose: deque[LooseRay] = deque(maxlen=LOOSE_RAYS)
        self._next_track = first_track
        self._common = CommonNow()
        self._newest_s = -np.inf
        self._scanned_s = -np.inf
        self.counters: Counter[str] = Counter()
        self._adopt(network)

    def _adopt(self, network: Network) -> None:
        self._network = network
        self._views = [CameraView.of(camera) for camera in network.cameras]
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
        self._bank.exchange(with_bias(network))
        self._scores.exchange(kept, shift_s)
        self._common.shift(shift_s)
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
        moved: list[int] = []
        if t_s < now_s - horizon_s:
            self.counters["late"] += 1
        elif t_s > now_s + horizon_s:
            self.counters["early"] += 1
            self.counters["overflown"] += not self._common.hold(frame, t_s)
        else:
            moved = self._take(number, frame, t_s, rows_s)
        for held in self._common.due(now_s):
            moved += self._take_held(held)
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
        """A frame whose time has come; its camera may have been taken out meanwhile."""
        number = self._number.get(frame.camera)
        return [] if number is None else self._take(number, frame, *self._exposed_s(number, frame))

    def _take(self, number: int, frame: Frame, t_s: float, rows_s: Array) -> list[int]:
        self._newest_s = max(self._newest_s, t_s)
        rays = Rays(frame.pixels, rows_s - t_s, frame.sigma_px)
        taken, moved = self._associate(number, frame.label, rays, t_s)
        for k in np.nonzero(~taken)[0]:
            u, v = frame.pixels[k]
            self._loose.append(
                LooseRay(number, int(frame.label[k]), float(rows_s[k]), float(u), float(v), float(frame.sigma_px[k]))
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
        sighting = self._views[number].sight(prediction.state[:, :3])
        expected = self._bank.expect(prediction, sighting, number)
        pairs, odds = self._match(number, label, rays, expected)
        which, detection = np.array([p[0] for p in pairs], int), np.array([p[1] for p in pairs], int)
        due = sighting.valid & self._views[number].inside(sighting.pixels, HALF_OUTSIDE_PX)
        if pairs:
            chosen = rays.chosen(detection)
            look = Look(number, self._views[number], sighting.chosen(which), chosen)
            mahalanobis2 = self._bank.update(prediction, which, look)
            gain = odds[which, detection] - mahalanobis2 / 2
            self._scores.hit(number, which, t_s, AssociationEvidence(label[detection], gain, mahalanobis2))
            taken[detection] = True
            due[which] = False
        self._scores.miss(number, np.nonzero(due)[0], MISSED)
        return taken, [self._scores.track[k] for k in which]

    def _odds(self, number: int, determinant: Array) -> Array:
        """Log-likelihood ratio of a detection right where a target is expected, against clutter."""
        width, height = self.network.cameras[number].lens.size_px
        constant = math.log(DETECTED * width * height / CLUTTER_A_FRAME / (2 * math.pi))
        odds: Array = constant - np.log(determinant) / 2
        return odds

    def _match(
        self, number: int, label: NDArray[np.int64], rays: Rays, expected: Expected
    ) -> tuple[list[tuple[int, int]], Array]:
        """Pairs of target and detection, and the odds (N, K) of each against clutter.

        Confirmed targets choose first; what they leave is the tentative ones'.
        """
        valid = expected.sighting.valid
        if not len(label) or not valid.any():
            return [], np.zeros((len(valid), len(label)))
        S, drift = expected.covariance, expected.drift[:, None] * rays.after_s[None, :, None]
        x, y = np.moveaxis(rays.pixels[None] - expected.sighting.pixels[:, None] - drift, 2, 0)
        noise = rays.sigma_px[None] ** 2
        a, b, d = S[:, 0, 0][:, None] + noise, S[:, 0, 1][:, None], S[:, 1, 1][:, None] + noise
        determinant = a * d - b * b
        mahalanobis2 = (d * x * x - 2 * b * x * y + a * y * y) / determinant
        odds = self._odds(number, determinant)
        worth = 2 * (odds - MISSED)
        cost = np.where(valid[:, None] & (mahalanobis2 < GATE), mahalanobis2 - np.minimum(worth, GATE), 0.0)
        same = (self._scores.label[:, number, None] == label[None]) & (label[None] > 0)
        cost = np.where(same & (cost < 0), cost - SAME_LABEL_BONUS, cost)
        confirmed = self._scores.confirmed
        if confirmed.all() or not confirmed.any():
            return assign(cost, 0.0), odds
        first = assign(np.where(confirmed[:, None], cost, 0.0), 0.0)
        cost[:, [k for _, k in first]] = 0.0
        return first + assign(np.where(confirmed[:, None], 0.0, cost), 0.0), odds

    def advance(self, now_s: float) -> list[TargetEstimate]:
        """Let time pass: track initiation, confirmation, deletion. Returns the final estimates of targets lost now."""
        if now_s - self._scanned_s < SCAN_S:
            return []
        self._scanned_s = now_s
        self._initiate_tracks(now_s)
        self._scores.confirm()
        self._scores.hold_back_unseen(now_s)
        return self._delete_tracks(now_s)

    def _initiate_tracks(self, now_s: float) -> None:
        while self._loose and self._loose[0].t_s < now_s - STRAIGHT_S:
            self._loose.popleft()
        if len(self._loose) < 2:
            return
        found = tracklets(self._loose, self._bank.network, now_s)
        initiated = initiate(found, self._bank.network, self._options.motion, self._options.limits, now_s)
        for new in initiated:
            self._add(new)
        used = {member for new in initiated for member in new.seen_by}
        if used:
            self._loose = deque((r for r in self._loose if (r.camera, r.label) not in used), maxlen=LOOSE_RAYS)

    def _add(self, new: NewTrack) -> None:
        self._bank.add(new.state, new.covariance, new.with_poses, new.t_s)
        self._scores.add(self._next_track, new.t_s, new.seen_by)
        self._next_track += 1
        self.counters["born"] += 1

    def _delete_tracks(self, now_s: float) -> list[TargetEstimate]:
        silent_s = now_s - self._scores.last_s
        sigma_m = np.sqrt(np.abs(np.linalg.eigvalsh(self._bank.covariance[:, :3, :3])[:, -1])) if len(self._bank) else 0
        confirmed = self._scores.confirmed
        deleted = silent_s > np.where(confirmed, self._options.coast_s, TENTATIVE_S)
        deleted |= (sigma_m > self._options.max_sigma_m) | self._scores.denied
        deleted |= np.linalg.norm(self._bank.state[:, 3:6], axis=1) > 1.5 * self._options.limits.max_speed_m_s
        deleted |= self._twins()
        return self._end(deleted, now_s)

    def dismiss(self) -> list[TargetEstimate]:
        """Nothing that was seen is believed any more: all targets end. Returns the farewells of confirmed ones."""
        return self._end(np.ones(len(self._bank), bool), self.newest_s)

    def distrust(self, camera_id: str, miss_rad: float) -> list[TargetEstimate]:
        """A camera's rays were off by miss_rad for a while: what they did to targets is taken back.

        Targets that it has lately seen become uncertain by as much as its rays were off; those that hang on it and one
        other camera alone end. Returns the final estimates of confirmed ones.
        """
        number = self._number.get(camera_id)
        if number is None or not len(self._bank):
            return []
        seen = self._scores.seen_lately(number)
        self._scores.forget(number)
        self._loose = deque((ray for ray in self._loose if ray.camera != number), maxlen=LOOSE_RAYS)
        away_m = np.linalg.norm(self._bank.state[:, :3] - self.network.cameras[number].centre_enu, axis=1)
        self._bank.widen(np.where(seen, MISLED * miss_rad * away_m, 0.0))
        alone = seen & (self._scores.watching(self.newest_s) < 2)
        return self._end(alone, self.newest_s)

    def _end(self, ended: NDArray[np.bool_], now_s: float) -> list[TargetEstimate]:
        if not ended.any():
            return []
        confirmed = self._scores.confirmed
        lost = [self._estimate(k, now_s, TargetState.LOST) for k in np.nonzero(ended & confirmed)[0].tolist()]
        self.counters["lost"] += len(lost)
        self._bank.keep(~ended)
        self._scores.keep(~ended)
        return lost

    def _twins(self) -> NDArray[np.bool_]:
        """Targets that have become the same object as an older one."""
        twin = np.zeros(len(self._bank), bool)
        for k in range(1, len(self._bank)):
            apart = self._bank.state[:k, :3] - self._bank.state[k, :3]
            apart += self._bank.state[:k, 3:6] * (self._bank.t_s[k] - self._bank.t_s[:k])[:, None]
            near = np.linalg.norm(apart, axis=1) < 10.0
            for j in np.nonzero(near & ~twin[:k])[0]:
                P = self._bank.covariance[j, :6, :6] + self._bank.covariance[k, :6, :6]
                both = np.concatenate([apart[j], self._bank.state[j, 3:6] - self._bank.state[k, 3:6]])
                twin[k] |= bool(both @ np.linalg.solve(P, both) < TWIN_SIGMA2 and self._scores.rivals(int(j), k))
        return twin

    def estimates(self, now_s: float, tracks: set[int] | None = None) -> list[TargetEstimate]:
        """All targets that are confirmed (or those of `tracks`), each at the time of its last measurement."""
        chosen = [
            k
            for k in np.nonzero(self._scores.confirmed)[0].tolist()
            if tracks is None or self._scores.track[k] in tracks
        ]
        return [self._estimate(k, now_s, self._state_of(k, now_s)) for k in chosen]

    def predicted(self, now_s: float) -> list[TargetEstimate]:
        """All targets that are confirmed, each taken to now, on or back, with what that adds to its covariance."""
        chosen = np.nonzero(self._scores.confirmed)[0].tolist()
        return [self._estimate(k, now_s, self._state_of(k, now_s), moved_on=True) for k in chosen]

    @property
    def confirmed(self) -> int:
        """How many targets are confirmed or coasting."""
        return int(np.count_nonzero(self._scores.confirmed))

    @property
    def tentative(self) -> int:
        """How many targets are tentative."""
        return int(np.count_nonzero(~self._scores.confirmed))

    def _state_of(self, k: int, now_s: float) -> TargetState:
        return TargetState.COASTING if now_s - self._scores.last_s[k] > COASTS_AFTER_S else TargetState.CONFIRMED

    def _estimate(self, k: int, now_s: float, state: TargetState, *, moved_on: bool = False) -> TargetEstimate:
        x, P, t_s = self._bank.state[k], self._bank.covariance[k], float(self._bank.t_s[k])
        still = state is TargetState.CONFIRMED and not moved_on
        # Back as well: what "now" is, is known to some milliseconds, and a frame may be stamped after it.
        dt_s = now_s - t_s if moved_on else 0.0 if still else max(now_s - t_s, 0.0)
        if dt_s != 0:
            motion = self._options.motion
            F = motion.transition(np.array([dt_s]))[0]
            surprise = motion.noise(np.array([dt_s]))[0] * self._bank.expected_manoeuvre_factor[k]
            x, P, t_s = F @ x, F @ P @ F.T + surprise, t_s + dt_s
        seen = self._scores.seen_by(k)
        return TargetEstimate(
            track=self._scores.track[k],
            state=state,
            t_unix_ns=self.network.t_mid_unix_ns + round(t_s * 1e9),
            position_enu=x[:3].copy(),
            velocity_enu=x[3:6].copy(),
            covariance=P[:6, :6].copy(),
            cameras=tuple(self.network.cameras[c].id for c in seen),
            age_s=max(0.0, t_s - float(self._scores.last_s[k])),
            quality=self._scores.quality(k),
        )

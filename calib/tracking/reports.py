"""What is said of the targets that a tracker follows, and what is not said because it would be of no use.

The hazard is a position that is sent because it exists. A target that coasts through a turn is somewhere within a
street; so what has become more uncertain than its range excuses is kept back, and that it was is told.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.tracking.common_now import CommonNow
from calib.tracking.denials import Denials
from calib.tracking.estimates import TargetEstimate, TargetState
from calib.tracking.filterbank import FilterBank
from calib.tracking.options import TrackerOptions
from calib.tracking.track_scores import TrackScores
from edge.common.arrays import Array

COASTS_AFTER_S: Final = 0.5  # s without a measurement: several frames of the slowest camera


@dataclass(frozen=True)
class NotUsed:
    """What was not used: frames beyond the horizon, by camera, s late; targets too uncertain, the surest's sigma.

    contested: for a target that others speak against, who reports it and who should see it and does not.
    """

    late_s: dict[str, float]
    too_uncertain_m: float | None
    contested: tuple[tuple[str, ...], tuple[str, ...]] | None = None


def spread(state: Array, covariance: Array, centres_enu: Array) -> tuple[Array, Array]:
    """(N,) sigma of position along its worst axis, and range from the nearest camera, both m."""
    if not len(state):
        return np.zeros(0), np.zeros(0)
    sigma_m = np.sqrt(np.abs(np.linalg.eigvalsh(covariance[:, :3, :3])[:, -1]))
    return sigma_m, np.linalg.norm(state[:, None, :3] - centres_enu, axis=2).min(axis=1)


class TargetReports:
    """Estimates of the targets in a filter bank, by what their scores say of them."""

    def __init__(
        self, bank: FilterBank, scores: TrackScores, options: TrackerOptions, denials: Denials, common: CommonNow
    ) -> None:
        self._bank, self._scores, self._options, self._denials = bank, scores, options, denials
        self._common = common
        self._too_uncertain_m: float | None = None

    def too_uncertain(self) -> float | None:
        """The least sigma of what was kept back since this was asked last, m; None if nothing was."""
        least_m, self._too_uncertain_m = self._too_uncertain_m, None
        return least_m

    def contested(self) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
        """Of a target that cameras speak against: who sees it, and who should and does not; None if there is none."""
        for k in np.nonzero(self._scores.confirmed & self._denials.against.any(axis=1))[0].tolist():
            return self._names(self._scores.seen_by(k)), self._names(self._against(k))
        return None

    def _against(self, k: int) -> list[int]:
        against: list[int] = np.nonzero(self._denials.against[k])[0].tolist()
        return against

    def _names(self, cameras: list[int]) -> tuple[str, ...]:
        return tuple(self._bank.network.cameras[camera].id for camera in cameras)

    def farewell(self, k: int, now_s: float) -> TargetEstimate:
        """The last that is said of target k."""
        return self._estimate(k, now_s, TargetState.LOST)

    def at_last(self, now_s: float, tracks: set[int] | None) -> list[TargetEstimate]:
        """Confirmed targets (or those of `tracks`), each at the time of its last measurement."""
        chosen = [k for k in self._confirmed() if tracks is None or self._scores.track[k] in tracks]
        return self._certain([self._estimate(k, now_s, self._state_of(k, now_s)) for k in chosen])

    def moved_on(self, now_s: float) -> list[TargetEstimate]:
        """Confirmed targets, each taken to now, on or back."""
        return self._certain(
            [self._estimate(k, now_s, self._state_of(k, now_s), moved_on=True) for k in self._confirmed()]
        )

    def _confirmed(self) -> list[int]:
        chosen: list[int] = np.nonzero(self._scores.confirmed)[0].tolist()
        return chosen

    def _certain(self, said: list[TargetEstimate]) -> list[TargetEstimate]:
        """Without those whose position is of no use just now: of a target that coasts, or begins to turn."""
        if not said:
            return said
        states, covariances = np.array([e.position_enu for e in said]), np.array([e.covariance for e in said])
        sigma_m, range_m = spread(states, covariances, self._bank.network.centres_enu)
        beyond = sigma_m > self._options.most_sigma_m(range_m)
        if beyond.any():
            least_m = float(sigma_m[beyond].min())
            self._too_uncertain_m = min(least_m, self._too_uncertain_m or least_m)
        return [e for e, out in zip(said, beyond, strict=True) if not out]

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
        cameras = self._names(self._scores.seen_by(k))
        return TargetEstimate(
            track=self._scores.track[k],
            state=state,
            t_unix_ns=self._bank.network.t_mid_unix_ns + round(t_s * 1e9),
            position_enu=x[:3].copy(),
            velocity_enu=x[3:6].copy(),
            covariance=P[:6, :6].copy(),
            cameras=cameras,
            age_s=max(0.0, t_s - float(self._scores.last_s[k])),
            quality=self._scores.quality(k),
            denied_by=self._names(self._against(k)),
            ahead=tuple(c for c in cameras if self._common.leads(c, self._options.reorder_horizon_s)),
            rests_on=self._bank.network.rests_on,
        )

"""The Kalman filters of all targets, as one: every step works on all of them at once.

The hazard is a covariance that shrinks where knowledge does not. A thousand rays of one camera do not average away
that the camera points 0.1 degrees wrong: all are wrong together, and so are those of the other cameras that were
calibrated with it. This is a Schmidt-Kalman filter (Schmidt 1966): the poses are not estimated here, but how each
state's error hangs together with theirs is carried along, so that what rays share never averages away. When the
network is exchanged, the same correlation says how each state moves with it, and tracking goes on without a jump.

An out-of-sequence measurement updates the state where it stands, by way of the state taken back to the ray's own time
(Bar-Shalom 2002). One that
moves its target far, as the second camera does after a stretch with one alone, is linearised again where it moved it to
(Bell and Cathey 1993): a straight line drawn through the wrong point ends in a sure and false position.
"""

from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.network import POSE_SIZE, Network, pose_of
from calib.sighting import CameraView, Sighting
from calib.tracking.motion import STATE, Singer
from edge.common.arrays import Array

MANOEUVRE_FACTORS: Final = (0.02, 60.0)  # of a target: a balloon to a racing drone at 5 g, against the model's variance
AWAKES_S: Final = 0.5  # s: how soon a target that begins to turn is taken at its word
CALMS_S: Final = 2.0  # s: how long one that flies straight is still expected to turn; longer, and sigma is too wide
ONSET_S: Final = 0.25  # s before a detection outside its gate, within which a hard turn may have begun
UNWATCHED: Final = 1.0  # least factor of a target whose range nobody measures: no camera would see it turn
FAR: Final = 0.01  # of the range: a step beyond which a pixel no longer follows its tangent, 0.1 px at f = 1000
LOOKS: Final = 4  # linearisations at most


@dataclass(frozen=True)
class PredictedStates:
    """All states taken to `t_s`: `state` (N, 9), `covariance` (N, 9, 9), by the `transition` (N, 9, 9) that did.

    base_*: what an update is applied to, at `base_t_s`: the same, or for a late instant the states as they stand;
    base_transition takes the bank's states there. cross: (N, 9, 9) covariance of the base with `state`.
    """

    t_s: float
    transition: Array
    state: Array
    covariance: Array
    base_transition: Array
    base_t_s: Array
    base_state: Array
    base_covariance: Array
    cross: Array


@dataclass(frozen=True)
class Expected:
    """What a camera should see of each target: pixels (N, 2), their drift px/s (N, 2), covariance (N, 2, 2)."""

    sighting: Sighting
    drift: Array
    covariance: Array


@dataclass(frozen=True)
class Rays:
    """Pixels (K, 2), how long after a prediction's instant each was exposed, s (K,), and their one sigma, px (K,)."""

    pixels: Array
    after_s: Array
    sigma_px: Array

    def chosen(self, which: NDArray[np.int64]) -> "Rays":
        """Those of indices (M,)."""
        return Rays(self.pixels[which], self.after_s[which], self.sigma_px[which])


@dataclass(frozen=True)
class Look:
    """One camera's rays, and how it should see the targets they are of: the view, by number, and the sighting there."""

    camera: int
    view: CameraView
    sighting: Sighting
    rays: Rays


@dataclass(frozen=True)
class _Line:
    """A tangent to the projection: H (K, 2, 9) by the states, by_pose (K, 2, 6), and what it makes of a ray."""

    H: Array
    by_pose: Array
    inverse: Array
    gain_there: Array
    innovation: Array
    about: Array


@dataclass(frozen=True)
class _Before:
    """What is known of K targets at the instant of a ray: with_pose (K, 9, 6) and pose (6, 6), of its camera's pose."""

    state: Array
    covariance: Array
    with_pose: Array
    pose: Array

    def linearised(self, seen: Sighting, rays: Rays, about: Array | None = None) -> _Line:
        """The tangent at a sighting of states about (K, 9): by default the predicted ones."""
        about = self.state if about is None else about
        H = np.zeros((len(about), 2, STATE))
        H[:, :, :3] = seen.by_point
        H[:, :, 3:6] = seen.by_point * rays.after_s[:, None, None]
        by_pose_t = seen.by_pose.transpose(0, 2, 1)
        there = np.matmul(self.covariance, H.transpose(0, 2, 1)) + np.matmul(self.with_pose, by_pose_t)
        # S = H P H' + H C J' + J C' H' + J R J' + noise (Schmidt 1966): C with the pose, R the pose's, J = by_pose.
        S = np.matmul(H, there)
        S += np.matmul(np.matmul(H, self.with_pose) + np.matmul(seen.by_pose, self.pose), by_pose_t)
        S[:, 0, 0] += rays.sigma_px**2
        S[:, 1, 1] += rays.sigma_px**2
        inverse = _inverse_2x2(S)
        drift = np.matmul(seen.by_point, about[:, 3:6, None])[:, :, 0]
        innovation = rays.pixels - seen.pixels - drift * rays.after_s[:, None]
        if about is not self.state:
            innovation -= np.matmul(H, (self.state - about)[:, :, None])[:, :, 0]
        return _Line(H, seen.by_pose, inverse, np.matmul(there, inverse), innovation, about)

    def far(self, line: _Line, after: Array, centre_enu: Array) -> bool:
        """Whether any target has moved too far from where the tangent touches."""
        step, ahead = after[:, :3] - line.about[:, :3], line.about[:, :3] - centre_enu
        return bool((np.einsum("ni,ni->n", step, step) > FAR**2 * np.einsum("ni,ni->n", ahead, ahead)).any())


@dataclass
class FilterBank:
    """States (N, 9), covariances (N, 9, 9), covariances with the poses (N, 9, 6 C) and times (N,) of all targets.

    manoeuvre_factor: (N,) variance of each target's acceleration against the motion model's, learnt from its flight.
    watched: (N,) whether two cameras look at it now, so that its range is measured.
    """

    network: Network
    motion: Singer
    state: Array = field(default_factory=lambda: np.empty((0, STATE)))
    covariance: Array = field(default_factory=lambda: np.empty((0, STATE, STATE)))
    with_poses: Array = field(init=False)
    t_s: Array = field(default_factory=lambda: np.empty(0))
    manoeuvre_factor: Array = field(default_factory=lambda: np.empty(0))
    watched: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, bool))

    def __post_init__(self) -> None:
        self.with_poses = np.empty((0, STATE, POSE_SIZE * len(self.network.cameras)))

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def expected_manoeuvre_factor(self) -> Array:
        """(N,) what to expect of each target's acceleration: what it showed, unless nobody would see it change."""
        return np.where(self.watched, self.manoeuvre_factor, np.maximum(self.manoeuvre_factor, UNWATCHED))

    def watch(self, cameras: NDArray[np.intp]) -> None:
        """Say how many cameras (N,) look at each target; one that only one goes on seeing may already be turning."""
        watched = cameras >= 2
        left = self.watched & (cameras == 1)
        if left.any():
            calm = np.maximum(UNWATCHED - self.manoeuvre_factor, 0.0) * left * self.motion.sigma_m_s2**2
            self.covariance[:, [6, 7, 8], [6, 7, 8]] += calm[:, None]
        self.watched = watched

    def add(self, state: Array, covariance: Array, with_poses: Array, t_s: float) -> None:
        """Append one target."""
        self.state = np.concatenate([self.state, state[None]])
        self.covariance = np.concatenate([self.covariance, covariance[None]])
        self.with_poses = np.concatenate([self.with_poses, with_poses[None]])
        self.t_s = np.append(self.t_s, t_s)
        self.manoeuvre_factor = np.append(self.manoeuvre_factor, max(1.0, float(self._shown(state, covariance))))
        self.watched = np.append(self.watched, True)

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Forget all targets but those of a boolean mask (N,)."""
        self.state, self.covariance = self.state[which], self.covariance[which]
        self.with_poses, self.t_s = self.with_poses[which], self.t_s[which]
        self.manoeuvre_factor, self.watched = self.manoeuvre_factor[which], self.watched[which]

    def widen(self, sigma_m: Array) -> None:
        """Make positions more uncertain by sigma_m (N,), and velocities by as much in a second."""
        self.covariance[:, [0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5]] += sigma_m[:, None] ** 2

    def predict(self, t_s: float) -> PredictedStates:
        """All states at t_s, which may lie a little before them."""
        dt_s = t_s - self.t_s
        F = self.motion.transition(dt_s)
        state = np.matmul(F, self.state[:, :, None])[:, :, 0]
        half = np.matmul(F, self.covariance)
        covariance = np.matmul(half, F.transpose(0, 2, 1))
        covariance += self.motion.noise(dt_s) * self.expected_manoeuvre_factor[:, None, None]
        if (dt_s >= 0).all():
            now = np.full(len(self), t_s)
            return PredictedStates(t_s, F, state, covariance, F, now, state, covariance, covariance)
        ahead = dt_s >= 0
        ahead1, ahead2 = ahead[:, None], ahead[:, None, None]
        return PredictedStates(
            t_s,
            F,
            state,
            covariance,
            np.where(ahead2, F, np.eye(STATE)),
            np.where(ahead, t_s, self.t_s),
            np.where(ahead1, state, self.state),
            np.where(ahead2, covariance, self.covariance),
            np.where(ahead2, covariance, half.transpose(0, 2, 1)),
        )

    def turning(self, prediction: PredictedStates, which: NDArray[np.intp]) -> PredictedStates:
        """A prediction in which targets `which` (K,) have begun the hardest turn a little while ago.

        The onset of a manoeuvre as a hypothesis of its own (Bar-Shalom, Li and Kirubarajan 2001, section 11.5).
        """
        onset = self.motion.noise(np.array([ONSET_S])) * MANOEUVRE_FACTORS[1]
        to_base = self.motion.transition(prediction.base_t_s[which] - prediction.t_s)
        moved = np.matmul(to_base, onset)
        return replace(
            prediction,
            covariance=_plus(prediction.covariance, which, onset),
            base_covariance=_plus(prediction.base_covariance, which, np.matmul(moved, to_base.transpose(0, 2, 1))),
            cross=_plus(prediction.cross, which, moved),
        )

    def alarm(self, which: NDArray[np.intp]) -> None:
        """Expect the hardest turns of targets `which` (K,) until they fly straight again."""
        self.manoeuvre_factor[which] = MANOEUVRE_FACTORS[1]

    def expect(self, prediction: PredictedStates, sighting: Sighting, camera: int) -> Expected:
        """What camera number `camera` should see, without the detector's own noise."""
        H, at = sighting.by_point, pose_of(camera)
        drift = np.matmul(H, prediction.state[:, 3:6, None])[:, :, 0]
        seen = np.matmul(np.matmul(H, prediction.covariance[:, :3, :3]), H.transpose(0, 2, 1))
        with_pose = np.matmul(prediction.transition[:, :3], self.with_poses[:, :, at])
        shared = np.matmul(np.matmul(H, with_pose), sighting.by_pose.transpose(0, 2, 1))
        pose = np.matmul(sighting.by_pose, self.network.covariance[at, at])
        pose = np.matmul(pose, sighting.by_pose.transpose(0, 2, 1))
        return Expected(sighting, drift, seen + shared + shared.transpose(0, 2, 1) + pose)

    def update(self, prediction: PredictedStates, which: NDArray[np.intp], look: "Look") -> tuple[Array, Array]:
        """Let targets `which` (K,) take one ray each.

        Returns innovations (K, 2), px, and each one's normalised square (NIS) (K,), 2 degrees of freedom.
        """
        at = pose_of(look.camera)
        transition, with_pose = prediction.transition[which], self.with_poses[which, :, at]
        before = _Before(
            prediction.state[which],
            prediction.covariance[which],
            np.matmul(transition, with_pose),
            self.network.covariance[at, at],
        )
        line = before.linearised(look.sighting, look.rays)
        innovation = line.innovation
        mahalanobis2: Array = np.einsum("ni,nij,nj->n", innovation, line.inverse, innovation)
        for _ in range(1, LOOKS):
            after = before.state + np.matmul(line.gain_there, line.innovation[:, :, None])[:, :, 0]
            if not before.far(line, after, look.view.camera.centre_enu):
                break
            again = look.view.sight(after[:, :3])
            if not again.valid.all():
                break
            line = before.linearised(again, look.rays, after)
        self._take(prediction, which, line, at)
        return innovation, mahalanobis2

    def _take(self, prediction: PredictedStates, which: NDArray[np.intp], line: _Line, at: slice) -> None:
        passed_s = prediction.base_t_s[which] - self.t_s[which]
        transition = prediction.base_transition[which]
        in_pixels = np.matmul(prediction.cross[which], line.H.transpose(0, 2, 1))
        base_with_pose = np.matmul(transition, self.with_poses[which, :, at])
        in_pixels += np.matmul(base_with_pose, line.by_pose.transpose(0, 2, 1))
        gain = np.matmul(in_pixels, line.inverse)
        self.t_s[which] = prediction.base_t_s[which]
        self.state[which] = prediction.base_state[which] + np.matmul(gain, line.innovation[:, :, None])[:, :, 0]
        covariance = prediction.base_covariance[which] - np.matmul(gain, in_pixels.transpose(0, 2, 1))
        self.covariance[which] = (covariance + covariance.transpose(0, 2, 1)) / 2
        # All poses at once: with a hundred cameras this is the largest of the filter's sums.
        kept = transition - np.matmul(gain, np.matmul(line.H, prediction.transition[which]))
        with_poses = np.matmul(kept, self.with_poses[which])
        with_poses -= np.matmul(np.matmul(gain, line.by_pose), self.network.covariance[at])
        self.with_poses[which] = with_poses
        self._learn(which, passed_s)

    def _learn(self, which: NDArray[np.intp], passed_s: Array) -> None:
        """How hard each target manoeuvres: the expectation step of EM, forgetting (Dempster et al. 1977)."""
        seen = self._shown(self.state[which], self.covariance[which])
        memory_s = np.where(seen > self.manoeuvre_factor[which], AWAKES_S, CALMS_S)
        self.manoeuvre_factor[which] += (seen - self.manoeuvre_factor[which]) * np.minimum(passed_s / memory_s, 1.0)

    def _shown(self, state: Array, covariance: Array) -> Array:
        """(...) variance of the acceleration that states (..., 9) show, against the motion model's."""
        variance = covariance[..., 6, 6] + covariance[..., 7, 7] + covariance[..., 8, 8]
        shown = (np.einsum("...i,...i->...", state[..., 6:], state[..., 6:]) + variance) / 3 / self.motion.sigma_m_s2**2
        return np.asarray(np.minimum(np.maximum(shown, MANOEUVRE_FACTORS[0]), MANOEUVRE_FACTORS[1]), float)

    def exchange(self, network: Network) -> None:
        """Go on with another network: states move as their errors hang together with the poses that changed."""
        old = self.network
        shared = [camera.id for camera in network.cameras if old.camera(camera.id) is not None]
        of_old, of_new = _columns(old, shared), _columns(network, shared)
        moved = np.concatenate([_pose_change(old, network, camera) for camera in shared] or [np.zeros(0)])
        # How a state's error follows from the poses' (pinv: poses may be known exactly, or only together).
        follows = self.with_poses[:, :, of_old] @ np.linalg.pinv(old.covariance[np.ix_(of_old, of_old)], hermitian=True)
        explained = np.matmul(self.with_poses[:, :, of_old], follows.transpose(0, 2, 1))
        poses = network.covariance[np.ix_(of_new, of_new)]
        self.state = self.state + follows @ moved
        back = follows.transpose(0, 2, 1)
        self.covariance = self.covariance - explained + np.matmul(np.matmul(follows, poses), back)
        self.with_poses = np.matmul(follows, network.covariance[of_new])
        self.t_s = self.t_s + (old.t_mid_unix_ns - network.t_mid_unix_ns) * 1e-9
        self.network = network


def _plus(matrices: Array, which: NDArray[np.intp], more: Array) -> Array:
    """A copy of (N, 9, 9) with (K, 9, 9) added to those of indices (K,)."""
    sums = matrices.copy()
    sums[which] += more
    return sums


def _inverse_2x2(matrix: Array) -> Array:
    """(K, 2, 2) inverses; numpy's own takes three times as long for a few."""
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    inverse = np.empty_like(matrix)
    inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 0], inverse[:, 1, 1] = d, -b, -c, a
    inverse /= (a * d - b * c)[:, None, None]
    return inverse


def _columns(network: Network, cameras: list[str]) -> list[int]:
    ids = [camera.id for camera in network.cameras]
    return [POSE_SIZE * ids.index(camera) + k for camera in cameras for k in range(POSE_SIZE)]


def _pose_change(old: Network, new: Network, camera_id: str) -> Array:
    """(6,) rotation vector and centre by which a camera's pose changed."""
    before, after = old.camera(camera_id), new.camera(camera_id)
    assert before is not None
    assert after is not None
    rotation = cv2.Rodrigues(after.R_cam_enu @ before.R_cam_enu.T)[0].ravel()
    return np.concatenate([rotation, after.centre_enu - before.centre_enu])

"""Has a camera been knocked, has its clock stepped, is its picture frozen? From raw rays against the network.

The hazard is a guard that believes what it guards. A filter bends its target towards a camera that was knocked, and a
watch on the filter's residuals falls asleep; so no target estimate enters here. Two cameras whose raw rays meet for a
second are witnesses to a point; a third that should see it and reports a track close by, but not there, is accused.
Who is accused by most of its witnesses is named, one at a time, because a knocked camera's own testimony is false.
"""

from collections import defaultdict, deque
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from calib.network import POSE_SIZE, Network
from calib.raytracks import SAMPLES, RayTrack, RayTracks
from calib.sighting import View
from calib.targets import Frame
from edge.lens import Array

PAIRS_A_CALL: Final = 2  # witnesses heard at each call: the loop must not wait for the guard
ALL_PAIRS_UP_TO: Final = 10  # cameras; beyond, each testifies with its next three in the network
MATCH_SIGMA: Final = 3.0  # two rays meet
ACCUSE_SIGMA: Final = 4.0  # a third ray misses
NOISE_PX: Final = 1.0  # of a median of SAMPLES detections, the lens model's errors included
NEAR_RAD: Final = 0.05  # 2.9 degrees: what is farther from where it should be is another object
EVIDENCE_S: Final = 6.0  # memory
MIN_EVIDENCE: Final = 6  # testimonies
MIN_EVIDENCE_S: Final = 1.0  # s they must span
GUILTY: Final = 0.7  # share of testimonies
FROZEN_S: Final = 3.0  # s of identical detections; a hovering drone's jitter in the last digit
FROZEN_FRAMES: Final = 30
AGREE_PAIRS: Final = 2  # of cameras whose rays meet, before a stored network is believed
REFUSE_S: Final = 6.0  # s of rays that do not meet, after which it is not


@dataclass(frozen=True)
class Finding:
    """A camera that must not be believed, why, and since when its observations are not to be used."""

    camera: str
    reason: str
    since_unix_ns: int


@dataclass(frozen=True)
class _Testimony:
    """What witnesses say of a camera: off (2,) px from where its track should be, image velocity (2,) px/s there."""

    t_unix_ns: int
    accused: bool
    off_px: Array
    velocity_px_s: Array


@dataclass(frozen=True)
class _Meeting:
    """A track of each of two cameras whose rays meet: where, at t_s (S,), points (S, 3), one sigma m (S,)."""

    t_s: Array
    points: Array
    sigma_m: Array


class Guard:
    """Watches all cameras of the network in force; or says whether a stored network agrees with what is seen."""

    def __init__(self) -> None:
        self._tracks = RayTracks()
        self._network: Network | None = None
        self._ignored: set[str] = set()
        self._views: dict[str, View] = {}
        self._since: dict[str, int] = {}
        self._testimony: defaultdict[str, deque[_Testimony]] = defaultdict(lambda: deque(maxlen=400))
        self._turn = 0
        self._frozen: dict[str, tuple[bytes, int, int]] = {}  # pixels, since, frames
        self._candidate: tuple[Network, int | None, set[tuple[str, str]]] | None = None
        self.residual_mrad: dict[tuple[str, str], float] = {}

    def trust(self, network: Network) -> None:
        """Watch this network from now on."""
        self.forget()
        self._network = network
        self._views = {camera.id: View.of(camera) for camera in network.cameras}

    def forget(self) -> None:
        """There is no network any more."""
        self._network, self._candidate = None, None
        self._ignored.clear()
        self._testimony.clear()
        self.residual_mrad.clear()

    def ignore(self, camera: str) -> None:
        """This camera has been left out; neither believe nor accuse it."""
        self._ignored.add(camera)
        self._testimony.clear()  # testimony together with it was false

    def observe(self, frame: Frame) -> None:
        """Take a frame of any camera."""
        self._tracks.add(frame)
        pixels = frame.pixels.tobytes()
        same, since, frames = self._frozen.get(frame.camera, (b"", frame.t_unix_ns, 0))
        still = pixels == same and len(frame.pixels) > 0
        self._frozen[frame.camera] = (pixels, since, frames + 1) if still else (pixels, frame.t_unix_ns, 0)

    # Watching

    def findings(self, now_unix_ns: int) -> list[Finding]:
        """Hear the next witnesses; who is guilty now."""
        found = [
            Finding(camera, "its picture is frozen", since)
            for camera, (_, since, frames) in self._frozen.items()
            if frames >= FROZEN_FRAMES and now_unix_ns - since > FROZEN_S * 1e9
        ]
        if self._network is None:
            return found
        pairs = self._witnesses([c.id for c in self._network.cameras if c.id not in self._ignored])
        for k in range(min(PAIRS_A_CALL, len(pairs))):
            self._hear(*pairs[(self._turn + k) % len(pairs)], now_unix_ns)
        self._turn += PAIRS_A_CALL
        return found + self._verdict(now_unix_ns)

    @staticmethod
    def _witnesses(cameras: list[str]) -> list[tuple[str, str]]:
        if len(cameras) <= ALL_PAIRS_UP_TO:
            return list(combinations(cameras, 2))
        return [(cameras[k], cameras[(k + n) % len(cameras)]) for k in range(len(cameras)) for n in (1, 2, 3)]

    def _hear(self, one: str, other: str, now_unix_ns: int) -> None:
        network = self._network
        assert network is not None
        meetings, _ = self._meetings(network, self._views, (one, other), now_unix_ns)
        for camera in network.cameras:
            if camera.id in {one, other} or camera.id in self._ignored or not meetings:
                continue
            tracks = self._tracks.of(camera, network, now_unix_ns - 10**9)
            for meeting in meetings:
                self._testify(network, camera.id, meeting, tracks, now_unix_ns)

    def _testify(
        self, network: Network, camera_id: str, meeting: _Meeting, tracks: list[RayTrack], now_unix_ns: int
    ) -> None:
        view = self._views[camera_id]
        seen = view.sight(meeting.points)
        if not (seen.valid.all() and view.inside(seen.pixels, 5.0).all() and tracks):
            return
        focal = min(view.camera.lens.intrinsics[:2])
        off = np.stack([track.at(meeting.t_s) for track in tracks]) - seen.pixels
        enough = np.isfinite(off[:, :, 0]).sum(axis=1) >= 3
        if not enough.any():
            return
        off = off[enough]
        median = np.nanmedian(off, axis=1)
        nearest = int(np.argmin(np.linalg.norm(median, axis=1)))
        miss_px = float(np.linalg.norm(median[nearest]))
        if miss_px > NEAR_RAD * focal:
            return
        range_m = np.linalg.norm(meeting.points - view.camera.centre_enu, axis=1)
        sigma_px = np.hypot(NOISE_PX, focal * _attitude_sigma(network, camera_id))
        limit_px = ACCUSE_SIGMA * float(np.median(np.hypot(sigma_px, focal * meeting.sigma_m / range_m)))
        velocity = (seen.pixels[-1] - seen.pixels[0]) / max(float(meeting.t_s[-1] - meeting.t_s[0]), 1e-3)
        self._testimony[camera_id].append(_Testimony(now_unix_ns, miss_px > limit_px, median[nearest], velocity))

    def _verdict(self, now_unix_ns: int) -> list[Finding]:
        """At most one camera a time: the others' testimony is heard afresh without it."""
        worst: tuple[float, str, list[_Testimony]] | None = None
        for camera, all_heard in self._testimony.items():
            heard = [t for t in all_heard if t.t_unix_ns > now_unix_ns - EVIDENCE_S * 1e9]
            accused = [t for t in heard[-3 * MIN_EVIDENCE :] if t.accused]
            share = len(accused) / max(len(heard[-3 * MIN_EVIDENCE :]), 1)
            long = len(accused) >= MIN_EVIDENCE and accused[-1].t_unix_ns - accused[0].t_unix_ns > MIN_EVIDENCE_S * 1e9
            if long and share > GUILTY and (worst is None or share > worst[0]):
                worst = (share, camera, accused)
        if worst is None:
            return []
        _, camera, accused = worst
        return [Finding(camera, self._reason(camera, accused), accused[0].t_unix_ns - 3 * 10**9)]

    def _reason(self, camera: str, accused: list[_Testimony]) -> str:
        """Knocked or clock: whether what it is off by is always the same, or follows the motion."""
        off = np.array([t.off_px for t in accused])
        velocity = np.array([t.velocity_px_s for t in accused])
        delay_s = float(np.sum(off * velocity) / max(np.sum(velocity**2), 1e-9))
        steady = np.median(off, axis=0)
        by_clock, by_knock = np.sum((off - delay_s * velocity) ** 2), np.sum((off - steady) ** 2)
        if by_clock < by_knock / 2:
            return f"its clock has stepped by about {delay_s * 1e3:.0f} ms"
        focal = min(self._views[camera].camera.lens.intrinsics[:2])
        return f"it was knocked: its rays miss by {np.degrees(np.linalg.norm(steady) / focal):.2f} degrees"

    # Two cameras

    def _meetings(
        self, network: Network, views: dict[str, View], pair: tuple[str, str], now_unix_ns: int
    ) -> tuple[list[_Meeting], bool]:
        """Where tracks of two cameras meet, each track once; and whether there was anything that could have."""
        one, other = (views[camera].camera for camera in pair)
        of_one = self._tracks.of(one, network, now_unix_ns - 10**9)
        of_other = self._tracks.of(other, network, now_unix_ns - 10**9)
        found: list[tuple[float, int, int, _Meeting, float]] = []
        compared = False
        for a, track in enumerate(of_one):
            t_s = np.linspace(track.t_s[0], track.t_s[-1], SAMPLES)
            bearings = one.bearings_enu(track.at(t_s))
            for b, rival in enumerate(of_other):
                pixels = rival.at(t_s)
                good = np.isfinite(pixels[:, 0]) & np.isfinite(bearings[:, 0])
                if np.count_nonzero(good) < 4:
                    continue
                compared = True
                to = other.bearings_enu(pixels[good])
                meeting, miss, angle = _meet(network, (one.id, other.id), bearings[good], to, t_s[good])
                if meeting is not None:
                    found.append((miss, a, b, meeting, angle))
        found.sort(key=lambda entry: entry[0])
        kept: list[_Meeting] = []
        used: set[tuple[int, int]] = set()
        for miss, a, b, meeting, angle in found:
            if miss < MATCH_SIGMA and (0, a) not in used and (1, b) not in used:
                used |= {(0, a), (1, b)}
                kept.append(meeting)
                self.residual_mrad[pair] = angle * 1e3
        return kept, compared

    # A stored network

    def agrees(self, network: Network, now_unix_ns: int) -> bool | None:
        """Whether rays meet as this network says: True or False once that is clear, None until then."""
        if self._candidate is None or self._candidate[0] is not network:
            self._candidate = (network, None, set())
            self._views = {camera.id: View.of(camera) for camera in network.cameras}
        _, since, agreed = self._candidate
        compared = False
        for pair in self._witnesses([camera.id for camera in network.cameras]):
            meetings, could = self._meetings(network, self._views, pair, now_unix_ns)
            compared |= could
            if meetings:
                agreed.add(pair)
        if compared and since is None:
            self._candidate = (network, now_unix_ns, agreed)
        if len(agreed) >= AGREE_PAIRS:
            self._candidate = None
            return True
        if since is not None and now_unix_ns - since > REFUSE_S * 1e9:
            self._candidate = None
            return False
        return None


def _attitude_sigma(network: Network, camera_id: str) -> float:
    at = POSE_SIZE * [camera.id for camera in network.cameras].index(camera_id)
    return float(np.sqrt(np.max(np.diag(network.covariance)[at : at + 3])))


def _meet(
    network: Network, pair: tuple[str, str], a: Array, b: Array, t_s: Array
) -> tuple[_Meeting | None, float, float]:
    """Where rays a, b (S, 3) of two cameras meet; by how many sigma and rad they miss, median."""
    one, other = network.camera(pair[0]), network.camera(pair[1])
    assert one is not None
    assert other is not None
    base = other.centre_enu - one.centre_enu
    cosine = np.einsum("ni,ni->n", a, b)
    sine2 = np.maximum(1 - cosine**2, 1e-9)
    along_a, along_b = a @ base, b @ base
    range_a, range_b = (along_a - cosine * along_b) / sine2, (cosine * along_a - along_b) / sine2
    if not (np.median(range_a) > 1 and np.median(range_b) > 1 and np.median(sine2) > 1e-4):
        return None, np.inf, np.inf
    on_a, on_b = one.centre_enu + range_a[:, None] * a, other.centre_enu + range_b[:, None] * b
    sigma = [
        np.hypot(NOISE_PX / min(camera.lens.intrinsics[:2]), _attitude_sigma(network, camera.id))
        for camera in (one, other)
    ]
    sigma_m = np.hypot(sigma[0] * range_a, sigma[1] * range_b)
    gap = np.linalg.norm(on_a - on_b, axis=1)
    meeting = _Meeting(t_s, (on_a + on_b) / 2, sigma_m / np.sqrt(sine2))
    return meeting, float(np.median(gap / sigma_m)), float(np.median(gap / np.minimum(range_a, range_b)))

"""What comes from the boxes, judged before anything is computed from it: live, and just so from a recording.

The hazard is the message that is well formed and wrong: a clock years ahead, a lens file of another resolution, two
boxes with one name, stamps that run backwards, a row that was interpolated and not seen. Each is refused, counted
under a name of its own, and shown with what to do; nothing that comes here stops anything else.

Every rule of reading stands here, once. Two things differ between the sources, and both are said when the intake is
made. Rows about the past count for a calibration made afterwards, never for tracking. And a stamp is judged by the
instant at which its frame came; a track folder of other people's, whose cameras may be hours apart, has no arrivals,
so that its stamps have no second witness and the solver's own search for clock offsets is all there is.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from calib.observations import Frame
from calib.station.core.ranges import Ranges
from calib.station.core.sequence import Sequence
from calib.station.core.stream_clock import AHEAD_S, StreamClock
from edge.common.allowances import Allowances
from edge.common.errors import LensError, MessageError
from edge.common.health import Check
from edge.common.units import NS
from edge.gnss.kept_fix import KeptFix
from edge.lens import LensModel
from edge.messages import Detection, Fix, Health, HealthItem, Lens, Tracks, decode

# Of the image's size: half the box of an object that fills a tenth of it, cut by the edge. Farther out the visible part
# says little of the middle, and the lens model was never measured.
OUTSIDE: Final = 0.05
LEADS_S: Final = 0.5  # more than links and buffers of boxes that are alike differ by
FAULT_SHOWN_NS: Final = 10 * NS  # arrival time a fault is shown after it was last seen
PATIENCE_NS: Final = 10 * NS  # after the start, before a camera that was never heard of is an alarm
# Why a message is refused by its numbers alone: name, reason, action.
REFUSED_NUMBERS: Final = {
    "earlier": (
        "twins",
        "two boxes send under this name, or somebody repeats what it said in an earlier start",
        "give each box its own camera id; if they have, its certificate is in wrong hands (base-station certs revoke)",
    ),
    "leapt": (
        "leapt",
        "its numbers leapt farther than a box can count",
        "restart the box; if it goes on, somebody else sends under its name",
    ),
}
MOST_BYTES_HZ: Final = 1.5e6  # of one camera's frames: 100 a second, of FLOOD detections each
BURST_BYTES: Final = 3e6  # what a link held back while it was cut
FLOOD: Final = 60  # detections a frame, on average: more is a detector gone wild, not a sky full of objects

Run = tuple[int | None, int | None]


@dataclass
class CameraIntake:
    """What is known of one camera from its own messages. Times are of the arrival clock unless they say unix."""

    id: str
    lens: LensModel | None = None
    fix: Fix | None = None  # with a sigma that covers what contradicts it
    kept_fix: KeptFix = field(default_factory=KeptFix)
    taken_back: str = ""  # why its box no longer stands by its position; empty while it does
    fix_doubts: int = 0  # how often something spoke against a position
    doubted_by_run: Run | None = None  # the run of its box that doubted a position, until one stands by it again
    health: Health | None = None
    present: bool = False
    size_px: tuple[int, int] | None = None
    readout_s: float | None = None  # None: the box does not know; 0: a global shutter
    clock_bound_s: float | None = None
    last_ns: int | None = None
    last_stamp: int = 0
    sequence: Sequence = field(default_factory=Sequence)
    clock_sets: int = 0  # how often its time went back by more than a jitter
    since: tuple[int, int] = (0, 0)  # epoch and number of the first frame by the clock as it is set now
    numbers: dict[int, Ranges] = field(default_factory=dict)  # those that came, by epoch; only where late rows count
    detections: float = 0.0  # a frame, smoothed
    counters: Counter[str] = field(default_factory=Counter)
    faults: dict[str, tuple[str, str, int]] = field(default_factory=dict)  # name: reason, action, when

    def fault(self, name: str, reason: str, action: str, now_ns: int, count: int = 1) -> None:
        """Note what is wrong with this camera's messages."""
        self.counters[name] += count
        self.faults[name] = (reason, action, now_ns)

    def clock_was_set(self, tracks: Tracks) -> None:
        """Its time went back: what was stamped before, and what comes late of it, is of another clock."""
        self.clock_sets += 1
        self.since = (tracks.epoch, tracks.seq)

    def stand_by(self, fix: Fix) -> None:
        """Take a position that its box stands by.

        One that it doubted before is void if the same run of the box stands by another now: that one has held both
        against each other. A run that began since knows nothing of it, so that it is held against it here.
        """
        if self.doubted_by_run == self.run:
            self.kept_fix.forget()
        self.doubted_by_run = None
        before = self.kept_fix.reason
        self.fix, self.taken_back = self.kept_fix.take(fix), ""
        self.fix_doubts += bool(self.kept_fix.reason) and not before

    def take_back(self, fix: Fix) -> None:
        """Its box no longer stands by its position: one that it doubts is void, one that is in use may stay so."""
        if fix.standing == "doubted":
            self.fix_doubts += self.doubted_by_run is None
            self.fix, self.doubted_by_run = None, self.run
        self.taken_back = fix.why or fix.standing

    @property
    def run(self) -> Run:
        """Which start of its box's program is heard: by its health and by its frames, of which either may be absent."""
        return self.health.epoch if self.health else None, self.epoch

    @property
    def fix_doubt(self) -> str:
        """What speaks against its position; empty if nothing does."""
        if self.taken_back and self.fix is None:
            return f"its box takes its position back ({self.taken_back})"
        return self.kept_fix.reason

    def said_of(self, name: str) -> HealthItem | None:
        """What its box says of one thing; None where it says nothing of it."""
        return next((item for item in self.health.items if item.name == name), None) if self.health else None

    def online(self, now_ns: int, stale_s: float) -> bool:
        """Whether frames come."""
        return self.last_ns is not None and now_ns - self.last_ns < stale_s * NS

    @property
    def epoch(self) -> int | None:
        """The box's present start; None before the first message."""
        return self.sequence.epoch

    @property
    def next_seq(self) -> int:
        """The number expected next."""
        return self.sequence.next_seq

    @property
    def flooded(self) -> bool:
        """Whether its detector reports more than any sky holds."""
        return self.detections > FLOOD


class Intake:
    """All cameras of a site, and the strangers that claim to be.

    late_rows_count: whether a row about a frame that is past is a measurement: for `solve`, never live.
    arrivals_are_real: whether now_ns is when a message came, and so a witness for its stamp.
    """

    def __init__(
        self,
        cameras: Iterable[str],
        where: str = "base.toml",
        *,
        late_rows_count: bool = False,
        arrivals_are_real: bool = True,
    ) -> None:
        self.cameras = {camera: CameraIntake(camera) for camera in cameras}
        self.clock = StreamClock()
        self.strangers: Counter[str] = Counter()
        # A flood of one camera must not cost the others, so what is beyond is not even decoded.
        self._bytes = Allowances(MOST_BYTES_HZ, BURST_BYTES)
        self._where = where
        self._late_rows_count = late_rows_count
        self._arrivals_are_real = arrivals_are_real
        self._began_ns: int | None = None

    def known(self, camera: str) -> CameraIntake | None:
        """The camera of that name; a stranger is counted."""
        found = self.cameras.get(camera)
        if found is None and (camera in self.strangers or len(self.strangers) < 64):
            self.strangers[camera] += 1
        return found

    def frame(self, camera: CameraIntake, payload: bytes, now_ns: int) -> Frame | None:
        """A frame's measurements, or None if it is refused."""
        if self._arrivals_are_real and not self._bytes.take(camera.id, now_ns * 1e-9, len(payload)):
            fault = f"it sends more than {MOST_BYTES_HZ / 1e6:g} MB a second; the rest is left out"
            camera.fault("too_much", fault, "look at its picture and detector; restart the box", now_ns)
            return None
        tracks = self._tracks(camera, payload, now_ns)
        if tracks is None or not self._accepted(camera, tracks, now_ns):
            return None
        if tracks.late:
            return self._late_frame(camera, tracks, now_ns)
        camera.last_ns, camera.last_stamp = now_ns, tracks.t_unix_ns
        camera.size_px, camera.readout_s, camera.clock_bound_s = tracks.size_px, tracks.readout_s, tracks.clock_bound_s
        camera.detections += (len(tracks.detections) - camera.detections) / 30
        return self._measurements(camera, tracks, now_ns)

    def backlog(self, camera: CameraIntake, payload: bytes, now_ns: int) -> Frame | None:
        """A frame that the link lost and its box said again when asked, or None if it is refused."""
        tracks = self._tracks(camera, payload, now_ns)
        if tracks is None:
            return None
        number = (tracks.epoch, tracks.seq)
        if number < camera.since:
            action = "nothing: rows by two clocks cannot be used together"
            camera.fault("other_clock", "rows from before its clock was set came late", action, now_ns)
            return None
        if tracks.seq in camera.numbers.get(tracks.epoch, ()):
            camera.counters["repeated"] += 1
            return None
        return self._late_frame(camera, tracks, now_ns)

    def _tracks(self, camera: CameraIntake, payload: bytes, now_ns: int) -> Tracks | None:
        try:
            return decode(payload, Tracks, where=camera.id)
        except MessageError as error:
            camera.fault("undecodable", error.what, error.action, now_ns)
            return None

    def _late_frame(self, camera: CameraIntake, tracks: Tracks, now_ns: int) -> Frame | None:
        """A frame that is past. It may lie anywhere in the past, and nowhere else."""
        camera.counters["late"] += 1
        if not self._late_rows_count or self._off(
            camera, self._ahead_s(camera, tracks.t_unix_ns, now_ns), now_ns, behind_too=False
        ):
            return None
        self._count(camera, tracks)
        return self._measurements(camera, tracks, now_ns)

    def _count(self, camera: CameraIntake, tracks: Tracks) -> None:
        if self._late_rows_count:
            camera.numbers.setdefault(tracks.epoch, Ranges()).add(tracks.seq, tracks.seq)

    def _accepted(self, camera: CameraIntake, tracks: Tracks, now_ns: int) -> bool:
        """Whether a message is this camera's next one; only then does anything that is known of the camera move."""
        verdict = camera.sequence.judge(tracks.epoch, tracks.seq, now_ns)
        if verdict == "repeated":
            camera.counters["repeated"] += 1
            return False
        if verdict in ("earlier", "leapt"):
            camera.fault(*REFUSED_NUMBERS[verdict], now_ns)
            return False
        if not (tracks.late or self._timely(camera, tracks.t_unix_ns, now_ns, behind_too=verdict == "start")):
            return False
        camera.counters["missed"] += camera.sequence.take(tracks.epoch, tracks.seq, now_ns)
        self._count(camera, tracks)
        if verdict == "start":
            camera.counters["starts"] += 1
            if tracks.t_unix_ns <= camera.last_stamp:
                camera.clock_was_set(tracks)
            camera.last_stamp = 0
        return tracks.late or self._onward(camera, tracks, now_ns)

    def _timely(self, camera: CameraIntake, t_unix_ns: int, now_ns: int, *, behind_too: bool) -> bool:
        """Whether a stamp goes with the other cameras'. behind_too: a start has no stamps of its own to go on from."""
        ahead_s = self._ahead_s(camera, t_unix_ns, now_ns)
        if self._off(camera, ahead_s, now_ns, behind_too=behind_too):
            camera.last_ns = now_ns
            return False
        if ahead_s > LEADS_S and self._online(now_ns, but=camera) >= 2:
            fault = f"its frames are stamped {ahead_s:.1f} s ahead of the other cameras'"
            action = "compare the boxes' clocks (edge-node check); if they agree, the others' pictures come late"
            camera.fault("leads", fault, action, now_ns)
        self.clock.add(camera.id, t_unix_ns, now_ns)
        return True

    def _ahead_s(self, camera: CameraIntake, t_unix_ns: int, now_ns: int) -> float:
        return self.clock.ahead_s(camera.id, t_unix_ns, now_ns) if self._arrivals_are_real else 0.0

    def _off(self, camera: CameraIntake, ahead_s: float, now_ns: int, *, behind_too: bool) -> bool:
        """Whether a stamp contradicts the others by the arrival clock; of two alone, either might be wrong."""
        off = ahead_s > AHEAD_S or (behind_too and ahead_s < -AHEAD_S)
        if not off or self._online(now_ns, but=camera) < 2:
            return False
        if ahead_s > 0:
            name, fault = "future", f"its times are {ahead_s:.1f} s in the future of the other cameras'"
        else:
            name, fault = "past", f"its times are {-ahead_s:.1f} s behind the other cameras'"
        camera.fault(name, fault, "set the box's clock (chrony); its frames are left out", now_ns)
        return True

    def _online(self, now_ns: int, but: CameraIntake) -> int:
        return sum(other.online(now_ns, 5.0) for other in self.cameras.values() if other is not but)

    def _onward(self, camera: CameraIntake, tracks: Tracks, now_ns: int) -> bool:
        """Whether a camera's time goes on; set back by far, it goes on from there, and is counted."""
        if tracks.t_unix_ns > camera.last_stamp:
            return True
        back_s = (camera.last_stamp - tracks.t_unix_ns) / NS
        camera.fault("backwards", f"its time went back {back_s:.3f} s", "look at the box's clock (chrony)", now_ns)
        if back_s < AHEAD_S:
            return False
        camera.clock_was_set(tracks)  # the calibration will say by how much
        return True

    def _measurements(self, camera: CameraIntake, tracks: Tracks, now_ns: int) -> Frame | None:
        if camera.lens is not None and camera.lens.size_px != tracks.size_px:
            fault = f"frames are {_size(tracks.size_px)}, the lens file is for {_size(camera.lens.size_px)}"
            camera.fault("lens_size", fault, "give the box the lens file of this resolution", now_ns)
            return None
        confirmed = [d for d in tracks.detections if d.status == "confirmed"]
        camera.counters["interpolated"] += len(tracks.detections) - len(confirmed)
        kept = [d for d in confirmed if _inside(d, tracks.size_px)]
        if len(kept) < len(confirmed):
            first = next(d for d in confirmed if not _inside(d, tracks.size_px))
            fault = f"pixel ({first.u_px:.0f}, {first.v_px:.0f}) lies outside its {_size(tracks.size_px)} image"
            action = "check the box's detector and resolution; such rows are dropped"
            camera.fault("absurd_pixel", fault, action, now_ns, len(confirmed) - len(kept))
        # One array of all, for every frame comes through here: many small ones cost more than all the rules above. A
        # box without a size is one that nobody measured: a track folder has points.
        rows = np.array(
            [(d.u_px, d.v_px, np.nan if d.sigma_px is None else d.sigma_px, d.width_px or np.nan) for d in kept], float
        )
        rows = rows.reshape(-1, 4)
        label = np.array([d.track for d in kept], np.int64)
        return Frame(camera.id, tracks.t_unix_ns, rows[:, :2], label, rows[:, 2], rows[:, 3])

    def lens(self, camera: CameraIntake, payload: bytes, now_ns: int) -> bool:
        """Take a lens; whether what the camera saw before was through another."""
        try:
            lens = LensModel.of(decode(payload, Lens, where=camera.id))
        except (MessageError, LensError) as error:
            camera.fault("lens", error.what, "check the box's lens file", now_ns)
            return False
        before, camera.lens = camera.lens, lens
        return camera.size_px not in (None, lens.size_px) if before is None else before != lens

    def fix(self, camera: CameraIntake, payload: bytes, now_ns: int) -> None:
        """Take an antenna position. Only a fixed RTK solution (4) says where a tripod is."""
        try:
            fix = decode(payload, Fix, where=camera.id)
        except MessageError as error:
            camera.fault("undecodable", error.what, error.action, now_ns)
            return
        if fix.standing != "held":
            camera.take_back(fix)
            action = "see the box's receiver: edge-node check there says what it lacks"
            camera.fault("taken_back", f"its box no longer stands by its position ({fix.why})", action, now_ns)
            return
        if fix.quality != 4:
            fault = f"its receiver has quality {fix.quality}, not 4 (RTK fixed)"
            camera.fault("fix_quality", fault, "wait for corrections, look at the antenna's sky", now_ns)
            return
        camera.stand_by(fix)

    def health(self, camera: CameraIntake, payload: bytes, now_ns: int) -> None:
        """Take a box's own health."""
        try:
            camera.health = decode(payload, Health, where=camera.id)
        except MessageError as error:
            camera.fault("undecodable", error.what, error.action, now_ns)

    def checks(self, now_ns: int, stale_s: float) -> list[Check]:
        """How each camera's messages are, as of now."""
        self._began_ns = now_ns if self._began_ns is None else self._began_ns
        checks = [self._check(camera, now_ns, stale_s) for camera in self.cameras.values()]
        for stranger, count in self.strangers.items():
            reason = f"{count} messages from a camera that is not configured"
            action = f'add [[camera]] id = "{stranger}" to {self._where}, or correct the box\'s camera id'
            checks.append(Check(f"camera {stranger}", "warn", reason, action))
        return checks

    def _check(self, camera: CameraIntake, now_ns: int, stale_s: float) -> Check:
        name = f"camera {camera.id}"
        if not camera.online(now_ns, stale_s):
            return self._silence(name, camera, now_ns)
        recent = [(r, a) for r, a, when in camera.faults.values() if now_ns - when < FAULT_SHOWN_NS]
        if recent:
            return Check(name, "warn", *recent[-1])
        if camera.lens is None:
            return Check(name, "warn", "its lens is not known", "give the box a lens file (edge-node lens)")
        if camera.flooded:
            return Check(
                name, "warn", f"{camera.detections:.0f} detections a frame", "look at its picture and detector"
            )
        return Check(name, "ok", "sends frames")

    def _silence(self, name: str, camera: CameraIntake, now_ns: int) -> Check:
        if camera.last_ns is not None:
            silent_s = (now_ns - camera.last_ns) / NS
            return Check(name, "fail", f"last frame {silent_s:.0f} s ago", "look at its box, camera and link")
        if now_ns - (self._began_ns or now_ns) < PATIENCE_NS:
            return Check(name, "ok", "not heard of yet")
        there = "is there but sends no frames" if camera.present else "was never heard of"
        return Check(name, "fail", there, "start its box, check its link and site name")


def _inside(detection: Detection, size_px: tuple[int, int]) -> bool:
    """Whether a pixel lies in its image, or no farther out than a box may reach over the edge."""
    width, height = size_px
    return (
        -OUTSIDE * width <= detection.u_px <= (1 + OUTSIDE) * width
        and -OUTSIDE * height <= detection.v_px <= (1 + OUTSIDE) * height
    )


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"

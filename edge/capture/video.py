"""A video file as a source.

No frame of a recording is ever dropped here, and every stamp follows from the file alone, so that the same file gives
the same tracks. The hazard is the end that is none: a decoder that gives up in the damaged middle of a file says what
it says at the end. So it is asked again, what was lost is told, and the file's length is held against what came.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2

from edge.capture.decoding import DEEP_GREY_ARGS, TRIED_GRABS, fourcc, opened, picture_at, probe, retrieve_luma
from edge.capture.file_times import RATES_ALIKE, FileTimes, carry_times, has_no_container, usual_interval_s
from edge.capture.frame import Image, Picture, Remark
from edge.capture.grey import Contrast, as_wanted
from edge.capture.packets import PacketWitness
from edge.capture.standing_still import Repeats, looks_same
from edge.common.errors import SourceError

log = logging.getLogger(__name__)

UNDATED_FPS: Final = 1.0  # where times do not matter
SHORT_END_S: Final = 1.0  # s by which a file may end before its own length without a word: audio runs on
SHORT_END_SHARE: Final = 0.02  # and this share of its length
DOUBTED_REPEATS: Final = 2  # pictures equal to the one before that are decoded again by themselves, early in a file
DOUBTED_WITHIN: Final = 150  # frames: decoding up to a later one would take too long
STANDS_STILL: Final = "are the one before again"
# What is left out, and what to do. A decoder that gives up on interlaced video leaves the last picture as it was.
LEFT_OUT_ACTION: Final = (
    "its recorder hung or began anew there: give each part its own file, and its own lens if the size is another; if it"
    " is interlaced: ffmpeg -i FILE -vf yadif -c:v libx264 -crf 14 NEW.mp4"
)


class VideoFile:
    """A video file, from its first frame to its last, or over and over with `loop`.

    t0_unix_ns: the first frame's stamp. fps: only for files whose own times are missing. Raises SourceError if it does
    not open, or what it holds cannot be decoded or dated.
    """

    live = False
    skipped = 0

    def __init__(
        self,
        path: str,
        *,
        t0_unix_ns: int,
        bound_s: float | None,
        colour: bool = False,
        fps: float | None = None,
        loop: bool = False,
        dated: bool = True,
        remarks: Sequence[Remark] = (),
    ) -> None:
        """dated: False where only the order of the pictures matters. remarks: those to begin with."""
        self._path = path
        self._bound_s = bound_s
        self._colour = colour
        self._loop = loop
        self._segment = 0
        self._remarks: list[Remark] = list(remarks)
        self._probe = probe(path, colour=colour)
        self._raw = self._probe.luma or self._probe.deep
        self._stretch = Contrast()
        self._counts = False  # whether it says how many frames it has, and dates them by counting
        self._fps = self._rate(fps) if dated else UNDATED_FPS
        if self._probe.cut:
            said = "its pictures fill hardly any of 256 grey levels: what they have beyond eight bits is cut"
            self._remark(said, f"convert it: ffmpeg -i FILE {DEEP_GREY_ARGS} NEW.mkv")
        self._begin(t0_unix_ns)

    def _rate(self, fps: float | None) -> float | None:
        """The frame rate to count by; None where the file's own times are to be believed, whatever rate was given."""
        with Path(self._path).open("rb") as file:
            head = file.read(12)
        bare = has_no_container(head)
        self._counts = head.startswith(b"RIFF") and head.endswith(b"AVI ")
        own_s = usual_interval_s(self._probe.first_ms)
        if bare or not carry_times(self._probe.first_ms):
            if fps is None:
                raise SourceError(
                    "its frames carry no times", where=self._path, action="set source.fps to its frame rate"
                )
            return fps
        if fps is not None and own_s is not None and abs(fps * own_s - 1) > RATES_ALIKE:
            said = f"source.fps is {fps:g}, its own times say {1 / own_s:.4g} frames a second: its own are used"
            self._remark(said, "leave source.fps out, or write the right times into the file")
        return None

    def _begin(self, t0_unix_ns: int) -> None:
        self._capture = opened(self._path)
        self._packets = PacketWitness(self._path)
        self._stills = Repeats()
        self._unfit = ""
        self._left_out: dict[str, tuple[int, float]] = {}  # why: how many pictures, and from which second on
        if self._raw:
            self._capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        self._times = FileTimes(self._fps, usual_interval_s(self._probe.first_ms), self._length_s())
        self._end_ms = 0.0
        self._t0_unix_ns = t0_unix_ns
        self._last_pts: float | None = None
        self._lost = 0
        self._repeats = 0

    @property
    def frames_said(self) -> int:
        """How many frames the file says it has; 0 where it does not."""
        return max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)))

    @property
    def remarks(self) -> list[Remark]:
        """What is to be known of the file: how its times are, what of it is damaged."""
        return list(self._remarks)

    def _remark(self, what: str, action: str) -> None:
        remark = Remark(what, action)
        if remark not in self._remarks:
            self._remarks.append(remark)
            log.warning("%s: %s; %s", self._path, what, action)

    def read(self) -> Picture | None:
        """The next frame that can be decoded; None at the end."""
        while (t_unix_ns := self.grab()) is not None:
            if (picture := self.retrieve(t_unix_ns)) is not None:
                return picture
        return None

    def grab(self) -> int | None:
        """Go to the next frame and return its stamp, without paying for its pixels; None at the end."""
        if not self._grab_next():
            if self._times.count == 0:
                raise self._nothing_decodes()
            self._say_how_it_ended()
            if not self._loop:
                return None
            self._segment += 1
            self.close()
            self._begin(self._t0_unix_ns + self._times.next_ns)
            return self.grab()
        at_ms, pts = self._capture.get(cv2.CAP_PROP_POS_MSEC), self._capture.get(cv2.CAP_PROP_PTS)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self._end_ms = max(self._end_ms, at_ms, pts / rate * 1e3 if rate > 0 else 0.0)
        known = not (at_ms == 0.0 and pts == self._last_pts)  # 0 is also what a frame without a time has
        self._last_pts = pts
        self._unfit = self._packets.why_not(pts)
        breaks = len(self._times.breaks)
        t_unix_ns = self._t0_unix_ns + self._times.next(at_ms, known=known)
        if len(self._times.breaks) > breaks:
            self._say_break()
        if self._times.count == 1 and self._times.late_s:
            said = f"its first {self._times.late_s:.1f} s do not decode: its first picture is dated so much later"
            self._remark(said, "begin recordings with a key frame")
        return t_unix_ns

    def _grab_next(self) -> bool:
        for failed in range(TRIED_GRABS):
            if self._capture.grab():
                self._lost += failed
                return True
        return False

    def _nothing_decodes(self) -> SourceError:
        codec = fourcc(self._capture)
        action = "convert it: ffmpeg -i FILE -c:v libx264 -crf 14 NEW.mp4"
        return SourceError(
            f"holds no frame that can be decoded (its codec is {codec})", where=self._path, action=action
        )

    def _say_break(self) -> None:
        was_s, is_s = self._times.breaks[-1]
        how = "goes on from there" if is_s < was_s else "is kept"
        said = (
            f"its times go from {was_s:.2f} s to {is_s:.2f} s at frame {self._times.count}: time {how}, without a bound"
        )
        self._remark(said, "cut the file there and give each part its own source.t0_unix_ns")

    def _say_how_it_ended(self) -> None:
        """What is missing, by what failed to decode, by gaps in the times and by the length the file says it has."""
        lost, gaps = self._lost, self._times.gaps
        said = [f"{lost} of about {self._times.count + lost} frames could not be decoded"] if lost else []
        missing = self.frames_said - self._times.count - lost
        if self._counts and missing > max(2, SHORT_END_SHARE * self.frames_said):
            said.append(f"{missing} of the {self.frames_said} frames that it says it has are not there: times are off")
        if gaps:
            longest = max(gaps, key=lambda gap: gap[1] - gap[0])
            total_s = sum(end - begin for begin, end in gaps)
            said.append(f"{total_s:.1f} s are missing in {len(gaps)} gaps, the longest at {longest[0]:.1f} s")
        length_s, end_s = self._times.length_s, max(self._end_ms / 1e3, self._times.next_ns / 1e9)
        if self._fps is None and length_s - end_s > max(SHORT_END_S, SHORT_END_SHARE * length_s):
            said.append(f"it ends at {end_s:.1f} s of the {length_s:.1f} s that it says it has")
        for why, (count, first_s) in self._left_out.items():
            self._remark(f"{count} pictures from {first_s:.1f} s on {why}: they are left out", LEFT_OUT_ACTION)
        if said:
            self._remark("; ".join(said), "it is damaged or was cut: take another copy")

    def _length_s(self) -> float:
        frames, rate = self._capture.get(cv2.CAP_PROP_FRAME_COUNT), self._capture.get(cv2.CAP_PROP_FPS)
        return frames / rate if frames > 0 and rate > 0 else 0.0

    def retrieve(self, t_unix_ns: int) -> Picture | None:
        """The frame last grabbed; None where it cannot be decoded."""
        if self._unfit:
            self._leave_out(self._unfit, t_unix_ns)
            return None
        ok, image = retrieve_luma(self._capture) if self._raw else self._capture.retrieve()
        if not ok:
            self._lost += 1
            return None
        self._doubt_repeats(image)
        if self._stills.goes_on(image):
            self._leave_out(STANDS_STILL, t_unix_ns)
            return None
        bound_s = self._bound_s if self._times.bounded else None
        return Picture(t_unix_ns, self._eight_bits(image), "file", bound_s, self._segment)

    def _leave_out(self, why: str, t_unix_ns: int) -> None:
        count, first_s = self._left_out.get(why, (0, (t_unix_ns - self._t0_unix_ns) / 1e9))
        self._left_out[why] = count + 1, first_s

    def _eight_bits(self, image: Any) -> Image:
        return as_wanted(self._stretch.apply(image) if self._probe.deep else image, colour=self._colour)

    def _doubt_repeats(self, image: Image) -> None:
        """A picture equal to the last may be one that the decoder left as it was: see whether it decodes by itself."""
        index = self._times.count - 1
        if index > DOUBTED_WITHIN or self._repeats >= DOUBTED_REPEATS:
            return
        if looks_same(self._stills.last, image):
            self._repeats += 1
            picture_at(self._path, index, luma=self._raw)

    def close(self) -> None:
        """Close the file."""
        self._capture.release()
        self._packets.close()

"""A camera of this box, through V4L2: asked for what the configuration says, and held to it.

Two hazards. A driver takes every setting and does what it likes: another format, five frames a second where thirty were
asked for, an exposure of its own. So what it was told is read back, the rate is counted, and what it does not obey is
said. And one that hands out the same picture again, with a new stamp, shows where things were and not where they are:
such pictures are passed over (standing_still.py).
"""

import time
from collections.abc import Callable
from typing import Any, Final

import cv2

from edge.capture.frame import AS_STAMPED, Picture, Remark, StampRule
from edge.capture.grabber import Grabber, dead
from edge.capture.grey import Contrast, as_wanted
from edge.capture.stamps import ARRIVAL_BOUND_S, MONOTONIC_PLAUSIBLE_S, SENSOR_BOUND_S
from edge.capture.standing_still import StandingStill
from edge.capture.wish import OBEYED, CameraWish
from edge.common.errors import SourceError
from edge.common.utc import Dated

MANUAL_EXPOSURE: Final = 1  # V4L2_EXPOSURE_MANUAL
EXPOSURE_UNIT_S: Final = 1e-4  # of V4L2_CID_EXPOSURE_ABSOLUTE
COUNTED_FRAMES: Final = 60  # over which the rate is counted
SLOWER: Final = 0.7  # of the rate asked for, that is said
DEEP_FORMATS: Final = frozenset({"Y16 ", "Y16", "Y14 ", "Y12 ", "Y10 "})  # grey of more than eight bits a pixel


class V4l2Camera:
    """A camera of this box. Driver stamps are CLOCK_MONOTONIC at an instant by `rule`; else arrival counts.

    date: UTC of a monotonic stamp. remarks: what it did not obey.
    """

    live = True
    skipped = 0

    def __init__(
        self,
        capture: Grabber,
        path: str,
        *,
        colour: bool,
        rule: StampRule = AS_STAMPED,
        fps: float | None = None,
        remarks: tuple[Remark, ...] = (),
        date: Callable[[int], Dated],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """fps: the rate that was asked for."""
        self._capture = capture
        self._path = path
        self._colour = colour
        self._rule = rule
        self._fps = fps
        self._said = remarks
        self._date = date
        self._monotonic_ns = monotonic_ns
        self._stretch = Contrast()
        self._still = StandingStill(path)
        self._frames, self._first_ns, self._last_ns = 0, 0, 0

    @property
    def remarks(self) -> list[Remark]:
        """What it was asked for and does not do."""
        return [*self._said, *self._slow()]

    def read(self) -> Picture | None:
        """The next frame. Raises SourceError when the camera is dead."""
        while True:
            if not self._capture.grab():
                raise dead(self._path)
            arrival_ns = self._monotonic_ns()
            stamp_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            ok, image = self._capture.retrieve()
            if not ok:
                raise dead(self._path)
            self._count(arrival_ns)
            if not self._still.repeats(image, arrival_ns):
                return self._picture(image, arrival_ns, stamp_ns)

    def _picture(self, image: Any, arrival_ns: int, stamp_ns: int) -> Picture:
        stamped = 0 <= arrival_ns - stamp_ns < MONOTONIC_PLAUSIBLE_S * 1e9
        monotonic_ns = stamp_ns if stamped else arrival_ns
        dated = self._date(monotonic_ns)
        return Picture(
            self._rule.middle_ns(dated.t_unix_ns),
            as_wanted(self._stretch.apply(image), colour=self._colour),
            "sensor" if stamped else "arrival",
            (SENSOR_BOUND_S if stamped else ARRIVAL_BOUND_S) + dated.doubt_s,
        )

    def _count(self, arrival_ns: int) -> None:
        if self._frames == 0:
            self._first_ns = arrival_ns
        self._frames += 1
        self._last_ns = arrival_ns

    def _slow(self) -> list[Remark]:
        passed_s = (self._last_ns - self._first_ns) / 1e9
        if self._fps is None or self._frames < COUNTED_FRAMES or passed_s <= 0:
            return []
        rate = (self._frames - 1) / passed_s
        if rate >= SLOWER * self._fps:
            return []
        action = "set source.pixel_format, a shorter exposure or a smaller size; look at the cable: USB 2 carries less"
        return [Remark(f"{self._fps:g} frames a second were asked for, {rate:.1f} come", action)]

    def close(self) -> None:
        """Let go of the device."""
        self._capture.release()


def open_v4l2(path: str, wish: CameraWish, timeout_s: float) -> tuple[cv2.VideoCapture, tuple[Remark, ...]]:
    """A camera device, asked for what is wished; and what it does instead. Raises SourceError if it does not open."""
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2, [cv2.CAP_PROP_READ_TIMEOUT_MSEC, round(timeout_s * 1e3)])
    if not capture.isOpened():
        action = "check the cable, `ls /dev/video*`, and that this user is in the group video"
        raise SourceError("the camera does not open", where=path, action=action)
    remarks = ask(capture, wish)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)  # one to fill, one to read: more is only delay
    return capture, tuple(remarks)


def ask(capture: Grabber, wish: CameraWish) -> list[Remark]:
    """Ask a camera for what is wished, and what it does instead."""
    if wish.pixel_format:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*wish.pixel_format))
    if wish.size_px:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, wish.size_px[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, wish.size_px[1])
    if wish.fps:
        capture.set(cv2.CAP_PROP_FPS, wish.fps)
    if wish.exposure_s:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
        capture.set(cv2.CAP_PROP_EXPOSURE, round(wish.exposure_s / EXPOSURE_UNIT_S))
    if wish.gain is not None:
        capture.set(cv2.CAP_PROP_GAIN, wish.gain)
    if four_letters(capture) in DEEP_FORMATS:  # as it is, for OpenCV would cut it to its upper eight bits
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return disobeyed(capture, wish)


def disobeyed(capture: Grabber, wish: CameraWish) -> list[Remark]:
    """What a camera does instead of what it was asked for, by what it says itself."""
    found = []
    form = four_letters(capture)
    if wish.pixel_format and form.strip() != wish.pixel_format.strip():
        found.append(Remark(f"{wish.pixel_format} was asked for, it gives {form or 'another format'}", LIST_FORMATS))
    size = tuple(round(capture.get(prop)) for prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if wish.size_px and size != tuple(wish.size_px):
        asked = f"{wish.size_px[0]} x {wish.size_px[1]}"
        found.append(Remark(f"{asked} was asked for, it gives {size[0]} x {size[1]}", LIST_FORMATS))
    fps = capture.get(cv2.CAP_PROP_FPS)
    if wish.fps and fps > 0 and abs(fps / wish.fps - 1) > OBEYED:
        found.append(Remark(f"{wish.fps:g} frames a second were asked for, it is set to {fps:g}", LIST_FORMATS))
    exposure_s = capture.get(cv2.CAP_PROP_EXPOSURE) * EXPOSURE_UNIT_S
    if wish.exposure_s and abs(exposure_s / wish.exposure_s - 1) > OBEYED:
        said = f"an exposure of {wish.exposure_s * 1e3:g} ms was asked for, it has {exposure_s * 1e3:g} ms"
        found.append(Remark(said, LIST_CONTROLS))
    gain = capture.get(cv2.CAP_PROP_GAIN)
    if wish.gain is not None and abs(gain - wish.gain) > OBEYED * max(1.0, abs(wish.gain)):
        found.append(Remark(f"a gain of {wish.gain:g} was asked for, it has {gain:g}", LIST_CONTROLS))
    return found


def four_letters(capture: Grabber) -> str:
    """The code of the format that a camera gives; empty where it does not say."""
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    return code.to_bytes(4, "little").decode("ascii", "replace") if code > 0 else ""


LIST_FORMATS: Final = "choose one that the driver has: v4l2-ctl (of v4l-utils) lists them"
LIST_CONTROLS: Final = "choose one that the driver has: v4l2-ctl (of v4l-utils) lists its controls"

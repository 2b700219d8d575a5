"""Recorded sources: a video file, and a folder of images that may still be growing.

No frame of a recording is ever dropped here, and every stamp follows from the file alone, so that the same file gives
the same tracks. Only the luma plane is decoded where that is all the detector needs: it saves a third of the work.
"""

import itertools
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2

from edge.capture.frame import Image, Picture
from edge.common.errors import SourceError

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
STANDING_FRAMES: Final = 3  # frames with one time: an index is missing, and the rest will be the same
FOLLOW_POLL_S: Final = 0.2  # how often a growing folder is looked at
_UNIX_NS_IN_NAME: Final = re.compile(r"(?<!\d)(1\d{18})(?!\d)")  # 2001 to 2033, as image loggers name files


def grey(image: Image) -> Image:
    """The image `(H, W)`, whatever it was."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


class VideoFile:
    """A video file, from its first frame to its last, or over and over with `loop`.

    t0_unix_ns: the first frame's stamp. fps: only for files whose own times are missing. Raises SourceError if it does
    not open.
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
    ) -> None:
        self._path = path
        self._bound_s = bound_s
        self._colour = colour
        self._fps = fps
        self._loop = loop
        self._segment = 0
        self._rewind(t0_unix_ns)

    def _rewind(self, t0_unix_ns: int) -> None:
        self._capture = open_video(self._path, colour=self._colour)
        self._t0_unix_ns = self._t_unix_ns = t0_unix_ns
        self._interval_ns = 0
        self._count = 0
        self._first_ms = 0.0

    def read(self) -> Picture | None:
        """The next frame; None at the end."""
        t_unix_ns = self.grab()
        return None if t_unix_ns is None else self.retrieve(t_unix_ns)

    def grab(self) -> int | None:
        """Go to the next frame and return its stamp, without paying for its pixels; None at the end."""
        if not self._capture.grab():
            if self._count == 0:
                raise SourceError("holds no frame that can be decoded", where=self._path, action="play it to check it")
            if not self._loop:
                return None
            self._segment += 1
            self._rewind(self._t_unix_ns + self._interval_ns)
            return self.grab()
        at_ms = self._capture.get(cv2.CAP_PROP_POS_MSEC) if self._fps is None else self._count / self._fps * 1e3
        if self._count == 0:
            self._first_ms = at_ms
        if self._count == STANDING_FRAMES and at_ms <= self._first_ms:
            raise SourceError("its frames carry no times", where=self._path, action="set source.fps to its frame rate")
        t_unix_ns = self._t0_unix_ns + round((at_ms - self._first_ms) * 1e6)
        self._interval_ns, self._t_unix_ns = t_unix_ns - self._t_unix_ns, t_unix_ns
        self._count += 1
        return t_unix_ns

    def retrieve(self, t_unix_ns: int) -> Picture | None:
        """The frame last grabbed; None where it cannot be decoded, as at the end of a file that was cut off."""
        ok, image = self._capture.retrieve()
        if not ok:
            return None
        return Picture(t_unix_ns, image if self._colour else grey(image), "file", self._bound_s, self._segment)

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


def open_video(path: str, *, colour: bool) -> cv2.VideoCapture:
    """An opened capture of a file, single-threaded, in luma if that is all that is wanted. Raises SourceError."""
    if not Path(path).is_file():
        raise SourceError("no such file", where=path, action="give the path of a video file")
    # One decoding thread: two cost more CPU in all, and the box has other cameras.
    capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise SourceError("is no video that can be opened", where=path, action="play it to check it, or convert it")
    if not colour:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return capture


class ImageFolder:
    """A folder of images in the order of their names. An image whose name holds a nanosecond UTC stamp has that time;
    others are 1/fps apart from t0_unix_ns. With `follow` it waits for more until `stop` is set."""

    skipped = 0

    def __init__(
        self,
        path: str,
        *,
        t0_unix_ns: int,
        bound_s: float | None,
        fps: float,
        follow: bool = False,
        colour: bool = False,
        stop: threading.Event | None = None,
    ) -> None:
        self.live = False
        self._folder = Path(path)
        if not self._folder.is_dir():
            raise SourceError("no such folder", where=path, action="give the path of a folder of images")
        self._t0_unix_ns = t0_unix_ns
        self._bound_s = bound_s
        self._fps = fps
        self._flag = cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE
        self._stop = stop or threading.Event()
        self._files = self._follow() if follow else iter(self._names(""))
        self._count = itertools.count()

    def read(self) -> Picture | None:
        """The next image; None at the end. Raises SourceError for a file that is no image."""
        file = next(self._files, None)
        if file is None:
            return None
        image = cv2.imread(str(file), self._flag)
        if image is None:
            raise SourceError("is no image that can be read", where=str(file), action="remove it from the folder")
        return Picture(self._stamp(file, next(self._count)), image, "file", self._bound_s)

    def _stamp(self, file: Path, index: int) -> int:
        named = _UNIX_NS_IN_NAME.search(file.stem)
        return int(named[1]) if named else self._t0_unix_ns + round(index / self._fps * 1e9)

    def _names(self, after: str) -> list[Path]:
        return sorted(
            file for file in self._folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES and file.name > after
        )

    def _follow(self) -> Iterator[Path]:
        """All images but the last, which may still be written to, until a later one appears."""
        last = ""
        while not self._stop.is_set():
            names = self._names(last)
            for file in names[:-1]:
                last = file.name
                yield file
            if len(names) <= 1:
                self._stop.wait(FOLLOW_POLL_S)
        yield from self._names(last)

    def close(self) -> None:
        """Stop waiting for more."""
        self._stop.set()

"""A folder of images as a source, which may still be growing."""

import itertools
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2

from edge.capture.frame import Picture, Remark
from edge.common.errors import SourceError

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
FOLLOW_POLL_S: Final = 0.2  # how often a growing folder is looked at
_UNIX_NS_IN_NAME: Final = re.compile(r"(?<!\d)(1\d{18})(?!\d)")  # 2001 to 2033, as image loggers name files


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

    @property
    def remarks(self) -> list[Remark]:
        """What is to be known of the folder."""
        return []

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

"""A folder of images as a source, which may still be growing.

The hazard is the picture that is not whole: the one that is being written, the one that was being written when the
power went. It decodes, half of it grey. So a picture without its end is left out and counted, and so is what is none or
has a name of another kind; and a folder that goes away while it is read is an error, not an end.
"""

import logging
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.address import shown
from edge.capture.frame import Picture, Remark
from edge.capture.grey import Contrast
from edge.capture.picture_names import NameTimes, natural, understand
from edge.common.errors import SourceError

log = logging.getLogger(__name__)

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
FOLLOW_POLL_S: Final = 0.2  # how often a growing folder is looked at
ENDS: Final = {".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9", ".png": b"IEND"}  # what a whole picture has towards its end
JPEG_SCAN: Final = b"\xff\xda"  # after the last of these comes the picture itself; a thumbnail lies before
CUT_OFF: Final = "cut off or no pictures"
STRANGE_NAME: Final = "named without the time of others"
# Why files are left out, and what to do about it.
LEFT_OUT: Final = {
    CUT_OFF: "have each written under another name and renamed when whole",
    STRANGE_NAME: "name them as the others are, or keep them in another folder",
}
FOLDER_FPS: Final = 30.0  # where neither names nor anybody says how many a second: pictures need some time to be shown


class ImageFolder:
    """A folder of images in natural order of their names, dated by them where they hold UNIX times or dates.

    Others are 1/fps a number apart from t0_unix_ns. With `follow` it waits for more until `stop` is set.
    """

    skipped = 0

    def __init__(
        self,
        path: str,
        *,
        t0_unix_ns: int,
        bound_s: float | None,
        fps: float | None,
        follow: bool = False,
        loop: bool = False,
        colour: bool = False,
        stop: threading.Event | None = None,
    ) -> None:
        """Raises SourceError if there is no such folder, or no picture in it that may be waited for."""
        self.live = False
        self._folder = Path(path)
        if not self._folder.is_dir():
            raise SourceError("no such folder", where=shown(path), action="give the path of a folder of images")
        self._t0_unix_ns = t0_unix_ns
        self._bound_s = bound_s
        self._fps = fps
        self._colour = colour
        self._stretch = Contrast()
        self._stop = stop or threading.Event()
        self._times: NameTimes | None = None
        self._first: int | None = None
        self._remarks: dict[str, Remark] = {}
        self._loop = loop and not follow
        self._shift_ns = self._last_ns = self._interval_ns = 0
        self._first_ns = 0
        self._segment = self._count = self._index = 0  # index: of the file in this pass, whatever it is
        self._left_out: Counter[str] = Counter()
        self._last_out = self._folder
        if not follow and not self._names():
            raise SourceError("holds no picture", where=path, action="give a folder of images")
        self._files = self._follow() if follow else iter(self._names())

    @property
    def frames_said(self) -> int:
        """How many pictures there are, now."""
        return len(self._names())

    @property
    def remarks(self) -> list[Remark]:
        """How its pictures are dated, and what was left out."""
        return list(self._remarks.values())

    def read(self) -> Picture | None:
        """The next whole image; None at the end. Raises SourceError if none is an image, or if all is gone."""
        try:
            return self._read()
        except OSError as error:
            action = "see to the disk or the network that it is on"
            raise SourceError(f"is gone ({error})", where=str(self._folder), action=action) from error

    def _read(self) -> Picture | None:
        while (file := next(self._files, None)) is not None:
            image, t_unix_ns = self._image(file), self._stamp_ns(file)
            if image is not None and t_unix_ns is not None:
                return self._picture(image, t_unix_ns)
            self._leave_out(CUT_OFF if image is None else STRANGE_NAME, file)
        if self._left_out and not self._count:
            raise SourceError(
                "is no image that can be read", where=str(self._last_out), action="give a folder of images"
            )
        if self._loop and self._count:
            self._segment += 1
            self._shift_ns = self._last_ns + self._interval_ns - self._first_ns
            self._index = 0
            self._files = iter(self._names())
            return self._read()
        return None

    def _leave_out(self, why: str, file: Path) -> None:
        self._left_out[why] += 1
        self._last_out = file
        said = f"{self._left_out[why]} files are {why} and left out, {file.name} the last of them"
        self._remarks[why] = Remark(said, LEFT_OUT[why])

    def _image(self, file: Path) -> NDArray[Any] | None:
        """A file's picture; None if it is cut off, empty or none at all."""
        data = file.read_bytes()
        if not data or not is_whole(file.suffix.lower(), data):
            return None
        flag = cv2.IMREAD_COLOR if self._colour else cv2.IMREAD_GRAYSCALE
        return cv2.imdecode(np.frombuffer(data, np.uint8), flag | cv2.IMREAD_ANYDEPTH)

    def _picture(self, image: NDArray[Any], t_unix_ns: int) -> Picture:
        if self._count:
            self._interval_ns = max(1, t_unix_ns - self._last_ns)
        else:
            self._first_ns = t_unix_ns
        self._last_ns = t_unix_ns
        self._count += 1
        bounded = self._times is not None and (self._times.absolute or self._fps is not None)
        return Picture(t_unix_ns, self._stretch.apply(image), "file", self._bound_s if bounded else None, self._segment)

    def _stamp_ns(self, file: Path) -> int | None:
        """When a file's picture was taken; None if its name carries no time where those of the others do."""
        if self._times is None:
            self._times = understand([file.stem for file in self._names()])
            self._say_times(self._times)
        self._index += 1
        value = self._index - 1 if self._times.by_order else self._times.of(file.stem)
        if value is None or self._times.absolute:
            return None if value is None else value + self._shift_ns
        if self._first is None:
            self._first = value
        return self._t0_unix_ns + self._shift_ns + round((value - self._first) / (self._fps or FOLDER_FPS) * 1e9)

    def _say_times(self, times: NameTimes) -> None:
        if times.absolute and "dates" in times.what:
            self._remarks["times"] = Remark(
                "its names are read as dates in UTC", "name pictures by UNIX time if they are not"
            )
        elif not times.absolute:
            rate = (
                f"{self._fps:g} a second as source.fps says"
                if self._fps
                else f"{FOLDER_FPS:g} a second, as nobody says"
            )
            said = f"its names carry no time that is understood: its pictures are taken by {times.what}, {rate}"
            action = "set source.fps, or name pictures by UNIX time in s, ms, us or ns"
            self._remarks["times"] = Remark(said, action)
        if "times" in self._remarks:
            log.warning("%s: %s", self._folder, self._remarks["times"].what)

    def _names(self) -> list[Path]:
        """All images, oldest first. What a computer hides (`._1.jpg`) is none."""
        files = [
            file
            for file in self._folder.iterdir()
            if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
        ]
        return sorted(files, key=lambda file: natural(file.name))

    def _follow(self) -> Iterator[Path]:
        """All images but the last, which may still be written to, until a later one appears."""
        last: tuple[object, ...] = ()
        while not self._stop.is_set():
            new = [file for file in self._names() if natural(file.name) > last]
            for file in new[:-1]:
                last = natural(file.name)
                yield file
            if len(new) <= 1:
                self._stop.wait(FOLLOW_POLL_S)
        yield from [file for file in self._names() if natural(file.name) > last]

    def close(self) -> None:
        """Stop waiting for more."""
        self._stop.set()


def is_whole(suffix: str, data: bytes) -> bool:
    """Whether a picture has its end, as far as that can be seen."""
    end = ENDS.get(suffix)
    return end is None or not data.startswith((b"\xff\xd8", b"\x89PNG")) or data.rfind(end) > data.rfind(JPEG_SCAN)

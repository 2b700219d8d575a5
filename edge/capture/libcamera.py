"""A Raspberry Pi's own cameras, through libcamera and picamera2, which its system packages.

Two hazards. A sensor's stamp is the instant at which the first row is read out, so its exposure has just ended; how
long it was changes from frame to frame while the camera exposes by itself, and half of 20 ms is a sigma of position. So
each stamp goes back by half of its own frame's exposure. And what these stamps count from, the uptime with or without
the time asleep, hangs on the kernel: the clock that the stamp is just behind of is meant, and where it is none, arrival
counts, with its larger bound.
"""

import importlib
import time
from collections.abc import Callable
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.debian_python import debian_modules
from edge.capture.frame import Picture, Remark, StampRule
from edge.capture.grey import as_wanted
from edge.capture.stamps import ARRIVAL_BOUND_S, MONOTONIC_PLAUSIBLE_S, SENSOR_BOUND_S
from edge.capture.wish import CameraWish, not_obeyed
from edge.common.errors import SourceError
from edge.common.utc import Dated

LIBCAMERA_SCHEME: Final = "libcamera://"
USUAL_SIZE_PX: Final = (1920, 1080)
PICTURE_BUFFERS: Final = 4  # one to fill, one to read, and two while this process is late
SETTLED_FRAMES: Final = 30  # after which a camera has what it was asked for, if it obeys


def picamera2() -> Any:
    """The module picamera2. Raises SourceError where it is not installed."""
    try:
        with debian_modules():
            return importlib.import_module("picamera2")
    except ImportError as error:
        action = "install it: apt install python3-picamera2, and run under the system's own python3"
        raise SourceError(f"picamera2 is missing ({error})", where=LIBCAMERA_SCHEME, action=action) from error


class LibcameraCamera:
    """A camera of libcamera. library: picamera2; name: its number, as rpicam-hello lists it.

    date: UTC of a monotonic stamp. asleep_ns: how long the machine was, since it started.
    """

    live = True
    skipped = 0

    def __init__(
        self,
        library: Any,
        name: str,
        *,
        wish: CameraWish,
        colour: bool,
        timeout_s: float,
        delay_s: float = 0.0,
        date: Callable[[int], Dated],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        asleep_ns: Callable[[], int] = lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns(),
    ) -> None:
        """Raises SourceError if it does not open."""
        self._where, self._wish, self._colour = f"{LIBCAMERA_SCHEME}{name}", wish, colour
        self._timeout_s, self._delay_s, self._date = timeout_s, delay_s, date
        self._monotonic_ns, self._asleep_ns = monotonic_ns, asleep_ns
        self._size_px = wish.size_px or USUAL_SIZE_PX
        self._frames, self._has = 0, dict[str, Any]()
        try:
            with debian_modules():
                self._camera = library.Picamera2(int(name or 0))
                self._camera.configure(self._camera.create_video_configuration(**self._asked()))
                self._camera.start()
        except Exception as error:
            action = "give libcamera://NUMBER as rpicam-hello lists it; look at the ribbon cable"
            raise SourceError(f"the camera does not open ({error})", where=self._where, action=action) from error

    def _asked(self) -> dict[str, Any]:
        """What the camera is configured to."""
        controls: dict[str, float] = {}
        if self._wish.fps:
            controls["FrameRate"] = self._wish.fps
        if self._wish.exposure_s:
            controls["ExposureTime"] = round(self._wish.exposure_s * 1e6)
        if self._wish.gain is not None:
            controls["AnalogueGain"] = self._wish.gain
        main = {"size": self._size_px, "format": "YUV420"}
        return {"main": main, "buffer_count": PICTURE_BUFFERS, "controls": controls}

    @property
    def remarks(self) -> list[Remark]:
        """What it was asked for and does not do, once it has had the time."""
        if self._frames < SETTLED_FRAMES:
            return []
        wish, found = self._wish, list[Remark]()
        duration_us = float(self._has.get("FrameDuration", 0.0))
        for what, asked, got in (
            ("a rate of {:g} frames a second", wish.fps, 1e6 / duration_us if duration_us else None),
            ("an exposure of {:g} s", wish.exposure_s, self._has.get("ExposureTime", 0.0) / 1e6),
            ("a gain of {:g}", wish.gain, self._has.get("AnalogueGain")),
        ):
            if asked is not None and got is not None:
                found += not_obeyed(what, asked, got, "choose one that the sensor has: rpicam-hello lists its modes")
        return found

    def read(self) -> Picture | None:
        """The next frame. Raises SourceError when the camera is dead."""
        try:
            request = self._camera.wait(self._camera.capture_request(wait=False), timeout=self._timeout_s)
        except (FutureTimeoutError, TimeoutError) as error:
            action = "look at the ribbon cable; it is opened again by itself"
            raise SourceError("the camera gives no more frames", where=self._where, action=action) from error
        arrival_ns = self._monotonic_ns()
        try:
            image, self._has = np.array(request.make_array("main")), dict(request.get_metadata())
        finally:
            request.release()
        self._frames += 1
        return self._picture(image, arrival_ns)

    def _picture(self, image: NDArray[Any], arrival_ns: int) -> Picture:
        stamp_ns = self._monotonic_of(int(self._has.get("SensorTimestamp", 0)), arrival_ns)
        dated = self._date(arrival_ns if stamp_ns is None else stamp_ns)
        exposure_s = float(self._has.get("ExposureTime", 0.0)) / 1e6
        return Picture(
            StampRule("exposure_end", exposure_s, delay_s=self._delay_s).middle_ns(dated.t_unix_ns),
            as_wanted(self._shown(image), colour=self._colour),
            "arrival" if stamp_ns is None else "sensor",
            (ARRIVAL_BOUND_S if stamp_ns is None else SENSOR_BOUND_S) + dated.doubt_s,
        )

    def _monotonic_of(self, sensor_ns: int, arrival_ns: int) -> int | None:
        """A sensor's stamp by the monotonic clock, ns; None if it is of neither clock that counts from the start."""
        for ahead_ns in (0, self._asleep_ns()):
            if 0 <= arrival_ns - (sensor_ns - ahead_ns) < MONOTONIC_PLAUSIBLE_S * 1e9:
                return sensor_ns - ahead_ns
        return None

    def _shown(self, planes: NDArray[Any]) -> NDArray[Any]:
        """Grey or BGR of planar YUV, whose rows may be longer than the picture is wide."""
        width, height = self._size_px
        if not self._colour:
            return planes[:height, :width]
        return np.asarray(cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420))[:height, :width]

    def close(self) -> None:
        """Let go of the camera."""
        self._camera.stop()
        self._camera.close()

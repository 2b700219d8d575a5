"""Machine-vision cameras (GenICam over GigE or USB3) through Aravis, which Debian packages.

Two hazards. The camera's clock counts from nowhere, or, under PTP, in TAI, which is 37 s ahead of UTC: taken as it is,
every position is a kilometre off. So its time is only UTC where PTP says that it follows, the whole seconds between it
and this box's clock are no more than leap seconds explain, and each stamp is held against its arrival as a network
camera's is. And a setting that a camera rounds or refuses is read back and said.
"""

import importlib
import time
import warnings
from collections.abc import Callable
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.debian_python import debian_modules
from edge.capture.frame import AS_STAMPED, Picture, Remark, StampRule
from edge.capture.grey import Contrast, as_wanted
from edge.capture.standing_still import StandingStill
from edge.capture.wish import CameraWish, not_obeyed
from edge.capture.witnessed_stream import WitnessedStream
from edge.common.errors import SourceError
from edge.common.utc import Dated

GENICAM_SCHEME: Final = "genicam://"
BUFFERS: Final = 4  # one to fill, one to read, and two while this process is late
TAI_AHEAD_S: Final = range(30, 46)  # s between TAI and UTC: 37 since 2017
PTP_STATUS: Final = ("PtpStatus", "GevIEEE1588Status")
PTP_ENABLE: Final = ("PtpEnable", "GevIEEE1588")
DEEP_MONO: Final = frozenset({"Mono10", "Mono12", "Mono14", "Mono16"})
BAYER: Final = {
    "BayerRG8": cv2.COLOR_BayerRGGB2BGR,
    "BayerGR8": cv2.COLOR_BayerGRBG2BGR,
    "BayerGB8": cv2.COLOR_BayerGBRG2BGR,
    "BayerBG8": cv2.COLOR_BayerBGGR2BGR,
}


def aravis() -> Any:
    """Aravis' own bindings. Raises SourceError where they are not installed."""
    try:
        with debian_modules(), warnings.catch_warnings():
            gi = importlib.import_module("gi")
            gi.require_version("Aravis", "0.8")
            warnings.simplefilter("ignore", ImportWarning)  # of its own way of importing
            return importlib.import_module("gi.repository.Aravis")
    except (ImportError, ValueError) as error:
        action = "install them: apt install python3-gi gir1.2-aravis-0.8, and run under Debian's own python3"
        raise SourceError(f"Aravis' bindings are missing ({error})", where=GENICAM_SCHEME, action=action) from error


def utc_of_ptp(camera_ns: int, arrival_unix_ns: int) -> int | None:
    """UTC of a camera's PTP time, which may be TAI or UTC itself, ns; None where it is neither."""
    ahead_s = round((camera_ns - arrival_unix_ns) / 1e9)
    if ahead_s in TAI_AHEAD_S:
        return camera_ns - ahead_s * 10**9
    return camera_ns if ahead_s in (-1, 0, 1) else None


class GenicamCamera:
    """A GenICam camera. library: Aravis. date: UTC of a monotonic stamp."""

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
        rule: StampRule = AS_STAMPED,
        date: Callable[[int], Dated],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Raises SourceError if it does not open, or gives pictures of a kind that is not read."""
        self._library, self._name, self._where = library, name, f"{GENICAM_SCHEME}{name}"
        self._colour, self._timeout_us = colour, round(timeout_s * 1e6)
        self._rule = rule
        self._date, self._monotonic_ns = date, monotonic_ns
        self._stretch, self._still, self._clock = Contrast(), StandingStill(self._where), WitnessedStream()
        self._said: list[Remark] = []
        try:
            library.update_device_list()  # a camera that was not looked for opens, and sends its frames elsewhere
            self._camera = library.Camera.new(name or None)
            self._ask(wish)
            self._form = str(self._camera.get_pixel_format_as_string())
            self._follows_ptp = self._ptp()
            self._stream = self._begin()
        except Exception as error:
            action = "look at the cable and its power; `arv-tool-0.8` lists the cameras that are seen"
            raise SourceError(f"the camera does not open ({error})", where=self._where, action=action) from error
        if self._form not in {"Mono8", *DEEP_MONO, *BAYER}:
            self.close()
            known = ", ".join(["Mono8", *sorted(DEEP_MONO), *BAYER])
            raise SourceError(
                f"its pixel format {self._form} is not read",
                where=self._where,
                action=f"set the camera to one of {known}: `arv-tool-0.8 control PixelFormat=Mono8`",
            )

    def _ask(self, wish: CameraWish) -> None:
        """Set what is wished, and note what the camera does instead."""
        camera = self._camera
        if wish.fps and camera.is_frame_rate_available():
            camera.set_frame_rate(wish.fps)
            self._compare("a rate of {:g} frames a second", wish.fps, camera.get_frame_rate())
        if wish.exposure_s and camera.is_exposure_time_available():
            if camera.is_exposure_auto_available():
                camera.set_exposure_time_auto(self._library.Auto.OFF)
            camera.set_exposure_time(wish.exposure_s * 1e6)
            self._compare("an exposure of {:g} us", wish.exposure_s * 1e6, camera.get_exposure_time())
        if wish.gain is not None and camera.is_gain_available():
            if camera.is_gain_auto_available():
                camera.set_gain_auto(self._library.Auto.OFF)
            camera.set_gain(wish.gain)
            self._compare("a gain of {:g} dB", wish.gain, camera.get_gain())

    def _compare(self, what: str, asked: float, got: float) -> None:
        action = "choose one that the camera has: `arv-tool-0.8 features` lists them"
        self._said += not_obeyed(what, asked, got, action)

    def _ptp(self) -> bool:
        """Whether the camera's clock follows a PTP master; it is asked to, where it can."""
        device = self._camera.get_device()
        for name in PTP_ENABLE:
            if device.is_feature_available(name):
                device.set_boolean_feature_value(name, True)
        for name in PTP_STATUS:
            if device.is_feature_available(name):
                return str(device.get_string_feature_value(name)) == "Slave"
        return False

    def _begin(self) -> Any:
        stream = self._camera.create_stream(None, None)
        for _ in range(BUFFERS):
            stream.push_buffer(self._library.Buffer.new_allocate(self._camera.get_payload()))
        self._camera.set_acquisition_mode(self._library.AcquisitionMode.CONTINUOUS)
        self._camera.start_acquisition()
        return stream

    @property
    def remarks(self) -> list[Remark]:
        """What it was asked for and does not do, and what its times say against each other."""
        return [*self._said, *self._clock.remarks]

    def read(self) -> Picture | None:
        """The next whole frame. Raises SourceError when the camera is dead."""
        until_ns = self._monotonic_ns() + self._timeout_us * 1000
        while self._monotonic_ns() < until_ns:
            buffer = self._stream.timeout_pop_buffer(self._timeout_us)
            if buffer is None:
                break
            arrival_ns = self._monotonic_ns() - self._waited_ns(buffer)
            try:
                whole = buffer.get_status() == self._library.BufferStatus.SUCCESS
                image = self._image(buffer) if whole else None
                camera_ns = int(buffer.get_timestamp())
            finally:
                self._stream.push_buffer(buffer)
            if image is not None and not self._still.repeats(image, arrival_ns):
                return self._picture(image, camera_ns, arrival_ns)
        action = "look at cable, power and, on a network, at jumbo frames; it is opened again by itself"
        raise SourceError("the camera gives no more whole frames", where=self._where, action=action)

    def _waited_ns(self, buffer: Any) -> int:
        """How long ago a buffer was filled: while the detector is busy it waits to be taken."""
        waited_ns = time.time_ns() - int(buffer.get_system_timestamp())
        return waited_ns if 0 <= waited_ns < self._timeout_us * 1000 else 0

    def _image(self, buffer: Any) -> NDArray[Any]:
        """The picture of a buffer, copied: the buffer is the camera's again."""
        shape = (buffer.get_image_height(), buffer.get_image_width())
        deep = self._form in DEEP_MONO
        return np.frombuffer(buffer.get_data(), "<u2" if deep else np.uint8).reshape(shape).copy()

    def _picture(self, image: NDArray[Any], camera_ns: int, arrival_ns: int) -> Picture:
        if self._form in BAYER:
            image = cv2.cvtColor(image, BAYER[self._form])
        sent = utc_of_ptp(camera_ns, self._date(arrival_ns).t_unix_ns) if self._follows_ptp else None
        stamp = self._clock.stamp(camera_ns, arrival_ns, sent, self._date)
        shown = as_wanted(self._stretch.apply(image), colour=self._colour)
        return Picture(self._rule.middle_ns(stamp.t_unix_ns), shown, stamp.source, stamp.bound_s)

    def close(self) -> None:
        """Let go of the camera."""
        self._camera.stop_acquisition()

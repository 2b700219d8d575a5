"""A Raspberry Pi's camera: whose time it is, how long it exposed, what it did not obey. By a stand-in for picamera2."""

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from edge.capture.libcamera import LibcameraCamera, picamera2
from edge.capture.stamps import ARRIVAL_BOUND_S, SENSOR_BOUND_S
from edge.capture.wish import CameraWish
from edge.common.errors import SourceError
from edge.common.utc import Dated

UTC_NS = 1_800_000_000 * 10**9  # of the monotonic clock's nought
FPS = 30.0
READ_NS = 30_000_000  # from the first row's readout to the picture
SIZE_PX, ROW_PX = (60, 40), 64  # rows are longer than the picture is wide


class StandInPicamera2:
    """As much of picamera2 as a camera needs; ahead_s: how far its stamps are ahead of the monotonic clock."""

    def __init__(self, ahead_s: float = 0.0, dies_at: int = 10**9, **instead: float) -> None:
        self.ahead_s, self.dies_at, self.instead, self.k = ahead_s, dies_at, instead, -1
        self.controls: dict[str, float] = {}
        self.released = 0
        self.closed = False

    def Picamera2(self, number: int) -> "StandInPicamera2":
        if number > 1:
            raise IndexError("list index out of range")
        return self

    def create_video_configuration(self, main: dict[str, Any], buffer_count: int, controls: dict[str, float]) -> Any:
        assert (main["format"], buffer_count > 1) == ("YUV420", True)
        self.controls = {"FrameRate": FPS, "ExposureTime": 4000, "AnalogueGain": 1.0, **controls, **self.instead}

    def configure(self, _: object) -> None: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None:
        self.closed = True

    def read_out_ns(self) -> int:
        return 10**12 + round(self.k / FPS * 1e9)

    def now_ns(self) -> int:
        return self.read_out_ns() + READ_NS

    def capture_request(self, wait: bool) -> str:
        assert not wait, "a dead camera is waited for no longer than is said"
        return "job"

    def wait(self, _: str, timeout: float) -> Any:
        self.k += 1
        if self.k == self.dies_at:
            raise TimeoutError(f"no frame within {timeout} s")
        planes = np.full((SIZE_PX[1] * 3 // 2, ROW_PX), 128, np.uint8)
        planes[: SIZE_PX[1], : SIZE_PX[0]] = 40 + self.k
        has = {"SensorTimestamp": self.read_out_ns() + round(self.ahead_s * 1e9), **self.controls}
        has["FrameDuration"] = round(1e6 / self.controls["FrameRate"])
        return SimpleNamespace(make_array=lambda _: planes, get_metadata=lambda: has, release=self._release)

    def _release(self) -> None:
        self.released += 1

    def camera(self, wish: CameraWish | None = None, *, colour: bool = False, asleep_s: float = 0.0) -> LibcameraCamera:
        return LibcameraCamera(
            self,
            "0",
            wish=wish or CameraWish(size_px=SIZE_PX),
            colour=colour,
            timeout_s=2.0,
            date=lambda t_ns: Dated(UTC_NS + t_ns, 0.001),
            monotonic_ns=self.now_ns,
            asleep_ns=lambda: round(asleep_s * 1e9),
        )


@pytest.mark.parametrize(("ahead_s", "asleep_s"), [(0.0, 0.0), (0.0, 7200.0), (7200.0, 7200.0)])
def test_a_frame_is_dated_to_the_middle_of_its_own_exposure_by_either_clock(ahead_s: float, asleep_s: float) -> None:
    for exposure_us in (100, 4000, 20_000):
        library = StandInPicamera2(ahead_s, ExposureTime=exposure_us)
        picture = library.camera(asleep_s=asleep_s).read()
        assert picture is not None
        assert picture.t_unix_ns == UTC_NS + library.read_out_ns() - exposure_us * 500
        assert (picture.time_source, picture.bound_s) == ("sensor", SENSOR_BOUND_S + 0.001)


@pytest.mark.parametrize("ahead_s", [-3600.0, 1.0, 3600.0, 1e9])
def test_a_stamp_of_neither_clock_is_not_believed(ahead_s: float) -> None:
    library = StandInPicamera2(ahead_s)
    picture = library.camera(asleep_s=7200.0).read()
    assert picture is not None
    assert (picture.time_source, picture.bound_s) == ("arrival", ARRIVAL_BOUND_S + 0.001)
    assert abs(picture.t_unix_ns - UTC_NS - library.now_ns()) < 1e7


def test_pictures_are_grey_or_bgr_without_the_padding_of_their_rows() -> None:
    library = StandInPicamera2()
    grey = library.camera().read()
    colour = library.camera(colour=True).read()
    assert grey is not None
    assert colour is not None
    assert grey.image.shape == SIZE_PX[::-1]
    assert (grey.image == 40).all()
    assert colour.image.shape == (*SIZE_PX[::-1], 3)
    assert np.ptp(colour.image) == 0
    assert library.released == 2


def test_what_it_does_not_obey_is_said_once_it_has_settled() -> None:
    wish = CameraWish(SIZE_PX, fps=60.0, exposure_s=0.001, gain=4.0)
    for library, count in ((StandInPicamera2(), 0), (StandInPicamera2(FrameRate=30.0, ExposureTime=9000), 2)):
        camera = library.camera(wish)
        camera.read()
        assert camera.remarks == []
        for _ in range(40):
            camera.read()
        assert len(camera.remarks) == count, camera.remarks
        if count:
            assert "60 frames a second was asked for, it has 30" in camera.remarks[0].what


def test_a_dead_camera_and_one_that_is_not_there_are_named() -> None:
    library = StandInPicamera2(dies_at=2)
    camera = library.camera()
    for _ in range(2):
        camera.read()
    with pytest.raises(SourceError, match="no more frames"):
        camera.read()
    camera.close()
    assert library.closed
    with pytest.raises(SourceError, match="does not open"):
        LibcameraCamera(
            library, "7", wish=CameraWish(), colour=False, timeout_s=1.0, date=lambda t_ns: Dated(t_ns, 0.0)
        )


def test_without_its_package_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "picamera2", None)
    with pytest.raises(SourceError, match="apt install python3-picamera2"):
        picamera2()

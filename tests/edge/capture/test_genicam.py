"""A GenICam camera: whose time it is, what it did not obey, what it gives; by a stand-in and by Aravis' own fake."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from edge.capture.genicam import GenicamCamera, aravis, utc_of_ptp
from edge.capture.wish import CameraWish
from edge.common.errors import SourceError
from edge.common.utc import Dated, UtcMapping
from tests.edge.capture.sources import T0

FPS = 25.0
DELAY_NS = 8_000_000


class StandInAravis:
    """As much of Aravis as a camera needs; tai_s: how far its clock is ahead of UTC, None for one from nowhere."""

    def __init__(
        self, form: str = "Mono8", ptp: str | None = None, ahead_s: float = -1.6e9, fixed_us: float = 0
    ) -> None:
        self.form, self.ptp, self.ahead_s, self.fixed_us = form, ptp, ahead_s, fixed_us
        self.random, self.k, self.broken, self.set = np.random.default_rng(18), -1, set(), {}
        self.Camera = SimpleNamespace(new=lambda name: self)
        self.Buffer = SimpleNamespace(new_allocate=lambda size: None)
        self.Auto = SimpleNamespace(OFF=0)
        self.AcquisitionMode = SimpleNamespace(CONTINUOUS=2)
        self.BufferStatus = SimpleNamespace(SUCCESS=0)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("is_") and name.endswith("_available"):
            return lambda *feature: not feature or (self.ptp is not None and feature[0].startswith("Ptp"))
        if name.startswith("set_"):
            return lambda *value: self.set.__setitem__(name[4:], value)
        return lambda *_: None

    def get_exposure_time(self) -> float:
        return self.fixed_us or self.set["exposure_time"][0]

    def get_frame_rate(self) -> float:
        return self.set["frame_rate"][0]

    def get_gain(self) -> float:
        return self.set["gain"][0]

    def get_pixel_format_as_string(self) -> str:
        return self.form

    def get_device(self) -> Any:
        return self

    def get_string_feature_value(self, name: str) -> str | None:
        return self.ptp

    def create_stream(self, *_: object) -> Any:
        return self

    def now_ns(self) -> int:
        """The monotonic clock, which is UTC here."""
        return T0 + round(max(0, self.k) / FPS * 1e9) + DELAY_NS

    def timeout_pop_buffer(self, _: int) -> Any:
        self.k += 1
        deep = self.form != "Mono8"
        image = self.random.normal(9000 if deep else 90, 8, (48, 64)).astype("<u2" if deep else np.uint8)
        return SimpleNamespace(
            get_status=lambda: int(self.k in self.broken),
            get_timestamp=lambda: T0 + round((self.k / FPS + self.ahead_s) * 1e9),
            get_system_timestamp=lambda: 0,
            get_image_width=lambda: 64,
            get_image_height=lambda: 48,
            get_data=image.tobytes,
        )

    def camera(self, **options: Any) -> GenicamCamera:
        options = {"wish": CameraWish(), "colour": False, "timeout_s": 2.0, **options}
        return GenicamCamera(self, "x", date=lambda t: Dated(t, 0.0), monotonic_ns=self.now_ns, **options)


def test_ptp_time_is_tai_or_utc_or_nothing() -> None:
    for ahead_s, good in ((37, True), (0, True), (35, True), (19, False), (3600, False), (-37, False)):
        utc = utc_of_ptp(T0 + ahead_s * 10**9, T0 + DELAY_NS)
        assert (utc == T0) == good, ahead_s


@pytest.mark.parametrize(
    ("ptp", "ahead_s", "source", "error_s"),
    [
        ("Slave", 37.0, "sender", 0.0),
        ("Slave", 0.0, "sender", 0.0),
        ("Slave", 3600.0, "arrival", DELAY_NS / 1e9),
        ("Master", 37.0, "arrival", DELAY_NS / 1e9),
        (None, -1.6e9, "arrival", DELAY_NS / 1e9),
    ],
)
def test_stamps_are_utc_and_inside_their_bound(ptp: str | None, ahead_s: float, source: str, error_s: float) -> None:
    library = StandInAravis(ptp=ptp, ahead_s=ahead_s)
    camera = library.camera()
    for k in range(120):
        frame = camera.read()
        assert frame is not None
        error = (frame.t_unix_ns - T0) / 1e9 - k / FPS
        assert error == pytest.approx(error_s, abs=1e-6)
        assert frame.bound_s is None or abs(error) <= frame.bound_s
    assert (frame.time_source, frame.bound_s is not None) == (source, True)


def test_what_it_does_not_obey_is_said() -> None:
    wish = CameraWish(fps=30.0, exposure_s=0.002, gain=6.0)
    assert StandInAravis().camera(wish=wish).remarks == []
    said = StandInAravis(fixed_us=10_000).camera(wish=wish).remarks
    assert [remark.what for remark in said] == ["an exposure of 2000 us was asked for, it has 10000"]


def test_broken_frames_are_passed_over_and_deep_ones_stretched() -> None:
    library = StandInAravis("Mono12")
    library.broken = {1, 2}
    camera = library.camera()
    first, second = camera.read(), camera.read()
    assert first is not None
    assert second is not None
    assert second.t_unix_ns - first.t_unix_ns == pytest.approx(3 / FPS * 1e9, abs=2)
    assert first.image.dtype == np.uint8
    assert len(np.unique(first.image)) > 15


def test_a_format_that_is_not_read_is_refused_by_name() -> None:
    with pytest.raises(SourceError, match=r"Mono12Packed is not read; set the camera to one of Mono8"):
        StandInAravis("Mono12Packed").camera()


def test_the_real_library_and_its_fake_camera() -> None:
    try:
        library = aravis()
    except SourceError as error:
        assert "apt install python3-gi gir1.2-aravis-0.8" in error.action  # noqa: PT017 -- where it is not installed
        return
    library.enable_interface("Fake")
    library.update_device_list()
    wish = CameraWish(fps=20.0, exposure_s=0.01)
    camera = GenicamCamera(library, "Fake_1", wish=wish, colour=False, timeout_s=2.0, date=UtcMapping().date)
    try:
        stamps = [camera.read() for _ in range(5)]
    finally:
        camera.close()
    assert all(one is not None and one.size_px == (512, 512) for one in stamps)

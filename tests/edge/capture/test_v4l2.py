"""A V4L2 camera: whose clock stamped a frame, what it did not obey, and pictures that are no new ones."""

import logging
from typing import Any

import cv2
import numpy as np
import pytest

from edge.capture.frame import Picture, StampRule, middle_of_exposure
from edge.capture.stamps import ARRIVAL_BOUND_S, SENSOR_BOUND_S
from edge.capture.standing_still import CALIBRATION_S, StandingStill
from edge.capture.v4l2 import COUNTED_FRAMES, V4l2Camera, ask
from edge.capture.wish import CameraWish
from edge.common.errors import SourceError
from edge.common.utc import Dated
from tests.edge.capture.sources import MS, T0, FakeCapture, undoubted

log = logging.getLogger(__name__)

SEED = 18


class TestV4l2:
    OFFSET = T0 - 5000 * 10**9  # UTC minus monotonic
    doubt_s = 0.0

    def read(self, stamp_ms: float, arrival_ns: int, **options: Any) -> Picture:
        source = V4l2Camera(
            FakeCapture([{cv2.CAP_PROP_POS_MSEC: stamp_ms}]),
            "/dev/video0",
            colour=False,
            date=lambda monotonic_ns: Dated(monotonic_ns + self.OFFSET, self.doubt_s),
            monotonic_ns=lambda: arrival_ns,
            **options,
        )
        return source.read()

    def test_driver_stamp_becomes_utc(self) -> None:
        frame = self.read(5000_123.456, 5000_160 * MS)
        assert frame.t_unix_ns == T0 + 123_456_000
        assert frame.time_source == "sensor"

    @pytest.mark.parametrize(
        ("stamp_of", "shift_ms"), [("middle", 0), ("exposure_start", 4), ("exposure_end", -4), ("frame_end", -24)]
    )
    def test_stamps_of_other_instants_are_moved_to_the_middle(self, stamp_of: Any, shift_ms: int) -> None:
        frame = self.read(5000_100.0, 5000_160 * MS, rule=StampRule(stamp_of, 0.008, 0.02))
        assert frame.t_unix_ns == T0 + (100 + shift_ms) * MS
        assert middle_of_exposure(0, stamp_of, 0.008, 0.02) == shift_ms * MS

    @pytest.mark.parametrize("stamp_ms", [0.0, 6000_000.0, 1_700_000_000_000.0])
    def test_without_a_believable_stamp_arrival_counts_and_says_so(self, stamp_ms: float) -> None:
        frame = self.read(stamp_ms, 5000_160 * MS)
        assert (frame.t_unix_ns, frame.time_source, frame.bound_s) == (T0 + 160 * MS, "arrival", ARRIVAL_BOUND_S)

    def test_a_frame_about_a_step_says_that_it_may_be_off_by_all_of_it(self) -> None:
        self.doubt_s = 0.5
        assert self.read(5000_123.456, 5000_160 * MS).bound_s == pytest.approx(0.5 + SENSOR_BOUND_S)

    def test_dead_camera_says_so(self) -> None:
        source = V4l2Camera(FakeCapture([]), "/dev/video7", colour=False, date=undoubted)
        with pytest.raises(SourceError, match=r"/dev/video7.*no more frames"):
            source.read()


class Driver:
    """A driver that does what it likes: `forced` is what it has whatever it is told; pictures as they are asked for."""

    def __init__(self, forced: dict[int, float] | None = None, pictures: Any = None, fps: float = 30.0) -> None:
        self.forced, self.told, self.pictures, self.at, self.fps = forced or {}, {}, pictures, -1, fps

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        self.at += 1
        return True

    def retrieve(self) -> tuple[bool, Any]:
        return True, self.pictures(self.at)

    def get(self, prop: int) -> float:
        return self.forced.get(prop, self.told.get(prop, 0.0))

    def set(self, prop: int, value: float) -> bool:
        self.told[prop] = float(value)
        return prop not in self.forced

    def release(self) -> None:
        pass

    def camera(self, **options: Any) -> V4l2Camera:
        return V4l2Camera(
            self,
            "/dev/video0",
            colour=False,
            date=undoubted,
            monotonic_ns=lambda: T0 + round(self.at / self.fps * 1e9),
            **options,
        )


MJPG, YUYV, Y16 = (float(cv2.VideoWriter.fourcc(*code)) for code in ("MJPG", "YUYV", "Y16 "))
WISH = CameraWish((1280, 720), "MJPG", 30.0, 0.002, 8.0)


def test_a_driver_that_obeys_is_not_spoken_of() -> None:
    driver = Driver()
    assert ask(driver, WISH) == []
    assert driver.told[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
    assert driver.told[cv2.CAP_PROP_EXPOSURE] == 20


def test_what_is_not_obeyed_is_said_with_what_there_is_instead() -> None:
    random = np.random.default_rng(SEED)
    log.info("seed %d", SEED)
    refusals = {
        cv2.CAP_PROP_FOURCC: (YUYV, "it gives YUYV"),
        cv2.CAP_PROP_FRAME_WIDTH: (640.0, "it gives 640 x"),
        cv2.CAP_PROP_FPS: (5.0, "it is set to 5"),
        cv2.CAP_PROP_EXPOSURE: (156.0, "it has 15.6 ms"),
        cv2.CAP_PROP_GAIN: (0.0, "it has 0"),
    }
    for _ in range(20):
        chosen = [prop for prop in refusals if random.uniform() < 0.5]
        said = [remark.what for remark in ask(Driver({prop: refusals[prop][0] for prop in chosen}), WISH)]
        assert len(said) == len(chosen)
        assert all(refusals[prop][1] in one for prop, one in zip(chosen, said, strict=True)), said


def noisy(random: np.random.Generator, level: float = 90.0) -> np.ndarray:
    return np.clip(random.normal(level, 5, (48, 64, 3)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("fps", "said"), [(29.0, []), (5.0, ["30 frames a second were asked for, 5.0 come"])])
def test_the_rate_is_counted_and_not_believed(fps: float, said: list[str]) -> None:
    random = np.random.default_rng(SEED)
    source = Driver(pictures=lambda k: noisy(random), fps=fps).camera(fps=30.0)
    for _ in range(COUNTED_FRAMES):
        source.read()
    assert [remark.what for remark in source.remarks] == said


def test_a_second_with_the_shutter_closed_is_no_dead_camera_and_gives_no_picture() -> None:
    random = np.random.default_rng(SEED)
    for _ in range(20):
        begin, length = int(random.integers(5, 20)), int(random.integers(2, round(30 * CALIBRATION_S) - 2))
        still = noisy(random)
        driver = Driver(pictures=lambda k, b=begin, n=length, s=still: s if b <= k < b + n else noisy(random))
        source = driver.camera()
        stamps = [source.read().t_unix_ns for _ in range(begin + 5)]
        assert driver.at == begin + 5 + length - 2  # all but the first of the equal ones were passed over
        assert stamps[begin + 1] - stamps[begin] == pytest.approx(length / 30 * 1e9, abs=2)


def test_a_picture_that_stays_frozen_is_a_dead_camera() -> None:
    still = noisy(np.random.default_rng(SEED))
    source = Driver(pictures=lambda k: still).camera()
    source.read()
    with pytest.raises(SourceError, match="frozen for more than 4 s"):
        source.read()


def test_black_again_is_no_frozen_picture() -> None:
    black = np.zeros((48, 64), np.uint8)
    black[7, 9] = 255  # a hot pixel
    watch = StandingStill("/dev/video0")
    assert not any(watch.repeats(black.copy(), k * 10**9) for k in range(20))


def test_sixteen_bits_are_stretched_and_not_cut() -> None:
    """Fourteen bits of which the scene fills 300 counts: cut to the upper eight it would be two grey levels."""
    random = np.random.default_rng(SEED)

    def thermal(k: int) -> np.ndarray:
        image = 8000 + 300 * np.linspace(0, 1, 64) + random.normal(0, 6, (48, 64))
        image[20:24, 10 + k : 14 + k] += 200
        return image.astype(np.uint16)

    driver = Driver({cv2.CAP_PROP_FOURCC: Y16}, thermal)
    assert ask(driver, CameraWish(pixel_format="Y16 ")) == []
    assert driver.told[cv2.CAP_PROP_CONVERT_RGB] == 0
    source = driver.camera()
    first, second = source.read().image, source.read().image
    assert first.dtype == np.uint8
    assert len(np.unique(first)) > 50
    assert int(second[21, 12]) - int(second[21, 5]) > 40
    assert abs(float(np.median(first)) - float(np.median(second))) < 3  # one stretch for all

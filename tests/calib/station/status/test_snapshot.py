"""The status says what the station knows: put together from a plain view of it, without a loop round it."""

from collections.abc import Callable

import numpy as np
import pytest

from calib.station.status.snapshot import StationView, snapshot
from calib.station.status.status import StationStatus
from edge.messages import Health, HealthItem, camera_key, encode
from tests.calib.station.conftest import Fed
from tools.doubles.box_messages import SITE
from tools.doubles.flight import T0_UNIX_NS, Spec

NS = 10**9
BEGAN_NS = T0_UNIX_NS - 5 * NS


def seen(fed: Fed, now_ns: int) -> StationStatus:
    view = StationView(
        station=fed.station,
        epoch=3,
        began_ns=BEGAN_NS,
        solving=False,
        latency_ms=(1.0, 4.0),
        endpoints=[],
        recording=None,
        recording_folder="/recordings",
        free_mb=17,
        counters={"recorded": 12.0},
    )
    return snapshot(view, now_ns)


def test_a_calibrated_station_shows_cameras_pairs_and_targets(feed: Callable[..., Fed]) -> None:
    spec = Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=8.0)
    fed = feed(spec)
    now_ns = T0_UNIX_NS + round(spec.duration_s * NS)
    status = seen(fed, now_ns)
    assert (status.epoch, status.phase, status.first_solve_s) == (3, "calibrated", 3.0)
    assert status.uptime_s == pytest.approx(13.0)
    assert [camera.calibrated and camera.surveyed and camera.online for camera in status.cameras] == [True] * 3
    for camera, true in zip(status.cameras, fed.scene.truth, strict=True):
        assert camera.centre_enu == pytest.approx(tuple(true.centre_enu), abs=0.2)  # the survey's own sigma is 0.02 m
    assert len(status.pairs) == 3
    assert all(pair.shared_s >= 6 for pair in status.pairs)
    (target,) = status.targets
    # Half a metre: the tracker's own accuracy on this scene is a few decimetres.
    assert np.linalg.norm(fed.scene.positions(status.t_unix_ns)[0] - target.enu_m) < 0.5
    assert len(target.covariance_enu_m2) == 6
    assert (status.free_mb, status.counters["recorded"]) == (17, 12.0)
    assert status.counters["received_tracks"] > 300


def test_the_receiver_of_each_box_and_the_frame_of_all_are_told(feed: Callable[..., Fed]) -> None:
    fed = feed(Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=2.5), solves=False)
    said = HealthItem(name="gnss", level="warn", since_unix_ns=T0_UNIX_NS, reason="RTK float, 9 satellites")
    health = Health(t_unix_ns=T0_UNIX_NS, epoch=1, level="warn", items=[said], counters={})
    fed.station.handle(camera_key(SITE, "cam1", "health"), encode(health), T0_UNIX_NS)
    status = seen(fed, T0_UNIX_NS + 2 * NS)
    assert [camera.receiver for camera in status.cameras] == [None, said, None]
    assert (status.frame, status.frame_sigma_m) == ("ITRF2020", 0.0)


def test_a_muted_camera_and_a_silent_one_are_shown_as_such(feed: Callable[..., Fed]) -> None:
    fed = feed(Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=6.0))
    fed.station.muted.add("cam1")
    late_ns = T0_UNIX_NS + 16 * NS
    fed.tick(late_ns)
    status = seen(fed, late_ns)
    assert [camera.muted for camera in status.cameras] == [False, True, False]
    assert not any(camera.online for camera in status.cameras)
    assert status.cameras[0].last_frame_s == pytest.approx(10.0, abs=0.3)
    assert "last frame" in status.cameras[0].reason


def test_without_a_network_nothing_is_claimed(feed: Callable[..., Fed]) -> None:
    fed = feed(Spec(cameras=3, uavs=1, rate_hz=15.0, duration_s=2.5), solves=False)
    status = seen(fed, T0_UNIX_NS + 2 * NS)
    assert (status.network, status.rms_px, status.sigma_m, status.targets) == (None, None, None, [])
    assert status.phase == "collecting"
    assert status.reason

"""No green heartbeat from a station that is blind."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import common

from calib.station.core.calibration import Phase
from calib.station.outputs.mavlink.tracker_status import system_status, tracker_status
from calib.station.outputs.output import CameraStanding, StationStanding


def cameras(*online: bool, calibrated: bool = True) -> tuple[CameraStanding, ...]:
    return tuple(CameraStanding(f"cam{k}", is_online, True, calibrated) for k, is_online in enumerate(online))


WELL = StationStanding(5_000, 60, Phase.CALIBRATED, "", "", "", cameras(True, True, True), 12.0, 2, 1)


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, common.MAV_STATE_ACTIVE),
        ({"phase": Phase.COLLECTING}, common.MAV_STATE_CALIBRATING),
        ({"phase": Phase.SUSPECT}, common.MAV_STATE_CRITICAL),
        ({"cameras": cameras(False, False, False)}, common.MAV_STATE_STANDBY),
        ({"cameras": ()}, common.MAV_STATE_STANDBY),
        ({"cameras": cameras(True, False, False), "phase": Phase.BLIND}, common.MAV_STATE_CRITICAL),
        ({"cameras": cameras(True, False, False), "phase": Phase.COLLECTING}, common.MAV_STATE_CALIBRATING),
    ],
)
def test_the_state_is_that_of_what_is_needed_for_a_position(changes: dict[str, object], state: int) -> None:
    assert system_status(replace(WELL, **changes)) == state  # type: ignore[arg-type]


def test_masks_are_in_the_configuration_s_order_and_have_thirty_two_bits() -> None:
    some = tuple(CameraStanding(f"cam{k}", k == 1, k == 2, k > 2) for k in range(4))
    status = tracker_status(replace(WELL, cameras=some))
    assert (status.configured, status.online, status.synced, status.calibrated) == (0b1111, 0b10, 0b100, 0b1000)
    assert tracker_status(replace(WELL, cameras=cameras(*[True] * 40))).configured == 2**32 - 1


def test_a_recording_played_again_has_no_latency() -> None:
    assert tracker_status(WELL).latency_ms == 12.0
    assert tracker_status(replace(WELL, latency_ms=3.6e6)).latency_ms is None
    assert tracker_status(replace(WELL, latency_ms=-5.0)).latency_ms is None

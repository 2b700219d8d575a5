"""An input is whatever answers as one: a receiver's port, a recording of one, a source that is none."""

import datetime as dt
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.station.config import ReceiverSection
from calib.station.inputs.receiver import opened_receiver, receiver_settings
from calib.station.survey.rover import occupy
from calib.station.survey.store import AntennaTable
from edge.common.errors import ConfigError
from edge.gnss.averaging import StaticMean
from edge.gnss.diagnosis import ReceiverState, ReceiverStatus
from edge.gnss.gates import Position
from edge.gnss.session import Surveyed
from tests.conftest import Until
from tools.doubles.receiver import Place, gga

ANTENNA = AntennaTable(above_lens_m=0.2, measured_to="phase-centre")
NOON = dt.datetime(2026, 6, 1, 12, tzinfo=dt.UTC)
PLACE = Place()
ZEROS = np.zeros(3)


def settings(section: ReceiverSection | None, device: str | None = None, service: str = "network-rtk"):  # type: ignore[no-untyped-def]
    return receiver_settings(section, device=device, service=service, baseline_m=0.0, where="base.toml")


def test_the_command_line_s_port_comes_before_the_configuration_s() -> None:
    section = ReceiverSection(device="/dev/ttyACM0", baud=38400)
    assert settings(section).device == "/dev/ttyACM0"
    assert settings(section, "/dev/ttyUSB3").device == "/dev/ttyUSB3"
    assert settings(section).baud == 38400
    assert settings(None, "/dev/ttyUSB3").baud == 0  # the usual ones are tried
    with pytest.raises(ConfigError, match="no receiver") as refused:
        settings(None)
    assert (refused.value.where, refused.value.action) == ("base.toml", "give --device, or [receiver] device")
    with pytest.raises(ConfigError, match="service"):
        settings(section, service="hope")


def test_a_recorded_receiver_is_an_input(tmp_path: Path, until: Until) -> None:
    file = tmp_path / "rover.nmea"
    file.write_bytes(b"".join(gga(NOON + dt.timedelta(seconds=k), PLACE, ZEROS, quality=4) for k in range(60)))
    with opened_receiver(settings(None, str(file))) as receiver:
        assert until(lambda: receiver.status().state is ReceiverState.ENDED, within_s=20)
        surveyed = receiver.surveyed()
    assert surveyed is not None
    assert surveyed.height_m == pytest.approx(PLACE.altitude_m + PLACE.separation_m, abs=1e-3)  # GGA has millimetres


class TapeAndLevel:
    """A source that is no receiver: a position from somebody's own measurement, better at each look."""

    def __init__(self, fault: str = "") -> None:
        self.seconds = 0.0
        self.fault = fault

    def restart(self) -> None:
        self.seconds = 0.0

    def wait(self, timeout_s: float) -> bool:
        self.seconds += 10.0
        return True

    def surveyed(self) -> Surveyed | None:
        sigma_m = np.full(3, 0.01)
        mean = StaticMean(ZEROS, sigma_m, sigma_m, sigma_m, sigma_m, 5, 0, self.seconds, 1, self.fault)
        latest = Position(43_200_000, NOON.date(), 47.0, 8.0, 500.0, (0.001, 0.001), "tape")
        return Surveyed(47.0, 8.0, 500.0, mean, latest)

    def status(self) -> ReceiverStatus:
        return ReceiverStatus(ReceiverState.AVERAGING, "ok", "measured by hand")


def test_a_source_that_is_no_receiver_is_surveyed_from_as_one() -> None:
    lines: list[str] = []
    found = occupy(TapeAndLevel(), 30.0, ANTENNA, unix_ns=lambda: 0, progress=lines.append)
    assert found.position == (47.0, 8.0, 500.0)
    assert found.duration_s == 30.0
    assert len(lines) == 3


def test_a_position_that_must_not_be_used_is_not() -> None:
    source = TapeAndLevel("the antenna moved")
    with pytest.raises(CalibrationError, match="the antenna moved"):
        occupy(source, 30.0, ANTENNA, unix_ns=lambda: 0, progress=lambda _: None)

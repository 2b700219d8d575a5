"""A protocol is one decoder: one more, made here, gets to an averaged position through everything behind it."""

import datetime as dt
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.averaging import SERVICES
from edge.gnss.decoder import Cut, Decoder, MalformedError
from edge.gnss.decoders import PROTOCOLS, decoders
from edge.gnss.diagnosis import ReceiverState
from edge.gnss.epoch import MS_PER_DAY, Part, Place
from edge.gnss.framing import HEADER_PATIENCE_S, Framer
from edge.gnss.gates import Position, Reason, offset_m
from edge.gnss.receiver import Receiver
from edge.gnss.session import StaticSession
from tests.conftest import Until
from tools.doubles.receiver import Place as Antenna
from tools.doubles.receiver import gga

T0 = dt.datetime(2026, 6, 1, 12, 0, 0, tzinfo=dt.UTC)
ANTENNA = Antenna()
QUALITY_OF_STATUS = {1: 1, 2: 2, 3: 4, 4: 5}  # gpsd's: normal, differential, RTK fixed, RTK float


class TimePositionVelocity(Decoder):
    """gpsd's JSON reports of that name, a line each."""

    name = "tpv"
    sync = b'{"class":"TPV"'
    wanted = "TPV"

    def cut(self, buffer: bytes, start: int) -> Cut | None:
        """The line."""
        end = buffer.find(b"\n", start)
        return None if end < 0 else Cut(end + 1, buffer[start:end])

    def decode(self, body: bytes) -> Part | None:
        """A report with a position; others say nothing."""
        try:
            report = json.loads(body)
            if "lat" not in report:
                return None
            moment = dt.datetime.fromisoformat(report["time"])
            place = Place(report["lat"], report["lon"], report["altHAE"], (1.1e-4, 1e-4), "nine decimals of a degree")
        except (ValueError, KeyError, TypeError) as error:
            raise MalformedError("TPV") from error
        t_day_ms = round(moment.timestamp() * 1000) % MS_PER_DAY
        quality = QUALITY_OF_STATUS.get(report.get("status"), 0)
        return Part("TPV", t_day_ms, quality=quality, age_s=report.get("dgpsAge"), place=place, date=moment.date())


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """The one line that a new class needs in PROTOCOLS."""
    PROTOCOLS["tpv"] = TimePositionVelocity
    yield
    del PROTOCOLS["tpv"]


def tpv(second: float, **fields: Any) -> bytes:
    """A report of that second."""
    report = {
        "class": "TPV", "time": (T0 + dt.timedelta(seconds=second)).isoformat(), "status": 3, "dgpsAge": 1.0,
        "lat": ANTENNA.lat_deg, "lon": ANTENNA.lon_deg, "altHAE": ANTENNA.altitude_m + ANTENNA.separation_m,
    }  # fmt: skip
    return json.dumps(report | fields, separators=(",", ":")).encode() + b"\n"


def played(*pieces: bytes) -> tuple[StaticSession, list[Position]]:
    """A session that hears of every protocol, and what it accepted of pieces a second apart."""
    session = StaticSession()
    accepted = [position for t_s, piece in enumerate(pieces) for position in session.feed(piece, float(t_s))]
    return session, accepted + session.interrupt(len(pieces) + 1.0)


def test_its_positions_are_accepted_and_averaged() -> None:
    session, accepted = played(*(tpv(second) for second in range(30)))
    surveyed = session.surveyed()
    assert len(accepted) == session.frame_counts["tpv"] == 30
    assert surveyed is not None
    assert not surveyed.mean.fault
    truth = Position(0, None, ANTENNA.lat_deg, ANTENNA.lon_deg, ANTENNA.altitude_m + ANTENNA.separation_m, (0, 0), "")
    there = Position(0, None, surveyed.lat_deg, surveyed.lon_deg, surveyed.height_m, (0, 0), "")
    assert np.abs(offset_m(there, truth)).max() < 1e-6  # the same digits went in every time
    assert accepted[-1].date == T0.date()


@pytest.mark.parametrize(
    ("fields", "reason"),
    [({"status": 4}, Reason.QUALITY), ({"dgpsAge": 30.0}, Reason.AGE), ({"lat": 0.0, "lon": 0.0}, Reason.RANGE)],
)
def test_the_gates_ask_the_same_of_it(fields: dict[str, Any], reason: Reason) -> None:
    session, accepted = played(*(tpv(second, **fields) for second in range(5)))
    assert not accepted
    assert session.refusals[reason] == 5


def test_two_protocols_on_one_line_must_agree() -> None:
    both = [tpv(second) + gga(T0 + dt.timedelta(seconds=second), ANTENNA) for second in range(10)]
    session, accepted = played(*both)
    assert {position.source for position in accepted} == {"TPV"}  # the finer of the two
    assert session.frame_counts["nmea"] == session.frame_counts["tpv"] == 10
    apart = [tpv(s) + gga(T0 + dt.timedelta(seconds=s), ANTENNA, np.array([0.2, 0, 0])) for s in range(10)]
    session, accepted = played(*apart)
    assert not accepted
    assert session.refusals[Reason.DISAGREE] == 10


def test_what_breaks_its_rules_is_counted() -> None:
    session, _ = played(b'{"class":"TPV"nonsense\n', tpv(1, time="soon"), b'{"class":"TPV","mode":1}\n')
    assert session.counts["malformed"] == 2


@given(data=st.binary(max_size=300), at=st.integers(0, 400))
def test_any_bytes_in_any_pieces_give_the_same_frames(data: bytes, at: int) -> None:
    def cut(*pieces: bytes) -> list[Any]:
        framer = Framer(decoders())
        return [each for piece in pieces for each in framer.feed(piece, 0.0)] + framer.feed(b"", 2 * HEADER_PATIENCE_S)

    stream = data[: len(data) // 2] + tpv(0) + data[len(data) // 2 :]
    assert cut(stream[:at], stream[at:]) == cut(stream)


def test_a_configuration_chooses_it_and_a_receiver_makes_a_fix_of_it(tmp_path: Path, until: Until) -> None:
    recording = tmp_path / "gpsd.json"
    recording.write_bytes(b"".join(tpv(second) for second in range(30)))
    config = build({"device": str(recording), "protocols": ["tpv"]}, GnssConfig, where="edge.toml")
    receiver = Receiver(config)
    receiver.start()
    try:
        assert until(lambda: receiver.status().state is ReceiverState.ENDED)
        fix = receiver.fix()
    finally:
        receiver.close()
    assert fix is not None
    assert fix.samples == 30
    assert fix.sigma_m[0] > SERVICES["network-rtk"].floor_m[0]


def test_a_protocol_that_there_is_none_of_is_named() -> None:
    with pytest.raises(ConfigError, match=r"key protocols = .*not one of nmea, tpv, ubx"):
        build({"device": "/dev/ttyACM0", "protocols": ["sbf"]}, GnssConfig, where="edge.toml")


def test_only_the_chosen_protocols_are_read() -> None:
    session = StaticSession(decoders=decoders(("tpv",)))
    session.feed(gga(T0, ANTENNA) + tpv(0), 0.0)
    assert (session.frame_counts["nmea"], session.frame_counts["tpv"]) == (0, 1)
    assert session.wanted == "TPV"

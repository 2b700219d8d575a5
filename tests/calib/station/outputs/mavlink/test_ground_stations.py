"""A ground station that meets the vehicle hears what a component that is no autopilot says, and raises no alarm."""

import socket
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from calib.station.config import SiteSection
from calib.station.outputs.mavlink.codec import Codec
from calib.station.outputs.mavlink.endpoint import REDIAL_NS
from calib.station.outputs.mavlink.output import MavlinkOutput, open_output
from calib.station.outputs.output import OutputContext
from tools.doubles.ground_station import COMPONENT, SYSTEM, asking, connecting
from tools.doubles.ports import free_port

VEHICLE = 1
KEY = bytes(range(32))
OURS = (60, 61)  # components
SITE = SiteSection(name="hill", undulation_m=47.0)


def opened(folder: Path, *urls: str, **endpoint: object) -> MavlinkOutput:
    """The vehicle's system id, OURS, and both profiles to each endpoint."""
    table = {
        "system_id": VEHICLE,
        "gcs_component": OURS[0],
        "ecef_component": OURS[1],
        "endpoint": [{"url": url, "profile": ["gcs", "ecef"], **endpoint} for url in urls],
    }
    return open_output(table, OutputContext("[mavlink]", SITE, folder, 1, 0, lambda *_: None, lambda _: None))


class GroundStation:
    """A UDP port that a station sends to, and where its answers come."""

    def __init__(self, folder: Path, **endpoint: object) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(5.0)
        url = f"udp:127.0.0.1:{self._socket.getsockname()[1]}"
        self.output = opened(folder, url, **endpoint)
        self._codec = Codec(SYSTEM, COMPONENT)
        (_, endpoint_of, _) = self.output._lines[0]
        endpoint_of.send([b"\0"], 0)
        self._address = self._socket.recvfrom(10)[1]

    def say(self, message: common.MAVLink_message, key: bytes | None = None) -> list[common.MAVLink_message]:
        """What comes back."""
        codec = self._codec if key is None else Codec(SYSTEM, COMPONENT, key, link_id=3)
        codec.refresh(time.time())
        self._socket.sendto(codec.encoded(message), self._address)
        self.output.receive(0, 0, lambda _: True)
        self._socket.setblocking(False)
        answers: list[common.MAVLink_message] = []
        try:
            while True:
                answers += self._codec.received(self._socket.recv(65536))
        except BlockingIOError:
            return answers

    @property
    def alarms(self) -> list[str]:
        """What health says of it, where that is not well."""
        return [check.reason for check in self.output.checks(0) if check.level != "ok"]

    def close(self) -> None:
        self.output.close()
        self._socket.close()


@pytest.fixture
def signing(tmp_path: Path) -> dict[str, object]:
    (tmp_path / "key").touch(0o600)
    (tmp_path / "key").write_text(KEY.hex())
    return {"signing_key": "key"}


@pytest.fixture(params=["a stranger", "listed", "signing"])
def ground(request: pytest.FixtureRequest, tmp_path: Path, signing: dict[str, object]) -> Iterator[GroundStation]:
    how = {"a stranger": {}, "listed": {"commands_from": [SYSTEM]}, "signing": signing}[request.param]
    with closing(GroundStation(tmp_path, **how)) as made:
        yield made


def test_what_the_vehicle_or_all_are_asked_is_the_autopilots_to_answer(ground: GroundStation) -> None:
    for message in connecting(VEHICLE):
        assert ground.say(message) == [], message.get_type()
    assert ground.alarms == []


def test_whether_we_are_a_camera_or_a_gimbal_is_answered_and_is_no_alarm(ground: GroundStation) -> None:
    for component in OURS:
        for message in asking(VEHICLE, component):
            (ack,) = ground.say(message)
            assert (ack.get_type(), ack.result) == ("COMMAND_ACK", common.MAV_RESULT_UNSUPPORTED)
            assert (ack.get_srcComponent(), ack.command) == (component, message.command)
    assert ground.alarms == []
    assert ground.output.counters["questions"] == 2 * 16
    assert ground.output.counters["commands_refused"] == 0


def test_an_order_of_the_same_ground_station_is_an_alarm_unless_it_may_give_one(tmp_path: Path) -> None:
    order = common.MAVLink_command_long_message(VEHICLE, OURS[0], 511, 0, 246, 500_000, 0, 0, 0, 0, 0)
    with closing(GroundStation(tmp_path)) as ground:
        (ack,) = ground.say(order)
        assert ack.result == common.MAV_RESULT_DENIED
        assert len(ground.alarms) == 1
    with closing(GroundStation(tmp_path, commands_from=[SYSTEM])) as ground:
        (ack,) = ground.say(order)
        assert ack.result == common.MAV_RESULT_ACCEPTED
        assert ground.alarms == []


def test_our_version_is_told_to_whoever_may_give_orders(tmp_path: Path, signing: dict[str, object]) -> None:
    question = common.MAVLink_command_long_message(VEHICLE, OURS[0], 512, 0, 148, 0, 0, 0, 0, 0, 0)
    with closing(GroundStation(tmp_path)) as ground:
        assert [m.get_type() for m in ground.say(question)] == ["COMMAND_ACK"]
    with closing(GroundStation(tmp_path, commands_from=[SYSTEM])) as ground:
        assert [m.get_type() for m in ground.say(question)] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
    with closing(GroundStation(tmp_path, **signing)) as ground:
        assert [m.get_type() for m in ground.say(question, KEY)] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
        assert ground.alarms == []
        assert len(ground.say(question, bytes(32))) == 1
        assert "forged" in ground.alarms[0], "a question under a forged signature is one"


def test_who_waits_hears_of_the_network_at_once_and_of_silence_in_time(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        urls = [f"udp:127.0.0.1:{silent.getsockname()[1]}", f"tcpin:127.0.0.1:{free_port()}"]
        with closing(opened(tmp_path, *urls)) as output:
            began_s = time.monotonic()
            output.wait(0.1)
            assert time.monotonic() - began_s > 0.09
    nobody = f"tcp:127.0.0.1:{free_port()}"
    with closing(opened(tmp_path, nobody)) as output:
        output.receive(REDIAL_NS, 0, lambda _: True)  # dials
        began_s = time.monotonic()
        output.wait(10.0)
        assert time.monotonic() - began_s < 5.0
        output.receive(REDIAL_NS, 0, lambda _: True)
        assert "refused" in output.checks(0)[0].reason

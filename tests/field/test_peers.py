"""Other programs at a real base: MAVProxy and MAVSDK (make peers), Wireshark and stock pymavlink.

The long version, with the figures, is tools.bench.mavlink_peers.
"""

import socket
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.conftest import Until
from tests.foreign import MAVPROXY, PEERS, missing, required
from tools.doubles.autopilot import Autopilot
from tools.doubles.base import TrackingBase
from tools.doubles.listener import Listener
from tools.doubles.peers import Peers, dissected, has_wireshark
from tools.doubles.peers_at_base import KINDS, Hour
from tools.doubles.ports import free_port

TOLD_TWICE = 2  # what is on its way when the counting begins and ends
STARTS_WITHIN_S = 60.0  # on a busy machine
ANSWERED_WITHIN_S = 10.0
ORDERS = {  # what the operator types: the command
    "arm throttle": 400,
    "disarm": 400,
    "long PREFLIGHT_CALIBRATION 1 0 0 0 0 0 0": 241,
    "reboot": 246,
}


def test_who_starts_an_hour_after_the_base_takes_what_it_signs(tmp_path: Path) -> None:
    """MAVProxy and MAVSDK are counted too where they are installed, and have to be in CI."""
    assert not (required() and missing(MAVPROXY)), missing(MAVPROXY)
    peers = Peers(PEERS, tmp_path)
    with ExitStack() as stack:
        hour = Hour(stack, peers, tmp_path)
        taken, stock = hour.measure(5.0)
        sent = taken["sent"]
        assert sent["TARGET_TRACK_ECEF"] > 40, "the base tracks"
        assert taken["pymavlink, stock"]["BAD_DATA"] == 0
        for kind in KINDS:
            assert abs(taken["pymavlink, stock"][kind] - sent[kind]) <= TOLD_TWICE, kind
        if peers.has_mavproxy:
            for kind in KINDS[:3]:
                assert abs(taken["MAVProxy"][kind] - sent[kind]) <= TOLD_TWICE, kind
                assert taken["stranger"][kind] == 0, "MAVProxy with another key"
            assert taken["MAVProxy"]["others"] == 0 < stock, "a sender that does not refresh its time"
        if peers.has_mavsdk:  # which waits for a heartbeat first
            assert abs(taken["MAVSDK"]["ADSB_VEHICLE"] - sent["ADSB_VEHICLE"]) <= TOLD_TWICE
        datagrams = hour.tap.datagrams
    if has_wireshark() or required():
        shown = dissected(datagrams, tmp_path)
        assert shown.pop("malformed") == 0
        assert shown["45000"] >= 20
        assert sum(shown.values()) == len(datagrams), "Wireshark reads every frame"


@pytest.mark.program(MAVPROXY)
def test_what_an_operator_orders_his_vehicle_is_the_vehicles_to_answer(tmp_path: Path, until: Until) -> None:
    """The station has the vehicle's system id, as the guide tells; the autopilot answers a tenth of a second late."""
    with ExitStack() as stack:
        port = free_port(socket.SOCK_DGRAM)
        ear, tap = (stack.enter_context(Listener()) for _ in range(2))
        operator = stack.enter_context(Peers(PEERS, tmp_path).operator(port, tap.port))
        ground = {"url": f"udp:127.0.0.1:{port}", "profile": ["gcs"], "commands_from": [255]}
        base = TrackingBase(tmp_path, [{"url": ear.url, "profile": ["ecef"]}, ground])
        stack.callback(base.kill)
        base.start()
        base.wait_until_up()
        stack.enter_context(base.boxes())
        autopilot = stack.enter_context(Autopilot(port, answers_after_s=0.1))
        assert operator.sees("online system 1", STARTS_WITHIN_S), operator.said
        assert ear.wait(1, STARTS_WITHIN_S), "the base tracks"
        assert until(lambda: tap.counts["ADSB_VEHICLE"] >= 3, ANSWERED_WITHIN_S), "MAVProxy hears of the target"
        for count, order in enumerate(ORDERS, start=1):
            operator.type(order)
            assert operator.sees("Got COMMAND_ACK", ANSWERED_WITHIN_S, times=count), operator.said
        assert autopilot.commands == list(ORDERS.values())
        assert operator.said.count("Got COMMAND_ACK") == operator.said.count(": ACCEPTED") == len(ORDERS)
        assert tap.counts["COMMAND_ACK"] == len(ORDERS), "one answer each: the autopilot's"
        assert "mavlink commands" not in base.health(), "and nothing that looks like an attack"
        assert base.status()["counters"]["mavlink_commands_obeyed"] == 0

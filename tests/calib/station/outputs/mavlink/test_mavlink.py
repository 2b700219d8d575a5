"""What receivers need: true fields, ids, heights; ends that are said; commands obeyed only when allowed."""

import math
import struct
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from calib.geodesy import enu_to_geodetic
from calib.station.config import EndpointSection, MavlinkSection
from calib.station.core.outgoing import OutgoingTarget, TargetExport
from calib.station.outputs.mavlink import messages as mavlink
from calib.station.outputs.mavlink.codec import TICKS_PER_S, Codec, Streams, read_key, ticks
from calib.station.outputs.mavlink.identity import PRIVATE_COMPONENTS, Clashes, identity_of
from calib.station.outputs.mavlink.messages import Identity, MavlinkContext, TrackerStatus
from calib.station.outputs.mavlink.port import MavlinkPort
from calib.station.outputs.mavlink.timesync import target_of
from calib.tracking.estimates import TargetEstimate, TargetState
from edge.common.errors import ConfigError

ORIGIN = (47.4085, 8.5071, 580.0)
GCS, ECEF = 156, 25
STATION = Identity(GCS, ECEF, icao_first=1, icao_count=0x3FFF, callsign="SKY")
CONTEXT = MavlinkContext(ORIGIN, 7, STATION, undulation_m=47.6)
NS = 10**9
KEY = bytes(range(32))
STATUS = TrackerStatus(1_800_000_000 * NS, 5000, 7, 7, 3, 7, 12.0, 1, 0)


def target(**changes: object) -> OutgoingTarget:
    """A confirmed target 50 m above the origin, flying north-east and up."""
    estimate = TargetEstimate(
        track=1,
        state=TargetState.CONFIRMED,
        t_unix_ns=1_800_000_000_123_456_789,
        position_enu=np.array([10.0, 20.0, 50.0]),
        velocity_enu=np.array([3.0, 4.0, 1.5]),
        covariance=np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]),
        cameras=("cam0", "cam2"),
        age_s=0.25,
        quality=1.0,
    )
    sent = TargetExport(["cam0", "cam1", "cam2"], 2, 50.0).to_wgs84([replace(estimate, **changes)], ORIGIN)  # type: ignore[arg-type]
    return sent[0]


def test_three_cameras_verify_a_range_and_a_contested_one_is_degraded() -> None:
    three, coasting = ("cam0", "cam1", "cam2"), TargetState.COASTING
    assert (target(cameras=three).verified, target().verified) == (True, False)
    assert not target(cameras=three, state=coasting).verified, "nobody sees it now"
    assert (target().degraded, target(denied_by=("cam1",)).degraded) == (False, True)
    assert not target(cameras=three, denied_by=("cam3",)).degraded, "of three that agree two are honest"
    assert target(cameras=three).message().verified
    assert not target(cameras=three, rests_on=("cam1",)).verified, "its claims may have tilted all that is seen"
    assert not target(cameras=three, ahead=("cam1",)).verified, "two bear it out, and one that is a second ahead"


def port(*, key: bytes | None = None, streams: Streams | None = None, **section: object) -> MavlinkPort:
    """An endpoint with both profiles."""
    endpoint = EndpointSection(url="udp:127.0.0.1:1", profile=["gcs", "ecef"], **section)  # type: ignore[arg-type]
    made = MavlinkPort(endpoint, MavlinkSection(system_id=1), CONTEXT, key, streams)
    made.refresh(time.time())
    return made


def decoded(frames: list[bytes], key: bytes | None = None) -> list[common.MAVLink_message]:
    """The frames as a receiver reads them."""
    receiver = common.MAVLink(None)
    receiver.robust_parsing = True
    if key is not None:
        receiver.signing.secret_key = key
    return [message for frame in frames for message in receiver.parse_buffer(frame) or []]


def kinds(frames: list[bytes]) -> list[str]:
    return [message.get_type() for message in decoded(frames)]


def test_target_track_is_in_ecef_with_its_covariance_and_own_component() -> None:
    sent = target()
    (message,) = [m for m in decoded(port().targets([sent], 0, True)) if m.get_type() == "TARGET_TRACK_ECEF"]
    assert message.get_srcSystem() == 1
    assert message.get_srcComponent() == ECEF
    np.testing.assert_allclose(message.pos, sent.ecef_m, rtol=0, atol=1e-9)  # doubles travel whole
    assert np.linalg.norm(message.vel) == pytest.approx(math.sqrt(3**2 + 4**2 + 1.5**2), rel=1e-6)
    assert message.cov[0] + message.cov[6] + message.cov[11] == pytest.approx(0.06, rel=1e-6)  # turning keeps the trace
    assert (message.time_usec, message.track_id, message.epoch) == (1_800_000_000_123_456, 1, 7)
    assert (message.camera_mask, message.camera_count, message.meas_age) == (0b101, 2, 250)
    assert message.flags == 1 | 2 | 4 | 32, "two cameras alone: its range is unverified"


def test_adsb_height_is_above_sea_level() -> None:
    (message,) = [m for m in decoded(port().targets([target()], 0, True)) if m.get_type() == "ADSB_VEHICLE"]
    _, _, ellipsoidal_m = enu_to_geodetic(np.array([[10.0, 20.0, 50.0]]), ORIGIN)[0]
    assert message.altitude == round((ellipsoidal_m - 47.6) * 1000)
    assert message.altitude_type == common.ADSB_ALTITUDE_TYPE_GEOMETRIC
    assert (message.lat, message.lon) == (474086799, 85072325)
    assert message.heading == round(math.degrees(math.atan2(3, 4)) * 100)
    assert (message.hor_velocity, message.ver_velocity, message.tslc, message.squawk) == (500, 150, 0, 0)
    assert message.flags & common.ADSB_FLAGS_VALID_HEADING
    assert message.get_srcComponent() == GCS
    assert message.callsign == "SKY00001"


def test_a_hovering_target_has_no_heading() -> None:
    hovering = target(velocity_enu=np.array([0.2, 0.1, 0.0]))
    (message,) = [m for m in decoded(port().targets([hovering], 0, True)) if m.get_type() == "ADSB_VEHICLE"]
    assert not message.flags & common.ADSB_FLAGS_VALID_HEADING


@given(track=st.integers(1, 2**32 - 1))
def test_addresses_stay_in_the_drone_band_and_callsigns_are_eight_characters(track: int) -> None:
    assert 1 <= mavlink.icao(track, STATION) <= 0x3FFF
    assert len(mavlink.callsign(track, STATION)) == 9
    assert mavlink.icao(track, STATION) != mavlink.icao(track + 1, STATION)


def test_rates_are_limited_per_target_not_per_endpoint() -> None:
    slow = port(rate_hz=10.0)
    count = 0
    for k in range(100):  # one second at 100 Hz, two targets
        frames = slow.targets([target(), target(track=2)], k * NS // 100, True)
        count += kinds(frames).count("TARGET_TRACK_ECEF")
    assert 20 <= count <= 24  # ten a second each, a tenth of leeway


def test_lost_is_said_three_times_and_then_nothing() -> None:
    one = port()
    said = kinds(one.targets([target(state=TargetState.LOST)], 0, True))
    for k in range(1, 40):
        said += kinds(one.targets([], k * NS // 10, True))
    assert said == ["TARGET_TRACK_ECEF"] * 3


@pytest.mark.parametrize(
    "broken",
    [
        {"covariance": np.full((6, 6), np.nan)},
        {"position_enu": np.array([np.inf, 0, 0])},
        {"covariance": np.diag([1.0, 1, 1, 1, 1, -1])},
        {"covariance": np.eye(6) * 1e5},
        {"position_enu": np.array([1e6, 0, 0])},
    ],
    ids=["nan", "infinite", "not a covariance", "useless", "elsewhere"],
)
def test_what_is_no_position_never_leaves(broken: dict[str, object]) -> None:
    export = TargetExport(["cam0"], 2, 50.0)
    with pytest.raises(IndexError):
        target(**broken)
    assert export.refused == 0


@given(
    velocity=st.floats(-1e5, 1e5),
    age_s=st.floats(0, 1e9),
    quality=st.floats(0, 1),
    track=st.integers(1, 2**40),
)
def test_no_number_stops_the_loop(velocity: float, age_s: float, quality: float, track: int) -> None:
    wild = target(velocity_enu=np.array([velocity, 0, -velocity]), age_s=age_s, quality=quality, track=track)
    assert len(port().targets([wild], 0, True)) == 2


def test_every_second_both_components_beat_and_neither_is_a_ground_station() -> None:
    messages = decoded(port().second(STATUS, faulted=False))
    beats = [m for m in messages if m.get_type() == "HEARTBEAT"]
    assert {m.get_srcComponent() for m in beats} == {ECEF, GCS}
    assert {m.type for m in beats} == {common.MAV_TYPE_ADSB}
    assert {m.autopilot for m in beats} == {common.MAV_AUTOPILOT_INVALID}
    assert [m.get_type() for m in messages].count("TRACKER_STATUS") == 1


def test_no_heartbeat_from_a_station_at_fault() -> None:
    assert "HEARTBEAT" not in kinds(port().second(STATUS, faulted=True))


def test_boot_time_wraps_after_49_days() -> None:
    old = replace(STATUS, uptime_ms=2**32 + 5)
    (message, *_) = [m for m in decoded(port().second(old, faulted=False)) if m.get_type() == "SYSTEM_TIME"]
    assert message.time_boot_ms == 5


def test_components_keep_their_own_sequences_so_nobody_sees_loss() -> None:
    one = port()
    frames = [
        frame
        for k in range(50)
        for frame in (*one.targets([target()], k * NS, True), *one.second(STATUS, faulted=False))
    ]
    for component in (ECEF, GCS):
        numbers = [m.get_seq() for m in decoded(frames) if m.get_srcComponent() == component]
        assert numbers == [k % 256 for k in range(len(numbers))]


def test_long_texts_come_in_chunks_that_belong_together() -> None:
    (first, second) = decoded(port().text(4, "x" * 60))
    assert (first.id, first.chunk_seq, second.chunk_seq) == (second.id, 0, 1)
    assert first.id > 0


def test_texts_are_limited() -> None:
    one = port()
    assert sum(bool(one.text(4, "hello")) for _ in range(20)) == 5


# Commands


CALIBRATE = mavlink.dialect.MAV_CMD_SKYFIX_CALIBRATE


def command(
    number: int,
    key: bytes | None = None,
    system: int = 255,
    target_system: int = 1,
    component: int = ECEF,
    **params: float,
) -> bytes:
    """A COMMAND_LONG from a ground station."""
    codec = Codec(system, 190, key, link_id=3)
    codec.refresh(time.time())
    values = [params.get(f"p{k}", 0.0) for k in range(1, 8)]
    return codec.encoded(common.MAVLink_command_long_message(target_system, component, number, 0, *values))


def answer(one: MavlinkPort, data: bytes, can: bool = True) -> list[common.MAVLink_message]:
    return decoded(one.receive(data, 1_800_000_000 * NS, lambda _: can))


def test_a_stranger_s_command_is_denied_but_answered() -> None:
    (ack,) = answer(port(), command(CALIBRATE))
    assert (ack.get_type(), ack.result, ack.target_system) == ("COMMAND_ACK", common.MAV_RESULT_DENIED, 255)


def test_a_listed_system_may_calibrate_and_hears_the_end() -> None:
    one = port(commands_from=[255])
    assert [m.result for m in answer(one, command(CALIBRATE))] == [common.MAV_RESULT_IN_PROGRESS]
    assert [m.result for m in answer(one, command(CALIBRATE))] == [common.MAV_RESULT_TEMPORARILY_REJECTED]
    assert [m.result for m in decoded(one.finished(True))] == [common.MAV_RESULT_ACCEPTED]
    assert one.finished(True) == []


def test_a_listed_system_may_set_rates_within_reason() -> None:
    one = port(commands_from=[255])
    assert [m.result for m in answer(one, command(511, p1=45000, p2=100_000))] == [common.MAV_RESULT_ACCEPTED]
    assert [m.result for m in answer(one, command(511, p1=45000, p2=1))] == [common.MAV_RESULT_DENIED]
    assert [m.result for m in answer(one, command(511, p1=33, p2=100_000))] == [common.MAV_RESULT_UNSUPPORTED]
    assert [m.result for m in answer(one, command(400))] == [common.MAV_RESULT_UNSUPPORTED]


def test_an_interval_of_zero_is_the_configured_one_again_and_nothing_is_turned_off() -> None:
    one = port(commands_from=[255], rate_hz=20.0)

    def tracks(second: int) -> int:
        frames = [one.targets([target()], second * NS + k * NS // 20, True) for k in range(20)]
        return sum(kinds(each).count("TARGET_TRACK_ECEF") for each in frames)

    assert tracks(0) == 20
    for second, (interval_us, result, rate) in enumerate(((1_000_000, 0, 1), (-1, 2, 1), (0, 0, 20)), start=2):
        (ack,) = answer(one, command(511, p1=45000, p2=interval_us))
        assert ack.result == result
        assert tracks(second) in {rate, rate + 1}, interval_us  # a tenth of an interval early is not early


@pytest.mark.parametrize("absurd", [float("nan"), float("inf"), float("-inf"), 3e38])
@pytest.mark.parametrize("number", [CALIBRATE, 241, 400, 511, 512])
def test_a_parameter_that_is_no_number_is_refused_and_ends_nothing(number: int, absurd: float) -> None:
    one = port(commands_from=[255])
    (ack,) = answer(one, command(number, **{f"p{k}": absurd for k in range(1, 8)}))
    assert ack.result == (common.MAV_RESULT_IN_PROGRESS if number == CALIBRATE else common.MAV_RESULT_UNSUPPORTED)
    (ack,) = answer(one, command(511, p1=45000, p2=absurd))
    assert ack.result == common.MAV_RESULT_DENIED


def test_commands_for_somebody_else_are_not_ours_to_answer() -> None:
    assert answer(port(commands_from=[255]), command(CALIBRATE, target_system=42)) == []


def test_timesync_is_echoed() -> None:
    asked = Codec(255, 190).encoded(common.MAVLink_timesync_message(tc1=0, ts1=777))
    (reply,) = answer(port(), asked)
    assert (reply.tc1, reply.ts1) == (1_800_000_000 * NS, 777)


EVERY_COMMAND = sorted(common.enums["MAV_CMD"])[:-1]  # without the end marker


@pytest.mark.parametrize("listed", [[], [255]])
def test_what_is_addressed_to_all_and_not_ours_is_the_autopilots_to_answer(listed: list[int]) -> None:
    one, asked = port(commands_from=listed), []
    for number in EVERY_COMMAND:
        for system in (1, 0):
            data = command(number, target_system=system, component=0, p1=1)
            assert decoded(one.receive(data, 0, lambda what: bool(asked.append(what)))) == []
    assert asked == []
    assert one.counters["commands_refused"] == 0


def test_our_own_command_is_answered_though_it_is_addressed_to_all() -> None:
    (ack,) = answer(port(commands_from=[255]), command(CALIBRATE, component=0))
    assert ack.result == common.MAV_RESULT_IN_PROGRESS


def test_a_sensors_calibration_starts_nothing_here() -> None:
    one = port(commands_from=[255])
    for k in range(1, 8):
        (ack,) = answer(one, command(241, **{f"p{k}": 1.0}))
        assert ack.result == common.MAV_RESULT_UNSUPPORTED
    assert one.counters["commands_unsupported"] == 7


def test_each_peer_has_its_own_parser() -> None:
    one, frame = port(commands_from=[255]), command(511, p1=45000, p2=100_000)
    for cut in range(1, len(frame), 3):
        one.receive(b"\xfd\xff", 0, lambda _: True, peer=9)  # begins a frame, and is silent
        assert one.receive(frame[:cut], 0, lambda _: True, peer=1) == []
        assert [m.get_type() for m in decoded(one.receive(frame, 0, lambda _: True, peer=2))] == ["COMMAND_ACK"]
        assert [m.get_type() for m in decoded(one.receive(frame[cut:], 0, lambda _: True, peer=1))] == ["COMMAND_ACK"]


def timesync(ts1: int, *target: int) -> bytes:
    """A request as today's common.xml has it, for a target if there is one."""
    codec = Codec(255, 190)
    request = common.MAVLink_timesync_message(0, ts1)
    payload = struct.pack("<qq", 0, ts1) + bytes(target)
    return bytes(request._pack(codec, request.crc_extra, payload))


@pytest.mark.parametrize(("target", "answered"), [
    ((), True), ((0, 0), True), ((1, GCS), True), ((1, 1), False), ((7, 1), False), ((1, 0), False), ((7, GCS), False),
])  # fmt: skip
def test_timesync_is_answered_for_ourselves_only_and_says_to_whom(target: tuple[int, ...], answered: bool) -> None:
    frames = port().receive(timesync(123_456_789, *target), 1_800_000_000 * NS, lambda _: True)
    assert len(frames) == answered
    for message in decoded(frames):
        assert (message.tc1, message.ts1) == (1_800_000_000 * NS, 123_456_789)
        assert target_of(bytes(message.get_msgbuf())) == (255, 190)


def test_system_time_is_never_that_of_the_data() -> None:
    for now_unix_ns in (0, 1_790_000_000 * NS):
        messages = decoded(port().second(STATUS, faulted=False, now_unix_ns=now_unix_ns))
        told = {m.time_unix_usec for m in messages if m.get_type() == "SYSTEM_TIME"}
        assert told == {now_unix_ns // 1000}


# Identity


def test_two_stations_differ_by_default_and_a_configured_identity_is_taken(tmp_path: Path) -> None:
    drawn: list[set[int]] = []
    calls: list[bytes] = []
    components: list[frozenset[int]] = []
    for k in range(20):
        own = identity_of(MavlinkSection(), "field", tmp_path / str(k))
        assert own == identity_of(MavlinkSection(), "field", tmp_path / str(k))
        drawn.append({mavlink.icao(track, own) for track in range(1, 300)})
        calls.append(mavlink.callsign(7, own))
        assert all(1 <= address <= 0x3FFF for address in drawn[-1])
        assert len(calls[-1]) == 9
        components.append(frozenset((own.component_gcs, own.component_ecef)))
        assert len(components[-1]) == 2
        assert components[-1] <= set(PRIVATE_COMPONENTS), "no id of a vehicle's part, or of a ground station"
    assert len(set(components)) > 10
    assert all(one == other or not one & other for one in components for other in components), "both or neither"
    assert len(set(calls)) == 20
    assert len({min(addresses) for addresses in drawn}) > 10
    own = identity_of(MavlinkSection(), "field", tmp_path)
    for one in (own.component_gcs, own.component_ecef):  # the other one's default, too
        assert identity_of(MavlinkSection(gcs_component=one), "field", tmp_path).component_ecef != one
        assert identity_of(MavlinkSection(ecef_component=one), "field", tmp_path).component_gcs != one
    chosen = MavlinkSection(gcs_component=60, ecef_component=61, icao_first=512, callsign="N7")
    own = identity_of(chosen, "field", tmp_path)
    assert (own.component_gcs, own.component_ecef, mavlink.icao(1, own)) == (60, 61, 512)
    assert mavlink.callsign(1, own) == b"N7000001\0"


def test_another_station_under_our_name_is_said_and_our_own_echo_is_not() -> None:
    clashes = Clashes(1, STATION)
    endpoint = EndpointSection(url="udp:127.0.0.1:1", profile=["gcs"])
    one = MavlinkPort(endpoint, MavlinkSection(system_id=1), CONTEXT, None, clashes=clashes)
    other = MavlinkPort(endpoint, MavlinkSection(system_id=1), CONTEXT, None)
    own = one.second(STATUS, faulted=False) + one.targets([target()], 0, True)
    clashes.sent(own)
    one.receive(b"".join(own), 0, lambda _: True)
    assert clashes.check().level == "ok"
    assert "1/156" in clashes.check().reason
    for frame in (
        other.second(replace(STATUS, uptime_ms=77), faulted=False) + other.targets([target(age_s=2.0)], 0, True)[:1]
    ):
        one.receive(frame, 0, lambda _: True)
    said = clashes.check()
    assert said.level == "warn"
    for what in ("sends as 1/156", "addresses", "calls aircraft SKY"):
        assert what in said.reason
    for key in ("gcs_component", "ecef_component", "icao_first", "callsign"):
        assert f"mavlink.{key}" in said.action


@pytest.mark.parametrize(("callsign", "icao", "clash"), [
    ("SKY00007", 0x4004, True), ("SKYLARK", 0x4004, False), ("OTHER001", 0x4004, False), ("OTHER001", 9, True),
])  # fmt: skip
def test_an_aircraft_of_others_is_a_clash_only_under_our_address_or_callsign(
    callsign: str, icao: int, clash: bool
) -> None:
    clashes = Clashes(1, STATION)
    aircraft = mavlink.adsb_vehicle(target(), CONTEXT)
    aircraft.ICAO_address, aircraft._callsign_raw = icao, callsign.encode()  # packed from this
    for message in decoded([Codec(1, 200).encoded(aircraft)]):
        clashes.hear(message)
    assert (clashes.check().level == "warn") == clash, clashes.check()


# Signing


def test_with_a_key_only_signed_commands_count_and_an_allow_list_does_not_help() -> None:
    one = port(key=KEY, commands_from=[255])
    assert [m.result for m in answer(one, command(CALIBRATE))] == [common.MAV_RESULT_DENIED]
    assert [m.result for m in answer(one, command(CALIBRATE, key=bytes(32)))] == [common.MAV_RESULT_DENIED]
    assert [m.result for m in answer(one, command(CALIBRATE, key=KEY))] == [common.MAV_RESULT_IN_PROGRESS]


def test_a_replayed_command_is_not_obeyed_twice() -> None:
    one = port(key=KEY)
    frame = command(511, key=KEY, p1=45000, p2=100_000)
    assert [m.result for m in answer(one, frame)] == [common.MAV_RESULT_ACCEPTED]
    assert [m.result for m in answer(one, frame)] == [common.MAV_RESULT_DENIED]


def test_a_command_overheard_on_one_endpoint_is_not_obeyed_on_another() -> None:
    streams = Streams(time.time())
    radio, network = port(key=KEY, streams=streams), port(key=KEY, streams=streams)
    frame = command(511, key=KEY, p1=45000, p2=100_000)
    assert [m.result for m in answer(radio, frame)] == [common.MAV_RESULT_ACCEPTED]
    assert [m.result for m in answer(network, frame)] == [common.MAV_RESULT_DENIED]
    assert network.counters["commands_replayed"] == 1


def test_a_command_obeyed_before_a_restart_is_not_obeyed_again_after_it() -> None:
    """pymavlink would: a stream it does not know may begin a minute ago."""
    frame = command(511, key=KEY, p1=45000, p2=100_000)
    restarted = port(key=KEY, streams=Streams(time.time()))
    assert [m.result for m in answer(restarted, frame)] == [common.MAV_RESULT_DENIED]
    assert restarted.counters["commands_behind"] == 1
    fresh = command(511, key=KEY, p1=45000, p2=100_000)
    assert [m.result for m in answer(restarted, fresh)] == [common.MAV_RESULT_ACCEPTED]


def test_why_a_command_was_refused_is_counted() -> None:
    one = port(key=KEY)
    for frame in (command(400), command(400, key=bytes(32)), command(400, key=bytes(32))):
        one.receive(frame, 0, lambda _: True)
    good = command(400, key=KEY)
    for frame in (good, good, good[:-20] + b"\xff" + good[-19:]):
        one.receive(frame, 0, lambda _: True)
    counted = {name: one.counters[f"commands_{name}"] for name in ("unsigned", "forged", "replayed")}
    # The last one was damaged on the way: its checksum is wrong, it is no message at all.
    assert counted == {"unsigned": 1, "forged": 2, "replayed": 1}


@given(times=st.lists(st.tuples(st.integers(0, 3), st.integers(-200, 200)), max_size=40))
def test_a_stream_only_ever_moves_on_and_never_far_ahead(times: list[tuple[int, int]]) -> None:
    """times: (sender, seconds from now); whatever comes, what was believed rises, from the start on, up to a minute."""
    begun_s = 1_800_000_000.0
    now, streams = ticks(begun_s), Streams(begun_s)
    believed: dict[int, int] = {}
    for sender, seconds in times:
        time_ticks = now + seconds * TICKS_PER_S
        if streams.judge((1, sender, 1), time_ticks, now) == "good":
            assert believed.get(sender, now - 1) < time_ticks <= now + 60 * TICKS_PER_S
            believed[sender] = time_ticks


def test_a_forged_frame_from_the_future_poisons_nothing() -> None:
    """pymavlink itself believes the time before it checks the hash, and refuses every good frame afterwards."""
    one = port(key=KEY)
    forger = Codec(255, 190, bytes(32), link_id=3)
    forger.refresh(time.time() + 50 * 365 * 86400)
    forged = forger.encoded(common.MAVLink_command_long_message(1, ECEF, 511, 0, 45000, 100_000, 0, 0, 0, 0, 0))
    assert [m.result for m in answer(one, forged)] == [common.MAV_RESULT_DENIED]
    assert [m.result for m in answer(one, command(511, key=KEY, p1=45000, p2=100_000))] == [common.MAV_RESULT_ACCEPTED]


def test_even_a_good_signature_from_the_future_is_refused() -> None:
    one = port(key=KEY)
    ahead = Codec(255, 190, KEY, link_id=3)
    ahead.refresh(time.time() + 3600)
    frame = ahead.encoded(common.MAVLink_command_long_message(1, ECEF, 511, 0, 45000, 100_000, 0, 0, 0, 0, 0))
    assert [m.result for m in answer(one, frame)] == [common.MAV_RESULT_DENIED]


def test_a_receiver_that_joins_hours_later_accepts_what_we_sign() -> None:
    """Only adding 10 us a message, as pymavlink does, leaves a new receiver more than a minute ahead of us."""
    one = port(key=KEY)
    one.second(STATUS, faulted=False)
    later_s = time.time() + 3 * 3600
    one.refresh(later_s)
    receiver = Codec(255, 190, KEY)
    receiver.refresh(later_s)
    good = [m for frame in one.second(STATUS, faulted=False) for m in receiver.received(frame)]
    assert len(good) == 5
    assert {message.signature for message in good} == {"good"}


def test_signing_time_never_goes_back_behind_what_was_stored() -> None:
    one = port(key=KEY)
    stored = one.refresh(time.time() + 600)
    assert one.refresh(time.time()) >= stored


def test_a_key_others_may_read_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "key"
    path.write_text("ab" * 32)
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="readable by others"):
        read_key(path)
    path.chmod(0o600)
    assert read_key(path) == b"\xab" * 32
    path.write_text("abc")
    with pytest.raises(ConfigError, match="64 hex digits"):
        read_key(path)


@given(data=st.binary(max_size=400))
def test_no_bytes_stop_a_port(data: bytes) -> None:
    one = port(key=KEY, commands_from=[255])
    one.receive(b"\xfd" + data, 0, lambda _: True)
    assert [m.result for m in answer(one, b"\x00" * 300 + command(400, key=KEY))][-1:] == [
        common.MAV_RESULT_UNSUPPORTED
    ]

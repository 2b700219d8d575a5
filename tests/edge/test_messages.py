"""The border: whatever bytes come, they are a valid message or a MessageError; and what is valid survives the trip."""

import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.common.errors import MessageError
from edge.messages import (
    MAX_DETECTIONS,
    MESSAGES,
    Backlog,
    Fix,
    Health,
    Inventory,
    Lens,
    NetworkMessage,
    Targets,
    Tracks,
    camera_key,
    camera_of_key,
    decode,
    encode,
    station_key,
)

KINDS = sorted({*MESSAGES.values(), Backlog, Inventory}, key=lambda kind: kind.__name__)

DETECTION: dict[str, Any] = {
    "track": 3,
    "u_px": 640.5,
    "v_px": 360.25,
    "ray_x": 0.1,
    "ray_y": -0.1,
    "width_px": 8.0,
    "height_px": 6.0,
    "score": 0.9,
    "status": "confirmed",
}
TRACKS: dict[str, Any] = {
    "t_unix_ns": 1_700_000_000_000_000_000,
    "seq": 5,
    "epoch": 1,
    "clock_bound_s": 0.001,
    "size_px": [1280, 720],
    "readout_s": 0.016,
    "detections": [DETECTION],
}

# Anything JSON can say, the numbers that overflow and the nesting that exhausts included.
numbers = st.one_of(
    st.integers(), st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([10**400, 1e308, -0.0])
)
anything = st.recursive(
    st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=20)),
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(st.text(max_size=8), inner, max_size=5)),
    max_leaves=10,
)
names = sorted({name for kind in KINDS for name in kind.__struct_fields__})


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(payload=st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_random_bytes_are_refused_politely(kind: type[msgspec.Struct], payload: bytes) -> None:
    with pytest.raises(MessageError, match="somewhere"):
        decode(payload, kind, where="somewhere")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(content=st.dictionaries(st.sampled_from(names), anything, max_size=12))
def test_what_is_accepted_is_finite_and_survives_the_trip(
    kind: type[msgspec.Struct], content: dict[str, object]
) -> None:
    try:
        message = decode(json.dumps(content).encode(), kind, where="somewhere")
    except MessageError:
        return
    assert decode(encode(message), kind, where="again") == message
    assert all(math.isfinite(number) for number in floats(msgspec.to_builtins(message)))


@given(st.sampled_from(sorted(DETECTION)), anything, st.sampled_from(sorted(TRACKS)), anything)
def test_one_wrong_value_in_a_real_message(inner: str, first: object, outer: str, second: object) -> None:
    for content in (TRACKS | {"detections": [DETECTION | {inner: first}]}, TRACKS | {outer: second}):
        try:
            message = decode(json.dumps(content).encode(), Tracks, where="somewhere")
        except MessageError:
            continue
        assert all(math.isfinite(number) for number in floats(msgspec.to_builtins(message)))
        assert decode(encode(message), Tracks, where="again") == message


@given(st.integers(0, 400), st.binary(min_size=1, max_size=4))
def test_a_message_damaged_on_the_way(position: int, damage: bytes) -> None:
    whole = json.dumps(TRACKS).encode()
    payload = whole[:position] + damage + whole[position + len(damage) :]
    try:
        message = decode(payload, Tracks, where="somewhere")
    except MessageError:
        return
    assert decode(encode(message), Tracks, where="again") == message


def floats(tree: object) -> list[float]:
    if isinstance(tree, dict):
        return [number for value in tree.values() for number in floats(value)]
    if isinstance(tree, list | tuple):
        return [number for value in tree for number in floats(value)]
    return [tree] if isinstance(tree, float) else []


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"t_unix_ns": 5}, "1970: the clock was never set"),
        ({"t_unix_ns": 1.5e18}, "whole numbers only: a float has lost its nanoseconds"),
        ({"seq": -1}, "numbers count up from 0"),
        ({"clock_bound_s": "0.1"}, "text is no number"),
        ({"size_px": [1280]}, "width and height"),
        ({"size_px": [0, 720]}, "an image has pixels"),
        ({"detections": [DETECTION] * (MAX_DETECTIONS + 1)}, "more than any frame holds"),
        ({"detections": [DETECTION | {"u_px": 1e300}]}, "nowhere near the image"),
        ({"detections": [DETECTION | {"status": 1}]}, "no word at all"),
        ({"detections": [DETECTION | {"sigma_px": 0.0}]}, "nothing is known exactly"),
    ],
)
def test_refuses(change: dict[str, object], why: str) -> None:
    with pytest.raises(MessageError):
        decode(json.dumps(TRACKS | change).encode(), Tracks, where=why)


def test_unknown_fields_are_ignored_and_optional_ones_defaulted() -> None:
    message = decode(json.dumps(TRACKS | {"colour": "red"}).encode(), Tracks, where="newer box")
    assert message.detections[0].sigma_px is None
    assert message.seq == 5


@pytest.mark.parametrize("payload", [b"[" * 100_000, b'{"a":' * 100_000, b'{"detections":' + b"[" * 50_000])
def test_nesting_does_not_exhaust_the_stack(payload: bytes) -> None:
    with pytest.raises(MessageError):
        decode(payload, Tracks, where="hostile")


def test_numbers_beyond_a_float_are_refused() -> None:
    lens = Lens(model="radtan", intrinsics=(9e2, 9e2, 6e2, 3e2), distortion=[], rms_px=0.3, size_px=(1280, 720))
    for number in (b"1e999", b"-1e999", b"NaN", b"Infinity", b"1" + b"0" * 400):
        with pytest.raises(MessageError):
            decode(encode(lens).replace(b"600.0", number), Lens, where="hostile")


def test_who_wrote_it_is_in_the_key() -> None:
    assert camera_of_key(camera_key("hill", "cam3", "tracks")) == "cam3"
    assert camera_of_key(camera_key("hill", "cam3")) == "cam3"
    assert camera_of_key(station_key("hill", "targets")) is None
    assert camera_of_key("other/1/hill/cam/cam3/tracks") is None


def test_a_fix_beyond_the_pole_is_refused() -> None:
    fix = {"t_unix_ns": 1_700_000_000_000_000_000, "lat_deg": 91.0, "lon_deg": 0.0, "height_m": 0.0, "quality": 4}
    with pytest.raises(MessageError, match="Fix"):
        decode(json.dumps(fix | {"sigma_m": [1, 1, 1], "frame": "ITRF", "samples": 1}).encode(), Fix, where="receiver")


HEALTH: dict[str, Any] = {
    "t_unix_ns": 2 * 10**18,
    "epoch": 1,
    "level": "ok",
    "items": [{"name": "clock", "level": "ok", "since_unix_ns": 2 * 10**18, "reason": "well"}],
    "counters": {},
}
TARGETS: dict[str, Any] = {
    "t_unix_ns": 2 * 10**18,
    "targets": [
        {
            "track": 1,
            "state": "confirmed",
            "ecef_m": [0.0, 0.0, 0.0],
            "velocity_m_s": [0.0, 0.0, 0.0],
            "covariance": [0.0] * 21,
            "cameras": [],
            "age_s": 0.0,
        }
    ],
}
NETWORK: dict[str, Any] = {"t_unix_ns": 2 * 10**18, "state": "calibrated", "reason": "", "action": ""}
NEWER = st.text(min_size=1, max_size=20).filter(
    lambda word: (
        word
        not in {*["ok", "warn", "fail", "confirmed", "interpolated", "tentative", "coasting", "lost"], "calibrated"}
    )
)


@given(NEWER)
def test_a_word_of_a_later_version_is_read_as_the_most_cautious_that_is_known(word: str) -> None:
    """A new status, level or state does not make the message wrong, and never counts for more than it may."""
    mixed = TRACKS | {"detections": [DETECTION | {"status": word}, DETECTION]}
    tracks = decode(json.dumps(mixed).encode(), Tracks, where="x")
    assert [detection.status for detection in tracks.detections] == ["interpolated", "confirmed"]
    items = [HEALTH["items"][0] | {"level": word}, HEALTH["items"][0]]
    health = decode(json.dumps(HEALTH | {"level": word, "items": items}).encode(), Health, where="x")
    assert (health.level, [item.level for item in health.items]) == ("warn", ["warn", "ok"])
    targets = decode(
        json.dumps(TARGETS | {"targets": [TARGETS["targets"][0] | {"state": word}]}).encode(), Targets, where="x"
    )
    assert targets.targets[0].state == "tentative"
    network = decode(json.dumps(NETWORK | {"state": word}).encode(), NetworkMessage, where="x")
    assert network.state in ("collecting", "suspect")


@pytest.mark.parametrize("wrong", [3, None, ["ok"], {"a": 1}, True])
def test_what_is_no_word_at_all_stays_wrong(wrong: object) -> None:
    with pytest.raises(MessageError):
        decode(json.dumps(HEALTH | {"level": wrong}).encode(), Health, where="x")


def test_a_later_word_excuses_nothing_else() -> None:
    for bad in ({"u_px": 1e9}, {"track": -1}, {"score": "high"}):
        rows = [DETECTION | {"status": "predicted"} | bad]
        with pytest.raises(MessageError):
            decode(json.dumps(TRACKS | {"detections": rows}).encode(), Tracks, where="x")
    # A point that is not known cannot be used: whose position it is is no matter of degree.
    fix = {"t_unix_ns": 2 * 10**18, "lat_deg": 0, "lon_deg": 0, "height_m": 0, "quality": 4}
    fix |= {"sigma_m": [1, 1, 1], "frame": "x", "samples": 1, "of": "mark"}
    with pytest.raises(MessageError):
        decode(json.dumps(fix).encode(), Fix, where="x")


@pytest.mark.parametrize("t_unix_ns", [0, 10**17, 10**18, 2 * 10**18])
def test_a_box_whose_clock_was_never_set_is_heard_to_say_so(t_unix_ns: int) -> None:
    items = [HEALTH["items"][0] | {"since_unix_ns": t_unix_ns, "level": "fail"}]
    health = decode(json.dumps(HEALTH | {"t_unix_ns": t_unix_ns, "items": items}).encode(), Health, where="x")
    assert health.items[0].since_unix_ns == t_unix_ns


def test_health_says_its_version_and_an_older_one_none() -> None:
    assert decode(json.dumps(HEALTH).encode(), Health, where="x").version == ""
    assert decode(json.dumps(HEALTH | {"version": "0.3.0"}).encode(), Health, where="x").version == "0.3.0"

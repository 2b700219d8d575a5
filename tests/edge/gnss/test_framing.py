"""Bytes -> frames: whatever lies between them, however they are cut, and whatever a header claims."""

from hypothesis import given
from hypothesis import strategies as st

from edge.gnss.decoders import decoders
from edge.gnss.decoders.ubx import fletcher
from edge.gnss.framing import HEADER_PATIENCE_S, Framer, Packet
from tools.doubles.receiver import sentence

GGA = sentence("GNGGA,092542.00,4846.4008666,N,00854.7249096,E,4,12,0.47,419.166,M,47.535,M,0.0,0000")
BODY = GGA[1:-5]
NO_SYNC = st.binary(max_size=60).map(lambda noise: noise.replace(b"$", b"").replace(b"\xb5\x62", b"").rstrip(b"\xb5"))


def ubx(message_class: int, message_id: int, payload: bytes) -> bytes:
    """A UBX message."""
    inner = bytes((message_class, message_id)) + len(payload).to_bytes(2, "little") + payload
    return b"\xb5\x62" + inner + fletcher(inner)


def frames_of(*pieces: bytes, end_s: float = 2 * HEADER_PATIENCE_S) -> list[Packet]:
    """What a framer makes of pieces that come at once, and of the silence after them."""
    framer = Framer(decoders())
    return [frame for piece in pieces for frame in framer.feed(piece, 0.0)] + framer.feed(b"", end_s)


def test_a_sentence_and_a_message() -> None:
    assert frames_of(GGA + ubx(1, 7, bytes(92))) == [Packet("nmea", BODY), Packet("ubx", ubx(1, 7, bytes(92)))]


def test_every_cut() -> None:
    stream = GGA + ubx(1, 7, b"\xb5\x62$*") + GGA
    whole = frames_of(stream)
    assert len(whole) == 3
    assert all(frames_of(stream[:at], stream[at:]) == whole for at in range(len(stream)))


def test_a_lower_case_checksum_counts_and_a_missing_or_wrong_one_does_not() -> None:
    assert frames_of(GGA[:-4] + GGA[-4:].lower()) == [Packet("nmea", BODY)]
    assert frames_of(GGA[:-5] + b"\r\n") == []
    assert frames_of(GGA[:-4] + b"00\r\n") == []


def test_a_sentence_longer_than_the_standards_82_bytes() -> None:
    body = "GNGST," + "1" * 200
    assert frames_of(sentence(body)) == [Packet("nmea", body.encode())]


def test_a_new_dollar_inside_a_sentence_restarts_it() -> None:
    assert frames_of(GGA[:30] + GGA) == [Packet("nmea", BODY)]


def test_a_false_header_that_claims_8_kB_holds_nothing_back_for_long() -> None:
    framer = Framer(decoders())
    false = b"\xb5\x62\x01\x07\xff\x1f"
    assert framer.feed(false + GGA, 0.0) == []
    assert framer.feed(b"", HEADER_PATIENCE_S / 2) == []
    assert framer.feed(b"", 2 * HEADER_PATIENCE_S) == [Packet("nmea", BODY)]


def test_a_header_that_claims_more_than_any_message_is_passed_at_once() -> None:
    assert Framer(decoders()).feed(b"\xb5\x62\x01\x07\xff\xff" + GGA, 0.0) == [Packet("nmea", BODY)]


def test_a_message_of_wrong_checksum_hides_no_sentence_inside_it() -> None:
    broken = bytearray(ubx(1, 7, GGA))
    broken[-1] ^= 1
    assert frames_of(bytes(broken)) == [Packet("nmea", BODY)]


def test_reset_forgets_half_a_frame() -> None:
    framer = Framer(decoders())
    framer.feed(GGA[:40], 0.0)
    framer.reset()
    assert framer.feed(GGA[40:], 0.0) == []


@given(st.lists(NO_SYNC, min_size=2, max_size=6))
def test_noise_between_sentences_loses_none(noise: list[bytes]) -> None:
    # The noise has no sync of its own, so every sentence must come through, in order.
    assert frames_of(GGA.join(noise)) == [Packet("nmea", BODY)] * (len(noise) - 1)


@given(st.binary(max_size=400), st.integers(0, 400))
def test_any_bytes_in_any_pieces_give_the_same_frames(data: bytes, at: int) -> None:
    stream = data[: len(data) // 2] + GGA + data[len(data) // 2 :]
    assert frames_of(stream[:at], stream[at:]) == frames_of(stream)


@given(st.binary(max_size=2000))
def test_the_buffer_is_bounded(data: bytes) -> None:
    framer = Framer(decoders())
    framer.feed(data * 10, 0.0)
    framer.feed(b"", 2 * HEADER_PATIENCE_S)
    assert len(framer._buffer) <= 8200

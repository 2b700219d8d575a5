"""Whoever has a camera's own certificate and says again what it said, or dates it ahead: live tracking does not notice.

What is sent is compared, target for target, with what is sent when nobody intrudes.
"""

from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.core.sequence import LEAP, RATE_HZ, SILENT_NS, Sequence
from edge.common.units import NS
from edge.messages import Tracks, camera_key, encode
from tests.calib.station.conftest import Change, Fed
from tools.doubles.box_messages import SITE, Sent
from tools.doubles.flight import T0_UNIX_NS, Spec

SPEC = Spec(cameras=4, uavs=1, rate_hz=15.0, duration_s=12.0)
FROM_S = 6.0  # the site is calibrated, and targets are sent
EPOCH = 1_000  # the box's present start
KEY = camera_key(SITE, "cam1", "tracks")
Intruder = Callable[[list[Tracks], Tracks, np.random.Generator], Tracks]


def repeats(heard: list[Tracks], _: Tracks, rng: np.random.Generator) -> Tracks:
    """A message of this start, said again."""
    return heard[rng.integers(len(heard))]


def repeats_yesterday(heard: list[Tracks], _: Tracks, rng: np.random.Generator) -> Tracks:
    """A message of an earlier start, as it was said then."""
    old = heard[rng.integers(len(heard))]
    return msgspec.structs.replace(old, epoch=EPOCH - 7, t_unix_ns=old.t_unix_ns - 86_400 * NS)


def repeats_as_if_now(heard: list[Tracks], now: Tracks, rng: np.random.Generator) -> Tracks:
    """An earlier start's message whose stamp happens to be of now: only its start gives it away."""
    old = heard[rng.integers(len(heard))]
    return msgspec.structs.replace(old, epoch=EPOCH - 7, t_unix_ns=now.t_unix_ns + 1, seq=now.seq)


def dates_ahead(heard: list[Tracks], now: Tracks, rng: np.random.Generator) -> Tracks:
    """The next numbers, an hour ahead: believed, the box's own would all be old."""
    old = heard[rng.integers(len(heard))]
    ahead_s = 3600 + int(rng.integers(3600))
    return msgspec.structs.replace(old, seq=now.seq + 2, t_unix_ns=now.t_unix_ns + ahead_s * NS)


def dates_a_start_ahead(heard: list[Tracks], now: Tracks, rng: np.random.Generator) -> Tracks:
    """A new start, an hour ahead."""
    ahead = dates_ahead(heard, now, rng)
    return msgspec.structs.replace(ahead, epoch=EPOCH + 1 + int(rng.integers(1000)))


def numbers_high(heard: list[Tracks], now: Tracks, rng: np.random.Generator) -> Tracks:
    """A number beyond all that the box will ever reach, dated now."""
    return msgspec.structs.replace(now, seq=2**53 - int(rng.integers(1000)), t_unix_ns=now.t_unix_ns + 1)


def intrusion(intruder: Intruder | None, each: int = 3) -> Change:
    """The run, with so many of the intruder's messages after each of cam1's own."""
    rng = np.random.default_rng(6)
    heard: list[Tracks] = []

    def apply(sent: Sent) -> Iterator[Sent]:
        if sent.key != KEY:
            yield sent
            return
        own = msgspec.structs.replace(msgspec.json.decode(sent.payload, type=Tracks), epoch=EPOCH)
        yield sent._replace(payload=encode(own))
        if intruder is not None and sent.arrival_ns > T0_UNIX_NS + FROM_S * NS:
            for _ in range(each):
                yield sent._replace(payload=encode(intruder(heard, own, rng)))
        heard.append(own)

    return apply


def flown(fed: Fed) -> list[msgspec.Struct]:
    """Every target that was sent."""
    return [target.message() for _, target in fed.sent]


@pytest.fixture(scope="module")
def undisturbed() -> dict[str, list[msgspec.Struct]]:
    """What is sent when nobody intrudes; made by the first test that asks."""
    return {}


@pytest.mark.parametrize(
    ("intruder", "counted_as"),
    [
        (repeats, "repeated"),
        (repeats_yesterday, "twins"),
        (repeats_as_if_now, "twins"),
        (dates_ahead, "future"),
        (dates_a_start_ahead, "future"),
        (numbers_high, "leapt"),
    ],
)
def test_an_intruder_with_a_camera_s_own_certificate_changes_no_target(
    feed: Callable[..., Fed],
    undisturbed: dict[str, list[msgspec.Struct]],
    intruder: Intruder,
    counted_as: str,
) -> None:
    if not undisturbed:
        undisturbed["sent"] = flown(feed(SPEC, intrusion(None)))
        assert len(undisturbed["sent"]) > 100
    fed = feed(SPEC, intrusion(intruder))
    assert flown(fed) == undisturbed["sent"]
    intruded = 3 * round((SPEC.duration_s - FROM_S) * SPEC.rate_hz)
    cam1 = fed.station.intake.cameras["cam1"]
    assert cam1.counters[counted_as] == pytest.approx(intruded, abs=6), "each is counted"
    assert fed.station.calibration.suspects == {}
    assert fed.station.health is not None
    shown = next(item for item in fed.station.health.items if item.name == "camera cam1")
    assert shown.level == ("ok" if intruder is repeats else "warn"), "a link that repeats itself is no alarm"


numbers = st.tuples(st.integers(0, 3), st.integers(0, 10**6), st.integers(0, 40 * NS))


@given(said=st.lists(numbers, max_size=60))
def test_numbers_only_rise_within_a_start_and_no_faster_than_a_box_counts(said: list[tuple[int, int, int]]) -> None:
    """said: (start, number, pause before it)."""
    sequence, now_ns = Sequence(), 10**18
    for epoch, seq, pause_ns in said:
        now_ns += pause_ns
        before = (sequence.epoch, sequence.next_seq, sequence.last_ns)
        verdict = sequence.judge(epoch, seq, now_ns)
        assert (sequence.epoch, sequence.next_seq, sequence.last_ns) == before, "to judge moves nothing"
        if verdict not in ("next", "start"):
            continue
        assert sequence.take(epoch, seq, now_ns) >= 0
        if verdict == "next":
            assert (epoch, seq) >= before[:2]  # type: ignore[operator]
            assert seq - before[1] <= LEAP + RATE_HZ * (now_ns - before[2]) / NS
        elif before[0] is not None and epoch < before[0]:
            assert now_ns - before[2] >= SILENT_NS

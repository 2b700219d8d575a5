"""What frames are signed with, whatever a clock does for a moment."""

import random
import time
from contextlib import closing
from pathlib import Path

import pytest

from calib.station.config import SiteSection
from calib.station.core.calibration import Phase
from calib.station.outputs.mavlink.codec import ticks
from calib.station.outputs.mavlink.output import open_output
from calib.station.outputs.mavlink.signing_time import CLOCK_SET_S, LEAP_LASTS_S, LEAP_S, SIGNED_AHEAD_S, SigningTime
from calib.station.outputs.output import OutputContext, StationStanding

NOW_S = 1_780_000_000.0
YEARS_S = 10 * 365 * 86_400.0


def run(signing: SigningTime, clock: list[tuple[float, float]], *, disciplined: bool = True) -> list[float | None]:
    """Signed times, less the true time, second after second. clock: for how long, and how far off it is."""
    found, true_s = [], 0.0
    for lasts_s, off_s in clock:
        for _ in range(int(lasts_s)):
            true_s += 1.0
            said = signing.at(NOW_S + true_s + off_s, true_s, disciplined=disciplined)
            found.append(None if said is None else said.signed_unix_s - NOW_S - true_s)
    return found


@pytest.mark.parametrize("off_s", [YEARS_S, -YEARS_S / 20, 3600.0, 1.5 * LEAP_S])
def test_a_moment_ahead_is_not_followed(off_s: float) -> None:
    found = run(SigningTime(0.0), [(100, 0.0), (4, off_s), (100, 0.0)])
    assert found == pytest.approx([0.0] * len(found))


def test_a_leap_that_lasts_is_followed_and_one_back_never_signs_an_older_time() -> None:
    found = run(SigningTime(0.0), [(10, 0.0), (2 * LEAP_LASTS_S, 3600.0)])
    assert found[-1] == pytest.approx(3600.0)
    signing = SigningTime(0.0)
    assert run(signing, [(100, 0.0), (200, -3600.0)])[-1] == pytest.approx(-100.0, abs=101)  # it stands still


def test_a_moment_of_2036_at_the_start_or_before_it_is_taken_back_once_the_clock_has_been_good() -> None:
    signing = SigningTime(0.0)
    found = run(signing, [(4, YEARS_S), (300, 0.0)])
    assert found[0] == YEARS_S
    assert found[-1] == pytest.approx(0.0)
    assert signing.taken_back == 1
    stored = SigningTime(NOW_S + YEARS_S)  # what such a moment left to this start
    assert run(stored, [(300, 0.0)])[-1] == pytest.approx(0.0)


def test_a_clock_that_nobody_disciplines_takes_nothing_back() -> None:
    """A machine without a battery starts in 2021 and is not told the time: the newer one is right."""
    signing = SigningTime(NOW_S)
    assert run(signing, [(600, -5 * 365 * 86_400.0)], disciplined=False)[-1] == pytest.approx(-600.0)
    assert signing.taken_back == 0


def test_before_the_clock_is_set_nothing_is_signed_and_then_at_once() -> None:
    found = run(SigningTime(0.0), [(50, CLOCK_SET_S - NOW_S - 86_400.0), (5, 0.0)])
    assert found[:50] == [None] * 50
    assert found[50:] == pytest.approx([0.0] * 5)


@pytest.mark.parametrize("seed", range(20))
def test_whatever_a_clock_does_signed_times_only_grow_but_where_that_is_told(seed: int) -> None:
    draw = random.Random(seed)
    signing, last_s, now_s = SigningTime(draw.choice([0.0, NOW_S, NOW_S + YEARS_S])), 0.0, 0.0
    for _ in range(30):
        off_s = draw.choice([0.0, 0.0, 5.0, -5.0, 40.0, -3600.0, 86_400.0, YEARS_S, -NOW_S])
        for _ in range(draw.choice([1, 4, 70, 200])):
            now_s += draw.choice([0.2, 1.0, 3.0])
            before = signing.taken_back
            said = signing.at(NOW_S + now_s + off_s, now_s, disciplined=draw.random() < 0.9)
            if said is None:
                continue
            assert said.signed_unix_s >= last_s or signing.taken_back > before
            if signing.taken_back > before:
                assert last_s - said.signed_unix_s > SIGNED_AHEAD_S - 10
            last_s = said.signed_unix_s


def test_a_station_that_starts_before_its_clock_is_set_is_silent_where_it_signs_and_goes_on_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "key").touch(0o600)
    (tmp_path / "key").write_text("07" * 32)
    now_s, kept, heard = 86_400.0, list[int](), list[str]()
    monkeypatch.setattr("calib.station.outputs.mavlink.output.time.time", lambda: now_s)
    context = OutputContext(
        where="mavlink",
        site=SiteSection(name="hill"),
        folder=tmp_path,
        epoch=1,
        signing_ticks=0,
        record=lambda url, _: heard.append(url),
        keep_signing_ticks=kept.append,
    )
    signed, plain = (f"udp:127.0.0.1:{port}" for port in (14_991, 14_992))
    endpoints = [{"url": signed, "profile": ["ecef"], "signing_key": "key"}, {"url": plain, "profile": ["ecef"]}]
    output = open_output({"endpoint": endpoints}, context)
    nobody = StationStanding(time.time_ns(), 0, Phase.COLLECTING, "being checked", "", "", (), None, 0, 0)
    with closing(output):
        output.second(nobody, [], 0)
        assert set(heard) == {plain}
        assert kept == []
        assert [check.level for check in output.checks(0) if check.name == "mavlink signing"] == ["warn"]
        now_s = NOW_S
        output.second(nobody, [], 10**9)
        assert set(heard) == {plain, signed}
        assert kept == [ticks(NOW_S)]
        assert not [check for check in output.checks(0) if check.name == "mavlink signing"]

"""Whom chronyd follows, by real daemons: a base that follows nobody, and one that the internet contradicts."""

import datetime as dt
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.certs.authority import Authority
from edge.clock.chrony import conflict_of, of_chrony, read_chrony
from edge.clock.state import ClockState, check_clock
from tests.conftest import Until
from tests.edge.clock.daemons import NTP_PORT, asked, chronyds, following, serving
from tests.places import DEPLOY

LIMIT_S = 0.01
SETTLES_S = 25.0  # four polls of a second, and a busy machine

LOCAL = "7F7F0101,,10,1796003934.68,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,Normal"
OF_LOCAL = "C0A80701,192.168.7.1,11,1796003934.68,0.0001,0.0,0.0,0.0,0.0,0.0,0.0003,0.0001,0.5,Normal"


@pytest.mark.parametrize("line", [LOCAL, LOCAL.replace(",10,", ",1,"), OF_LOCAL, OF_LOCAL.replace(",11,", ",13,")])
def test_a_clock_that_follows_nobody_has_no_bound(line: str) -> None:
    state = of_chrony(line)
    assert (state.bound_s, state.synced) == (None, False)
    assert "nobody here knows UTC" in state.reason
    assert state.action


@pytest.mark.parametrize("stratum", range(1, 10))
def test_a_clock_that_follows_a_server_has_one(stratum: int) -> None:
    assert of_chrony(OF_LOCAL.replace(",11,", f",{stratum},")).bound_s == pytest.approx(0.00035)


@given(st.text(max_size=200))
def test_whatever_the_sources_say(text: str) -> None:
    assert isinstance(conflict_of(text), str)


def test_a_conflict_is_a_warning_and_names_whom() -> None:
    state = ClockState(
        0.001, "chrony", True, "chrony follows 192.168.7.1 within 1 ms", conflict="1.2.3.4 says otherwise"
    )
    check = check_clock(state, LIMIT_S)
    assert (check.level, check.action) == ("warn", "see who is right: chronyc -n sources")
    assert "1.2.3.4" in check.reason


@pytest.mark.program("chronyd")
def test_an_isolated_base_and_its_box_know_that_nobody_knows_utc(tmp_path: Path, until: Until) -> None:
    box = following("9")
    with chronyds(tmp_path, serving(9, "stratum 10 orphan"), box):
        for number, told in ((0, "follows nobody and serves its own clock"), (1, "127.0.0.9, which follows nobody")):
            assert until(lambda at=number, words=told: words in _reason(at), within_s=SETTLES_S), _reason(number)
            state = read_chrony(*asked(number))
            assert state is not None
            assert state.bound_s is None


@pytest.mark.program("chronyd")
def test_a_box_with_internet_follows_its_base_and_tells_the_conflict(tmp_path: Path, until: Until) -> None:
    """Base 300 ms off, three servers of the internet that agree: the base's own words in the box's configuration."""
    servers = [serving(byte, "stratum 3") for byte in (12, 13, 14, 15)]
    (line,) = (line for line in (DEPLOY / "chrony/box.conf").read_text().splitlines() if line.startswith("server "))
    options = line.partition("xleave")[2]  # whom it believes; how often it asks is the test's
    box = following(f"12 {options} offset 0.3", "13", "14", "15")
    with chronyds(tmp_path, *servers, box):
        assert until(lambda: "127.0.0.13" in _conflict(4), within_s=SETTLES_S), _reason(4)
        state = read_chrony(*asked(4))
    assert state is not None
    assert "follows 127.0.0.12" in state.reason
    assert "127.0.0.14 says 300 ms otherwise" in state.conflict


def _reason(number: int) -> str:
    state = read_chrony(*asked(number))
    return "" if state is None else state.reason


def _conflict(number: int) -> str:
    state = read_chrony(*asked(number))
    return "" if state is None else state.conflict


@pytest.mark.program("chronyd")
def test_a_box_takes_time_from_whoever_proves_to_be_its_base_and_from_nobody_else(tmp_path: Path, until: Until) -> None:
    """NTS with the site's own certificates, as deploy/chrony/lay.sh lays them; and a base of another authority."""
    now = dt.datetime.now(dt.UTC)
    for name in ("ours", "others"):
        authority = Authority.create(tmp_path / name, "hill", now)
        authority.issue("base", "station", cameras=(), addresses=("127.0.0.1",), days=30, now=now)
    own = tmp_path / "ours/issued/base"
    port = NTP_PORT + 5000
    base = f"{serving(1, 'stratum 3')}\nntsport {port}\nntsserverkey {own}/key.pem\nntsservercert {own}/certificate.pem"
    boxes = [
        f"{following(f'1 nts ntsport {port}')}\nntstrustedcerts {tmp_path / name}/authority.pem\nnosystemcert"
        for name in ("ours", "others")
    ]
    with chronyds(tmp_path, base, *boxes):
        assert until(lambda: "follows 127.0.0.1" in _reason(1), within_s=SETTLES_S), _reason(1)
        assert "no source it trusts" in _reason(2)

"""The page without a browser: who may look, what is said, what is fed, and a page that dies or does not listen."""

import asyncio
import http.client
import os
import signal
import socket
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geodesy import enu_to_ecef
from calib.station import config
from calib.station.archive.recording import Recorder
from calib.station.config import BaseConfig, CameraSection, SiteSection, StatusSection
from calib.station.page import past, wire, words
from calib.station.page.guard import RequestFilter
from calib.station.page.live import Live
from calib.station.page.process import PageProcess, available
from calib.station.page.steps import next_step, steps
from calib.station.status.access import SESSION_S, SHORTEST_TOKEN, TokenGate, read_token, session, session_holds
from calib.station.status.attempts import FREE_ATTEMPTS, MOST_REMEMBERED, Attempts, with_door
from calib.station.status.status import CameraStatus, EndpointStatus, PairStatus, StationStatus
from edge.common.errors import ConfigError, MessageError
from edge.messages import Health, HealthItem, NetworkMessage, Target, Targets, encode

ORIGIN = (47.4085, 8.5071, 580.0)
T_NS = 1_800_000_000 * 10**9
TOKEN = "f" * SHORTEST_TOKEN


def camera(name: str, **changes: Any) -> CameraStatus:
    facts: dict[str, Any] = {
        "id": name,
        "online": True,
        "present": True,
        "last_frame_s": 0.1,
        "detections_per_frame": 1.0,
        "clock_bound_s": 1e-3,
        "clock_offset_s": 0.0,
        "surveyed": True,
        "calibrated": True,
        "suspect": "",
        "missed": 0,
        "reason": "sends frames",
        "counters": {},
    }
    return CameraStatus(**(facts | changes))


def status(cameras: list[CameraStatus] | None = None, **changes: Any) -> StationStatus:
    """A station that is well."""
    cameras = cameras or [camera("cam0"), camera("cam1"), camera("cam2")]
    item = HealthItem(name="link", level="ok", since_unix_ns=T_NS, reason="open")
    facts: dict[str, Any] = {
        "site": "hill",
        "version": "0.1.0",
        "epoch": 1,
        "t_unix_ns": T_NS,
        "uptime_s": 60.0,
        "phase": "calibrated",
        "reason": "3 cameras, 0.50 px",
        "action": "",
        "first_solve_s": 15.0,
        "origin": ORIGIN,
        "network": "0123456789ab",
        "rms_px": 0.5,
        "sigma_m": 0.1,
        "solving": False,
        "cameras": cameras,
        "pairs": [PairStatus(one="cam0", other="cam1", shared_s=60, residual_mrad=0.4)],
        "targets": [],
        "tentative": 0,
        "latency_ms": (1.0, 2.0),
        "endpoints": [EndpointStatus(url="udp:127.0.0.1:9", sent=5, sent_bytes=500, errors=0, last_error="")],
        "recording": None,
        "health": Health(t_unix_ns=T_NS, epoch=1, level="ok", items=[item], counters={}),
        "counters": {},
    }
    return StationStatus(**(facts | changes))


# Who may look


NOW_S, HERE = 1_800_000_000.0, "192.168.7.9"


def passes(token: str, headers: dict[str, str], query: str = "", at_s: float = NOW_S) -> bool:
    return TokenGate(token).judge(headers, query, HERE, at_s) == "in"


def test_without_a_token_only_this_machine_s_own_names_are_answered() -> None:
    for host in ("127.0.0.1:8080", "localhost:8080", "[::1]:8080", "127.0.0.1"):
        assert passes("", {"host": host})
    for host in ("evil.example", "192.168.7.1:8080", "127.0.0.1.evil.example", "", "[", "]["):
        assert not passes("", {"host": host})


@pytest.mark.parametrize(
    ("scheme", "path", "location", "secure"),
    [
        ("http", "/setup", b"/setup", False),
        ("https", "/", b"/", True),
        ("https", "//evil.example/", b"/evil.example/", True),
        ("http", "/\r\nSet-Cookie: a=b", b"/%0D%0ASet-Cookie%3A%20a%3Db", False),
    ],
)
def test_a_token_in_the_address_becomes_a_session_of_its_own_scheme(
    scheme: str, path: str, location: bytes, secure: bool
) -> None:
    scope = {
        "type": "http",
        "scheme": scheme,
        "path": path,
        "query_string": f"token={TOKEN}".encode(),
        "headers": [(b"host", b"192.168.7.1:8080")],
    }
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(RequestFilter(None, TOKEN)(scope, None, send))  # type: ignore[arg-type]
    headers = dict(sent[0]["headers"])
    assert (sent[0]["status"], headers[b"location"]) == (303, location)
    assert headers[b"set-cookie"].endswith(b"; Secure") is secure


def test_a_token_comes_by_address_or_bearer_and_its_session_by_cookie() -> None:
    host = {"host": "192.168.7.1:8080"}
    assert passes(TOKEN, host, f"token={TOKEN}")
    assert passes(TOKEN, host | {"authorization": f"Bearer {TOKEN}"})
    cookie = {"cookie": f"other=1; skyfix={session(TOKEN, NOW_S)}"}
    assert passes(TOKEN, host | cookie)
    assert not passes(TOKEN, host | {"origin": "http://evil.example"}, f"token={TOKEN}")
    assert not passes(TOKEN, host | {"origin": "http://["}, f"token={TOKEN}")


def test_a_session_ends_by_itself_and_with_its_token_and_is_no_token() -> None:
    value = session(TOKEN, NOW_S)
    assert TOKEN not in value
    assert session_holds(TOKEN, value, NOW_S + SESSION_S - 2)
    assert not session_holds(TOKEN, value, NOW_S + SESSION_S + 1)
    assert not session_holds(TOKEN + "x", value, NOW_S)
    ends, _, seal = value.partition(".")
    for forged in (TOKEN, f"{int(ends) + 1}.{seal}", f"{ends}.", f"{'9' * 5000}.{seal}", "", "\u0661.x"):
        assert not session_holds(TOKEN, forged, NOW_S)


@given(st.text(max_size=40), st.text(max_size=40), st.text(max_size=80))
def test_nothing_else_passes(query: str, cookie: str, authorization: str) -> None:
    headers = {"host": "127.0.0.1", "cookie": cookie, "authorization": authorization}
    assert not passes(TOKEN, headers, query)


def test_wrong_tokens_wait_longer_each_time_and_who_has_a_session_does_not() -> None:
    """Fifteen hundred a second for an hour: a hundredth of a thousandth of them are looked at."""
    gate, host = TokenGate(TOKEN), {"host": "192.168.7.1:8080"}
    looked_at = 0
    for k in range(36_000):
        looked_at += gate.judge(host, f"token={k:016}", HERE, NOW_S + k / 10) == "refused"
    assert looked_at == gate.attempts.wrong < 40
    assert gate.judge(host, f"token={TOKEN}", HERE, NOW_S + 3600) == "wait"
    assert gate.judge(host | {"cookie": f"skyfix={session(TOKEN, NOW_S)}"}, "", HERE, NOW_S + 3600) == "in"
    assert gate.judge(host, f"token={TOKEN}", "192.168.7.10", NOW_S + 3600) == "in", "another address"
    assert gate.judge(host, f"token={TOKEN}", HERE, NOW_S + 2 * 3600 + 1) == "in"
    said = with_door(status(), gate.attempts, 3, NOW_S + 3600)
    assert said.health.level == "warn"
    assert HERE in said.health.items[-1].reason
    assert (said.counters["wrong_tokens"], said.counters["turned_away"]) == (gate.attempts.wrong, 3)


def test_a_network_of_addresses_counts_as_one_and_what_is_remembered_is_bounded() -> None:
    attempts = Attempts()
    for k in range(FREE_ATTEMPTS):
        attempts.failed(f"2001:db8::{k:x}", NOW_S)
    assert not attempts.may("2001:db8::ffff", NOW_S)
    for k in range(3 * MOST_REMEMBERED):
        attempts.failed(f"10.{k >> 16}.{k >> 8 & 255}.{k & 255}", NOW_S)
    assert len(attempts._tried) == MOST_REMEMBERED


def test_a_token_that_others_may_read_or_that_is_short_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN)
    file.chmod(0o644)
    with pytest.raises(ConfigError, match="others may read"):
        read_token(file)
    file.chmod(0o600)
    assert read_token(file) == TOKEN
    for bad in ("short", "", "x" * 15, "with a space in the middle of it"):
        file.write_text(bad)
        with pytest.raises(ConfigError, match="is no token"):
            read_token(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_token(tmp_path / "none")


def test_an_address_for_others_needs_a_token() -> None:
    cameras = [CameraSection(id=f"cam{k}") for k in range(3)]
    told = BaseConfig(site=SiteSection(name="hill"), camera=cameras, status=StatusSection(host="0.0.0.0"))
    with pytest.raises(ConfigError, match="can be reached by others"):
        config.checked(told, Path("base.toml"))


# What is said


def test_all_is_well() -> None:
    pairs = [
        PairStatus(one=a, other=b, shared_s=60, residual_mrad=0.4) for a, b in (("cam0", "cam1"), ("cam1", "cam2"))
    ]
    found = steps(status(pairs=pairs))
    assert [step.name for step in found] == ["survey", "aim", "check", "calibrate", "go"]
    assert next_step(found) is None


def test_each_step_says_what_is_missing() -> None:
    wrong = HealthItem(name="clock cam1", level="fail", since_unix_ns=T_NS, reason="not set", action="chronyc tracking")
    cases = {
        "survey": status([camera("cam0"), camera("cam1"), camera("cam2", surveyed=False)]),
        "aim": status([camera("cam0"), camera("cam1"), camera("cam2", online=False)]),
        "check": status(health=Health(t_unix_ns=T_NS, epoch=1, level="fail", items=[wrong], counters={})),
        "calibrate": status(phase="collecting", reason="waiting for cam1", action="fly"),
        "go": status(endpoints=[]),
    }
    for name, told in cases.items():
        step = next(step for step in steps(told) if step.name == name)
        assert step.level == "fail", name
        assert step.reason
        assert step.action
        assert f'data-step="{name}" data-level="fail"' in words.step_list(told)
    assert "cam2" in steps(cases["aim"])[1].reason


def test_a_receiver_is_shown_with_all_that_its_box_says_of_it() -> None:
    line = "RTK fixed, 12 satellites, corrections 1 s old, base 3.2 km away; sigma 8 mm horizontal; can be trusted"
    item = HealthItem(name="gnss", level="ok", since_unix_ns=T_NS, reason=line)
    health = Health(t_unix_ns=T_NS, epoch=1, level="ok", items=[item], counters={})
    assert f"<dt>receiver</dt><dd>{line}</dd>" in words.camera_card(camera("cam1"), health)
    assert "<dt>receiver</dt><dd>none</dd>" in words.camera_card(camera("cam1"), None)


@pytest.mark.parametrize(
    ("frame", "sigma_m", "said"),
    [("ITRF2020", 0.0, "have a position, in ITRF2020"), ("unknown", 1.0, "every sigma that is sent holds 1 m for it")],
)
def test_the_first_step_says_what_is_known_of_the_frame(frame: str, sigma_m: float, said: str) -> None:
    assert said in steps(status(frame=frame, frame_sigma_m=sigma_m))[0].reason


def test_a_camera_says_why_it_is_red() -> None:
    text = words.camera_card(camera("cam1", online=False, last_frame_s=14.2, reason="last frame 14 s ago"), None)
    assert 'data-level="fail"' in text
    assert "last frame 14 s ago" in text
    assert "silent" in text


@pytest.mark.parametrize("first_solve_s", [3.0, 15.0, 60.0])
def test_the_seconds_a_pair_must_share_are_those_of_the_station(first_solve_s: float) -> None:
    for shared_s, level in ((0.1, "fail"), (0.5, "warn"), (1.0, "ok")):
        pair = PairStatus(one="cam0", other="cam1", shared_s=round(shared_s * first_solve_s), residual_mrad=None)
        assert words.pair_level(pair, first_solve_s) == level
        cameras = [camera(name, calibrated=False) for name in ("cam0", "cam1")]
        aim = steps(status(cameras, pairs=[pair], first_solve_s=first_solve_s))[1]
        assert (aim.level == "ok") is (level == "ok")
        assert level == "ok" or f"{first_solve_s:g} s" in aim.reason


def test_one_bad_pair_is_one_red_cell() -> None:
    pairs = [
        PairStatus(one="cam0", other="cam1", shared_s=60, residual_mrad=0.4),
        PairStatus(one="cam0", other="cam2", shared_s=60, residual_mrad=40.0),
        PairStatus(one="cam1", other="cam2", shared_s=60, residual_mrad=None),
    ]
    matrix = words.pair_matrix(status(pairs=pairs), {"cam0": 1000.0, "cam2": 2000.0})
    assert matrix.count('data-level="fail"') == 2  # a cell and its mirror
    assert "40.0 mrad, 60.0 px" in matrix


@given(st.text(max_size=30))
def test_foreign_words_never_become_html(text: str) -> None:
    hostile = f"<img src=x onerror=alert(1)>{text}"
    told = status([camera("cam0", reason=hostile, suspect=hostile)], reason=hostile, action=hostile)
    for html in (words.banner(told), words.step_list(told), words.camera_card(told.cameras[0], None)):
        assert "<img" not in html


# What is fed


def targets(*places: tuple[float, float, float]) -> Targets:
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.diag([0.01, 0.04, 0.09])
    found = [
        Target(
            track=k,
            state="confirmed",
            ecef_m=tuple(enu_to_ecef(np.array([place]), ORIGIN)[0].tolist()),
            velocity_m_s=(0.0, 0.0, 0.0),
            covariance=covariance[np.triu_indices(6)].tolist(),
            cameras=["cam0", "cam1"],
            age_s=1.0,
        )
        for k, place in enumerate(places)
    ]
    return Targets(t_unix_ns=T_NS, targets=found)


def test_a_target_is_shown_where_it_is() -> None:
    live = Live()
    live.take("status", encode(status()), 0.0)
    live.take("targets", encode(targets((10.1, -19.9, 30.0))), 0.0)
    (row,) = live.frame(0.1)["targets"]
    assert np.allclose(row["at"], (10.1, -19.9, 30.0), atol=0.01)
    ee, _, _, nn, _, uu = row["spread"]
    assert ee + nn + uu == pytest.approx(0.14, rel=1e-3)  # a rotation keeps the trace
    assert live.coverage == {(1, -2): 1}
    assert live.frame(5.0)["targets"] == []  # old ones are not shown as new


def test_trails_and_coverage_do_not_grow_for_ever() -> None:
    live = Live()
    live.take("status", encode(status()), 0.0)
    for k in range(2000):
        live.take("targets", encode(targets((0.1 * k, 0.0, 30.0))), 0.1 * k)
    assert len(live.scene()["trails"][0]) <= 300


@given(st.text(max_size=10).filter(lambda name: "\0" not in name), st.binary(max_size=50))
def test_packets_come_out_as_they_went_in(name: str, payload: bytes) -> None:
    assert wire.unpack(wire.pack(name, payload)) == (name, payload)


def test_a_packet_without_a_name_is_refused() -> None:
    with pytest.raises(MessageError):
        wire.unpack(b"no zero in here")


def test_a_recording_is_looked_up_by_time(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, "hill", min_free_mb=1)
    network = NetworkMessage(t_unix_ns=T_NS, state="calibrated", reason="", action="", origin=ORIGIN)
    recorder.write("skyfix/1/hill/station/network", encode(network), T_NS)
    for k in range(100):
        recorder.write("skyfix/1/hill/station/targets", encode(targets((float(k), 0.0, 30.0))), T_NS + k * 10**8)
    recorder.close()
    ((name, _),) = past.listing(tmp_path)
    assert past.named(tmp_path, name) == tmp_path / name
    assert past.named(tmp_path, "../" + name) is None
    found = past.Past.read(tmp_path / name)
    assert found.seconds == pytest.approx(9.9, abs=0.01)
    assert found.at(5.0)["targets"][0]["at"][0] == pytest.approx(50.0, abs=0.02)


# A process that may die


@pytest.fixture
def page(tmp_path: Path) -> Any:
    if not available():
        pytest.skip("the extra `page` is not installed")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with PageProcess(StatusSection(port=port), tmp_path, "hill", recordings=None, report=tmp_path / "r.html") as made:
        yield made


def get(page: PageProcess, path: str, until: Any) -> tuple[int, bytes]:
    """Ask the page while the station's loop goes round."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=60)
    connection.request("GET", path)
    assert until(lambda: page.commands() is not None and page.pid is not None, within_s=20)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def test_it_starts_when_somebody_looks_and_again_when_it_died(page: PageProcess, until: Any) -> None:
    page.show(status())
    page.commands()
    assert page.pid is None
    assert get(page, "/status.json", until)[1] != b""
    first = page.pid
    assert first is not None
    assert msgspec.json.decode(get(page, "/status.json", until)[1])["site"] == "hill"
    os.kill(first, signal.SIGKILL)
    assert until(lambda: page.commands() == [] and page.pid != first, within_s=10)
    assert get(page, "/metrics", until)[0] == 200
    assert page.starts == 2


def test_a_page_that_does_not_listen_costs_packets_and_nothing_else(page: PageProcess, until: Any) -> None:
    page.show(status())
    get(page, "/status.json", until)
    assert page.pid is not None
    os.kill(page.pid, signal.SIGSTOP)
    for k in range(200):
        page.feed(f"tracks/cam{k}", b"x" * 100_000)
    assert page.dropped > 0
    os.kill(page.pid, signal.SIGCONT)

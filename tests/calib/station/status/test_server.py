"""The bare status over HTTP: what is served, to whom, and an end in time."""

import http.client
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import pytest

from calib.station.config import StatusSection
from calib.station.status.server import MOST_CONNECTIONS, StatusServer
from calib.station.status.status import StationStatus
from edge.common.errors import ConfigError
from tests.calib.station.page.test_page import TOKEN, status
from tests.conftest import Until


@contextmanager
def serving(folder: Path, token_file: str | None = None) -> Iterator[StatusServer]:
    with StatusServer(StatusSection(port=0, token_file=token_file), folder) as server:
        yield server


def get(server: StatusServer, path: str, **headers: str) -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers["Content-Type"], body


def test_the_newest_status_is_served_as_json_and_as_metrics(tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        assert get(server, "/status.json")[0] == 503  # nothing to tell yet
        server.show(status())
        server.show(status(reason="newer"))
        code, kind, body = get(server, "/status.json")
        assert (code, kind) == (200, "application/json")
        told = msgspec.json.decode(body, type=StationStatus)
        assert told.counters.keys() == {"wrong_tokens", "token_attempts_waited", "turned_away"}
        assert msgspec.structs.replace(told, counters={}) == status(reason="newer")
        code, kind, body = get(server, "/metrics")
        assert (code, kind) == (200, "text/plain; version=0.0.4")
        assert b"skyfix_up_seconds 60.0\n" in body
        assert get(server, "/")[0] == 404


def test_who_has_no_token_or_another_name_for_this_machine_gets_nothing(tmp_path: Path) -> None:
    (tmp_path / "token").touch(0o600)
    (tmp_path / "token").write_text(TOKEN)
    with serving(tmp_path, "token") as server:
        server.show(status())
        assert get(server, "/status.json")[0] == 401
        assert get(server, f"/status.json?token={TOKEN}")[0] == 200
        assert get(server, "/status.json", Authorization=f"Bearer {TOKEN}")[0] == 200
    with serving(tmp_path) as server:
        server.show(status())
        assert get(server, "/metrics", Host="evil.example")[0] == 401


def test_a_port_that_another_holds_is_named(tmp_path: Path) -> None:
    with serving(tmp_path) as server, pytest.raises(ConfigError, match=f":{server.port} cannot be had"):
        StatusServer(StatusSection(port=server.port), tmp_path)


def test_it_ends_in_time_with_a_browser_that_sends_nothing_and_when_it_never_ran(tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        silent = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
        silent.connect()
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 2.0
    silent.close()
    StatusServer(StatusSection(port=0), tmp_path).close()
    assert "status" not in {thread.name for thread in threading.enumerate()}


def test_slow_ones_make_room_and_are_counted(tmp_path: Path, until: Until) -> None:
    with serving(tmp_path) as server, ExitStack() as stack:
        server.show(status())
        for _ in range(3 * MOST_CONNECTIONS):
            slow = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            slow.sendall(b"GET /status.json HTTP/1.1\r\nX: a")
        assert until(lambda: server._server.turned_away >= MOST_CONNECTIONS)
        code, _, body = get(server, "/status.json")
        assert code == 200
        assert msgspec.json.decode(body, type=StationStatus).counters["turned_away"] >= MOST_CONNECTIONS
        assert threading.active_count() < 2 * MOST_CONNECTIONS


def test_one_that_never_ends_its_request_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.station.status.server.CONNECTION_S", 0.3)
    with serving(tmp_path) as server, socket.create_connection(("127.0.0.1", server.port)) as slow:
        slow.settimeout(10)
        slow.sendall(b"GET /status.json HTTP/1.1\r\nX: ")
        assert slow.recv(1) == b"", "ended, though it may still have been dripping"

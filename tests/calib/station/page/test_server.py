"""The page's server in the test's own process: what is not for eyes, served over a real port from a real feed."""

import asyncio
import http.client
import json
import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pytest

from calib.station.archive.recording import Recorder
from calib.station.page import wire
from calib.station.page.process import available
from edge.messages import NetworkMessage, encode
from tests.calib.station.page.test_page import ORIGIN, T_NS, TOKEN, status, targets
from tests.conftest import Until

if not available():
    pytest.skip("the extra `page` is not installed", allow_module_level=True)

import uvicorn
from fastapi import FastAPI

from calib.station.page.door import MOST_OF_ONE
from calib.station.page.listening import LINES, RateLimit, stand_at
from calib.station.page.server import Page, _routes, guarded


@dataclass
class Served:
    """A page that is served, and the station's end of its feed."""

    page: Page
    feed: socket.socket
    port: int

    def give(self, name: str, payload: bytes) -> None:
        """As the station does."""
        self.feed.send(wire.pack(name, payload))

    def get(self, path: str, token: str = TOKEN) -> tuple[int, str, bytes]:
        """Status code, type and body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        connection.request("GET", path, headers={"Authorization": f"Bearer {token}"})
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return answer.status, answer.headers.get("Content-Type", ""), body

    def read(self, path: str) -> Any:
        return json.loads(self.get(path)[2])


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    (tmp_path / "recordings").mkdir()
    ours, theirs = wire.open_pair()
    ours.setblocking(True)
    hello = wire.Hello(
        site="hill", token=TOKEN, recordings=str(tmp_path / "recordings"), tiles=None, report=str(tmp_path / "r.html")
    )
    with ours, theirs, socket.create_server(("127.0.0.1", 0)) as listener:
        started: list[Served] = []
        thread = threading.Thread(target=lambda: asyncio.run(_serve(hello, theirs, listener, ours, started)))
        thread.start()
        while not started:
            thread.join(0.01)
            assert thread.is_alive()
        yield started[0]
        ours.close()  # the station has ended: so does the page
        thread.join(20)
        assert not thread.is_alive()


async def _serve(
    hello: wire.Hello, theirs: socket.socket, listener: socket.socket, ours: socket.socket, started: list[Served]
) -> None:
    """The routes that are not for eyes; what is for eyes needs a browser (test_page_browser.py)."""
    page = Page(hello, theirs)
    app = FastAPI(openapi_url=None)
    _routes(app, page)
    config = uvicorn.Config(guarded(app, page), log_level="warning", lifespan="off")
    stand_at(config, page.door)
    server = uvicorn.Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    started.append(Served(page, ours, listener.getsockname()[1]))
    await page.listen()
    server.should_exit = True
    await serving


def test_what_the_station_gives_is_served_and_nothing_without_the_token(served: Served, until: Until) -> None:
    assert served.get("/metrics")[2] == b""
    served.give("status", encode(status()))
    assert until(lambda: served.page.live.status is not None)
    assert msgspec.json.decode(served.get("/status.json")[2])["site"] == "hill"
    code, kind, body = served.get("/metrics")
    assert (code, kind.split(";")[0]) == (200, "text/plain")
    assert b"skyfix_up_seconds 60.0" in body
    for path in ("/status.json", "/metrics", "/report", "/preview/cam0", "/past/x?at_s=0"):
        assert served.get(path, token="wrong")[0] == 401


def test_a_damaged_packet_is_dropped_and_the_next_one_taken(served: Served, until: Until) -> None:
    for packet in (b"no zero in here", wire.pack("status", b"{"), wire.pack("targets", b"[]")):
        served.feed.send(packet)
    served.give("preview/cam0", b"\xff\xd8 jpeg")
    assert until(lambda: served.get("/preview/cam0") == (200, "image/jpeg", b"\xff\xd8 jpeg"))
    assert served.get("/preview/cam9")[0] == 404


def test_the_report_is_served_once_there_is_one(served: Served) -> None:
    assert served.get("/report")[0] == 404
    Path(served.page.hello.report).write_text("<p>good</p>")
    code, kind, body = served.get("/report")
    assert (code, kind.split(";")[0], body) == (200, "text/html", b"<p>good</p>")


def test_a_recording_is_looked_into_and_nothing_else_is(served: Served) -> None:
    folder = Path(str(served.page.hello.recordings))
    recorder = Recorder(folder, "hill", min_free_mb=1)
    network = NetworkMessage(t_unix_ns=T_NS, state="calibrated", reason="", action="", origin=ORIGIN)
    recorder.write("skyfix/1/hill/station/network", encode(network), T_NS)
    for k in range(20):
        recorder.write("skyfix/1/hill/station/targets", encode(targets((float(k), 0.0, 30.0))), T_NS + k * 10**8)
    recorder.close()
    (file,) = folder.glob("*.mcap")
    assert served.read(f"/past/{file.name}/length")["seconds"] == pytest.approx(1.9, abs=0.01)
    (target,) = served.read(f"/past/{file.name}?at_s=1.0")["targets"]
    assert target["at"][0] == pytest.approx(10.0, abs=0.02)
    for nowhere in ("nan", "inf", "-inf", "1e308", "-1", "x"):
        assert served.get(f"/past/{file.name}?at_s={nowhere}")[0] == 422
    assert served.get("/past/none.mcap?at_s=0")[0] == 404
    (folder / "broken.mcap").write_bytes(b"this is no recording")
    assert served.get("/past/broken.mcap?at_s=0")[0] == 422


def test_an_operator_s_command_reaches_the_station(served: Served) -> None:
    served.page.command(wire.OperatorCommand(do="mute", camera="cam1"))
    served.feed.settimeout(10)
    found = msgspec.json.decode(served.feed.recv(wire.LARGEST), type=wire.OperatorCommand)
    assert (found.do, found.camera) == ("mute", "cam1")


def test_a_hundred_who_ask_a_letter_a_second_keep_nobody_out(served: Served, until: Until) -> None:
    served.give("status", encode(status()))
    assert until(lambda: served.page.live.status is not None)
    with ExitStack() as stack:
        for _ in range(2 * MOST_OF_ONE):
            slow = stack.enter_context(socket.create_connection(("127.0.0.1", served.port)))
            slow.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: a")
        assert until(lambda: served.page.door.turned_away >= MOST_OF_ONE)
        assert served.get("/status.json")[0] == 200
        assert b"skyfix_turned_away_total" in served.get("/metrics")[2]


def test_wrong_tokens_have_to_wait_and_are_told_on_the_page(served: Served, until: Until) -> None:
    served.give("status", encode(status()))
    assert until(lambda: served.page.live.status is not None)
    answers = [served.get("/status.json", token=f"{k:016}")[0] for k in range(12)]
    assert answers == [401] * 5 + [429] * 7
    assert served.get("/status.json")[0] == 429, "the right one too: it would be found among them"
    told = served.page.status
    assert told is not None
    assert told.health.items[-1].name == "token"
    assert told.counters["wrong_tokens"] == 5


def test_a_log_has_so_many_lines_a_minute_and_says_how_many_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("calib.station.page.listening.time.monotonic", lambda: now_s)
    limit = RateLimit()
    records = [logging.makeLogRecord({"msg": "line %d", "args": (k,)}) for k in range(500)]
    assert sum(limit.filter(record) for record in records) == LINES
    now_s += 61.0
    last = logging.makeLogRecord({"msg": "line %d", "args": (7,)})
    assert limit.filter(last)
    assert last.getMessage() == f"line 7 ({500 - LINES} lines left out before)"

"""NiceGUI around what live.py, words.py and past.py say. One event loop, one process, no state of any importance.

The hazard is the browser that is left open for a week: nothing here grows with time or with the number of looks, a
browser that does not read is closed, and what a browser shows after a reload is what it showed before, because it is in
the address, not in the session.
"""

import asyncio
import contextlib
import logging
import socket
import time
from collections import OrderedDict
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import uvicorn
from fastapi import FastAPI, HTTPException, Query, Response, WebSocket, WebSocketDisconnect
from nicegui import ui
from starlette.staticfiles import StaticFiles

from calib.station.page import wire, words
from calib.station.page.door import Door
from calib.station.page.guard import RequestFilter
from calib.station.page.listening import stand_at
from calib.station.page.live import Live
from calib.station.page.past import Past, listing, named
from calib.station.status.attempts import Attempts, with_door
from calib.station.status.metrics import CONTENT_TYPE, metrics
from calib.station.status.status import CameraStatus, StationStatus
from edge.common.errors import SkyfixError

log = logging.getLogger(__name__)

STATIC: Final = Path(__file__).parent / "static"
FRAME_S: Final = 0.1
SCENE_FRAMES: Final = 10  # frames between two scenes
WORDS_S: Final = 0.5  # between two looks at the words
SLOW_S: Final = 2.0  # a browser that takes no frame for so long is let go
LONGEST_PAST_S: Final = 1e7  # s: four months; an instant beyond is in no recording, and infinity in no integer
SWEEP_S: Final = 1.0  # between two looks at who stands at the door
PASTS: Final = 2  # recordings kept open
PRIMARY: Final = "#0757b8"  # white on it has a contrast of 7 to 1
SECTIONS: Final = {"/": "Map", "/setup": "Setup", "/cameras": "Cameras", "/recordings": "Recordings"}


class Page:
    """What all browsers share."""

    def __init__(self, hello: wire.Hello, feed: socket.socket) -> None:
        self.hello, self.feed = hello, feed
        self.live = Live()
        self.door = Door()
        self.attempts = Attempts()
        self._pasts: OrderedDict[str, Past] = OrderedDict()
        self._ended = asyncio.Event()

    # The station

    async def listen(self) -> None:
        """Take what the station gives, until it ends."""
        loop = asyncio.get_running_loop()
        self.feed.setblocking(False)
        while packet := await loop.sock_recv(self.feed, wire.LARGEST):
            try:
                self.live.take(*wire.unpack(packet), time.monotonic())
            except (SkyfixError, msgspec.MsgspecError) as error:
                log.warning("page: %s", error)
        self._ended.set()

    def command(self, what: wire.OperatorCommand) -> None:
        """Send the operator's command. A station that is too busy to take it is asked again by the operator."""
        with contextlib.suppress(BlockingIOError):
            self.feed.send(msgspec.json.encode(what))

    @property
    def status(self) -> StationStatus | None:
        """As the station says it, with what is known at the door."""
        said = self.live.status
        return None if said is None else with_door(said, self.attempts, self.door.turned_away, time.time())

    # The browsers

    async def watch(self, browser: WebSocket) -> None:
        """Ten frames a second to one browser, and once a second the scene."""
        await browser.accept()
        number = 0
        with contextlib.suppress(WebSocketDisconnect, asyncio.TimeoutError, RuntimeError):
            while not self._ended.is_set():
                message: dict[str, Any] = {"frame": self.live.frame(time.monotonic())}
                if number % SCENE_FRAMES == 0:
                    message["scene"] = self.live.scene()
                text = msgspec.json.encode(message).decode()
                await asyncio.wait_for(browser.send_text(text), SLOW_S)
                number += 1
                await asyncio.sleep(FRAME_S)

    def recordings(self) -> Path | None:
        """Their folder."""
        return None if self.hello.recordings is None else Path(self.hello.recordings)

    async def past(self, name: str) -> Past:
        """A recording, read by a thread when it is first asked for."""
        folder = self.recordings()
        file = None if folder is None else named(folder, name)
        if file is None:
            raise HTTPException(404, "there is no such recording")
        if name not in self._pasts:
            try:
                self._pasts[name] = await asyncio.to_thread(Past.read, file)
            except SkyfixError as error:
                raise HTTPException(422, str(error)) from error
            while len(self._pasts) > PASTS:
                self._pasts.popitem(last=False)
        self._pasts.move_to_end(name)
        return self._pasts[name]


def serve(page: Page, listener: socket.socket) -> None:
    """Serve until the station ends."""
    app = FastAPI(openapi_url=None)
    _routes(app, page)
    _pages(page)
    ui.run_with(app, title="Skyfix", favicon="🛰", tailwind=False, show_welcome_message=False, reconnect_timeout=10)
    asyncio.run(_serve(guarded(app, page), page, listener))


def guarded(app: Any, page: Page) -> RequestFilter:
    """The app behind the page's door; what is tried there is the page's to tell."""
    found = RequestFilter(app, page.hello.token, page.door)
    page.attempts = found.gate.attempts
    return found


async def _serve(app: Any, page: Page, listener: socket.socket) -> None:
    tls = page.hello.tls
    config = uvicorn.Config(
        app,
        log_level="warning",
        lifespan="on",
        ws_max_size=1 << 16,
        timeout_graceful_shutdown=1,
        ssl_certfile=None if tls is None else tls.certificate,
        ssl_keyfile=None if tls is None else tls.key,
    )
    server = uvicorn.Server(config)
    stand_at(config, page.door)
    sweeping = asyncio.create_task(_sweep(page.door))
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    listening = asyncio.create_task(page.listen())
    await asyncio.wait({serving, listening}, return_when=asyncio.FIRST_COMPLETED)
    server.should_exit = True
    await serving
    sweeping.cancel()


async def _sweep(door: Door) -> None:
    while True:
        door.sweep(time.monotonic())
        await asyncio.sleep(SWEEP_S)


def _routes(app: FastAPI, page: Page) -> None:
    """Everything that is not for eyes."""
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    if page.hello.tiles is not None:
        app.mount("/tiles", StaticFiles(directory=page.hello.tiles, check_dir=False), name="tiles")

    @app.get("/status.json")
    def status() -> Response:
        return _json(page.status)

    @app.get("/metrics")
    def numbers() -> Response:
        status = page.status
        return Response(b"" if status is None else metrics(status), media_type=CONTENT_TYPE)

    @app.get("/report")
    def report() -> Response:
        file = Path(page.hello.report)
        if not file.is_file():
            raise HTTPException(404, "there is no report yet: it is written at the first calibration")
        return Response(file.read_bytes(), media_type="text/html")

    @app.get("/preview/{camera}")
    def preview(camera: str) -> Response:
        found = page.live.previews.get(camera)
        if found is None:
            raise HTTPException(404, "no picture of it yet")
        return Response(found[1], media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @app.get("/past/{name}")
    async def past(name: str, at_s: Annotated[float, Query(ge=0, le=LONGEST_PAST_S)]) -> Response:
        return _json((await page.past(name)).at(at_s))

    @app.get("/past/{name}/length")
    async def length(name: str) -> Response:
        return _json({"seconds": (await page.past(name)).seconds})

    @app.websocket("/live")
    async def live(browser: WebSocket) -> None:
        await page.watch(browser)


def _json(content: Any) -> Response:
    return Response(msgspec.json.encode(content), media_type="application/json")


# What is for eyes


def _pages(page: Page) -> None:
    @ui.page("/")
    def the_map() -> None:
        _frame(page, "/")
        _map(tiles=page.hello.tiles is not None)

    @ui.page("/setup")
    def setup() -> None:
        _frame(page, "/setup")
        _setup(page)

    @ui.page("/cameras")
    def cameras() -> None:
        _frame(page, "/cameras")
        _cameras(page)

    @ui.page("/recordings")
    def recordings(name: str = "") -> None:
        _frame(page, "/recordings")
        _recordings(page, name)


def _frame(page: Page, here: str) -> None:
    """What is on every page: where we are, and how the station is."""
    ui.colors(primary=PRIMARY)
    ui.add_head_html('<link rel="stylesheet" href="/static/station.css">')
    ui.add_body_html('<script type="module" src="/static/station.js"></script>')
    with ui.element("header").classes("top"):
        ui.html(f"<h1>{escape(page.hello.site)}</h1>", sanitize=False)
        links = "".join(
            f'<a href="{path}"{" aria-current=page" if path == here else ""}>{name}</a>'
            for path, name in SECTIONS.items()
        )
        ui.html(f'<nav aria-label="Sections">{links}</nav>', sanitize=False)
        _words(lambda: _banner(page)).props('role="status" aria-live="polite"').classes("banner")
    ui.html('<p id="lost" role="alert" hidden></p>', sanitize=False)


def _banner(page: Page) -> str:
    status = page.live.status
    return words.banner(status) if status is not None else "waiting for the station"


def _words(text: Callable[[], str]) -> ui.html:
    """HTML that is looked at twice a second and sent when it has changed."""
    element = ui.html(text(), sanitize=False)

    def renew() -> None:
        new = text()
        if new != element.content:
            element.set_content(new)

    ui.timer(WORDS_S, renew)
    return element


def _button(text: str, act: Callable[[], None]) -> ui.button:
    return ui.button(text, on_click=act).props("no-caps unelevated")


def _map(*, tiles: bool) -> None:
    with ui.element("main").classes("map").props("data-tiles" if tiles else ""):
        ui.html(
            '<div class="tools" role="toolbar" aria-label="View">'
            '<button data-do="3d" aria-pressed="false">3D</button><button data-do="in" aria-label="Zoom in">+</button>'
            '<button data-do="out" aria-label="Zoom out">−</button><button data-do="all">Show all</button>'
            '<button data-do="rays" aria-pressed="true">Rays</button>'
            '<button data-do="coverage" aria-pressed="false">Coverage</button></div>'
            '<canvas id="map" tabindex="0" role="img" aria-label="Map of cameras and targets. Arrow keys move it, '
            'plus and minus zoom, 3 tilts it, 0 shows all."></canvas>'
            '<div id="targets" class="scroll" aria-live="off"></div>',
            sanitize=False,
        ).classes("fill")


def _setup(page: Page) -> None:
    with ui.element("main"):
        _words(lambda: _if_known(page, words.step_list))
        _button("Calibrate now", lambda: page.command(wire.OperatorCommand(do="calibrate")))
        _words(lambda: _report_link(page))
        ui.html("<h2>Pairs of cameras</h2>", sanitize=False)
        _words(lambda: _if_known(page, lambda status: words.pair_matrix(status, page.live.focal_px())))
        ui.html("<h2>Checks</h2>", sanitize=False)
        _words(lambda: _if_known(page, words.check_table))


def _report_link(page: Page) -> str:
    known = Path(page.hello.report).is_file()
    return '<p><a href="/report" target="_blank">Report on the last calibration</a></p>' if known else ""


def _if_known(page: Page, render: Callable[[StationStatus], str]) -> str:
    status = page.status
    return "" if status is None else render(status)


def _cameras(page: Page) -> None:
    @ui.refreshable
    def cards() -> None:
        with ui.element("div").classes("cards"):
            for name in _names(page):
                _card(page, name)

    with ui.element("main"):
        cards()
    known = _names(page)

    def look() -> None:
        nonlocal known
        if known != _names(page):
            known = _names(page)
            cards.refresh()

    ui.timer(WORDS_S, look)


def _names(page: Page) -> list[str]:
    return [] if page.live.status is None else [camera.id for camera in page.live.status.cameras]


def _card(page: Page, name: str) -> None:
    def find() -> CameraStatus:
        assert page.live.status is not None
        return next(camera for camera in page.live.status.cameras if camera.id == name)

    def toggle() -> None:
        page.command(wire.OperatorCommand(do="unmute" if find().muted else "mute", camera=name))

    with ui.element("section").classes("card"):
        ui.html(
            f'<canvas class="view" data-camera="{escape(name)}" width="480" height="270" role="img" '
            f'aria-label="What {escape(name)} sees"></canvas>',
            sanitize=False,
        )
        _words(lambda: words.camera_card(find(), page.live.health.get(name)))
        button = _button(f"Mute {name}", toggle)

        def label() -> None:
            text = f"Unmute {name}" if find().muted else f"Mute {name}"
            if button.text != text:
                button.set_text(text)

        label()
        ui.timer(WORDS_S, label)


def _recordings(page: Page, name: str) -> None:
    with ui.element("main"):
        _words(lambda: _if_known(page, words.recording))
        with ui.row():
            _button("Start recording", lambda: page.command(wire.OperatorCommand(do="record")))
            _button("Stop recording", lambda: page.command(wire.OperatorCommand(do="stop")))
        folder = page.recordings()
        _words(lambda: words.recordings([] if folder is None else listing(folder), name))
        if name:
            ui.html(
                f'<div class="past" data-recording="{escape(name)}"><label>Time '
                '<input id="scrub" type="range" min="0" max="0" step="0.1" value="0"></label>'
                '<output id="when"></output><canvas id="map" tabindex="0" role="img" aria-label="Map"></canvas>'
                '<div id="targets" class="scroll"></div></div>',
                sanitize=False,
            ).classes("fill")

"""/status.json and /metrics over HTTP: the newest status, made once a second, handed out as it is.

The hazard is a browser that slows the tracker; so nothing is computed here, and the server has a thread of its own.
"""

import logging
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from calib.station.config import BaseConfig, StatusSection
from calib.station.page.access import allowed, read_token
from calib.station.page.process import REPORT_FOLDER, PageProcess, available
from calib.station.page.wire import Wish
from calib.station.status.status import StationStatus, prometheus
from edge.common.errors import ConfigError

log = logging.getLogger(__name__)


def open_status(config: BaseConfig, folder: Path) -> "StatusServer | PageProcess":
    """The page where it is wanted and its library is installed, else the bare status. Raises ConfigError."""
    options, recordings = config.status, config.recording.folder
    if not options.page or options.port is None:
        return StatusServer(options, folder)
    if not available():
        log.info("no operator's page: its library is not installed (pip install 'skyfix[base,page]')")
        return StatusServer(options, folder)
    return PageProcess(
        options,
        folder,
        config.site.name,
        recordings=None if recordings is None else folder / recordings,
        report=folder / config.state_folder / REPORT_FOLDER / "report.html",
    )


class StatusServer:
    """Serves the status last shown. Port None: nothing is served."""

    def __init__(self, options: StatusSection, folder: Path) -> None:
        """Raises ConfigError if the address cannot be had, or the token cannot be read."""
        self._token = read_token(folder / options.token_file) if options.token_file else ""
        self._pages: dict[str, tuple[str, bytes]] = {}
        self._server: ThreadingHTTPServer | None = None
        if options.port is not None:
            try:
                self._server = ThreadingHTTPServer((options.host, options.port), self._handler())
            except OSError as error:
                raise ConfigError(
                    f"{options.host}:{options.port} cannot be had ({error})",
                    where="status.port",
                    action="choose another port, or end the program that holds it",
                ) from error
            self._server.daemon_threads = True
            self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="status", daemon=True)

    @property
    def port(self) -> int | None:
        """The port that is served."""
        return None if self._server is None else int(self._server.server_address[1])

    def __enter__(self) -> Self:
        if self._server is not None:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._thread.join(1.0)

    def show(self, status: StationStatus) -> None:
        """Serve this from now on."""
        self._pages = {
            "/status.json": ("application/json", msgspec.json.encode(status)),
            "/metrics": ("text/plain; version=0.0.4", prometheus(status).encode()),
        }

    # What only the page needs

    @property
    def watched(self) -> bool:
        """Nobody looks."""
        return False

    def due(self) -> bool:
        """Nobody looks."""
        return False

    def feed(self, name: str, payload: bytes, *, keep: bool = False) -> None:
        """Nobody is shown more."""

    def wishes(self) -> list[Wish]:
        """Nobody wishes anything."""
        return []

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class StatusHandler(BaseHTTPRequestHandler):
            timeout = 5  # s: a client that says nothing does not hold a thread for ever

            def do_GET(self) -> None:
                path, _, query = self.path.partition("?")
                headers = {name.lower(): value for name, value in self.headers.items()}
                if not allowed(server._token, headers, query):
                    self.send_error(HTTPStatus.UNAUTHORIZED, "a token is needed")
                    return
                page = server._pages.get(path)
                if page is None:
                    self.send_error(HTTPStatus.NOT_FOUND, "there are /status.json and /metrics")
                    return
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", page[0])
                self.send_header("Content-Length", str(len(page[1])))
                self.end_headers()
                self.wfile.write(page[1])

            def log_message(self, format: str, *args: object) -> None:
                """Who asked is nobody's business here."""

        return StatusHandler

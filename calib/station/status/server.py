"""/status.json and /metrics over HTTP: the newest status, taken once a second, made into text when somebody asks.

The hazard is a browser that slows the tracker; so the loop only leaves the struct here, and threads of the server's own
make text of it.
"""

from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final

import msgspec

from calib.station.config import StatusSection
from calib.station.status.access import allowed, read_token
from calib.station.status.metrics import CONTENT_TYPE, metrics
from calib.station.status.status import StationStatus
from edge.common.errors import ConfigError
from edge.common.own_thread import OwnThread

STOP_POLL_S: Final = 0.1  # how soon it notices that it is to stop
STATUS_CLOSE_S: Final = 1.0
PAGES: Final[dict[str, tuple[str, Callable[[StationStatus], bytes]]]] = {
    "/status.json": ("application/json", msgspec.json.encode),
    "/metrics": (CONTENT_TYPE, metrics),
}


class StatusServer(OwnThread):
    """Serves the status last shown."""

    def __init__(self, options: StatusSection, folder: Path) -> None:
        """Raises ConfigError if the address cannot be had, or the token cannot be read."""
        super().__init__("status", STATUS_CLOSE_S)
        self._token = read_token(folder / options.token_file) if options.token_file else ""
        self._status: StationStatus | None = None
        try:
            self._server = ThreadingHTTPServer((options.host, options.port or 0), self._handler())
        except OSError as error:
            raise ConfigError(
                f"{options.host}:{options.port} cannot be had ({error})",
                where="status.port",
                action="choose another port, or end the program that holds it",
            ) from error
        self._server.daemon_threads = True

    @property
    def port(self) -> int:
        """The port that is served."""
        return int(self._server.server_address[1])

    def show(self, status: StationStatus) -> None:
        """Serve this from now on."""
        self._status = status

    def _run(self) -> None:
        self._server.serve_forever(STOP_POLL_S)

    def _wake(self) -> None:
        if self._thread.is_alive():
            self._server.shutdown()
        self._server.server_close()

    def _answer(self, path: str, headers: dict[str, str], query: str) -> tuple[HTTPStatus, str, bytes]:
        """Status code, content type and body of the answer to a request; headers by names in lower case."""
        if not allowed(self._token, headers, query):
            return HTTPStatus.UNAUTHORIZED, "text/plain", b"a token is needed\n"
        if path not in PAGES:
            return HTTPStatus.NOT_FOUND, "text/plain", f"there are {' and '.join(PAGES)}\n".encode()
        if self._status is None:
            return HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"the station has just started\n"
        kind, make = PAGES[path]
        return HTTPStatus.OK, kind, make(self._status)

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class StatusHandler(BaseHTTPRequestHandler):
            timeout = 5  # s: a client that sends nothing does not hold a thread for ever

            def do_GET(self) -> None:
                path, _, query = self.path.partition("?")
                headers = {name.lower(): value for name, value in self.headers.items()}
                code, kind, body = server._answer(path, headers, query)
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Who asked is nobody's business here."""

        return StatusHandler

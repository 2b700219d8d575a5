"""/status.json and /metrics over HTTP: the newest status, made once a second, handed out as it is.

The hazard is a browser that slows the tracker; so nothing is computed here, and the server has a thread of its own.
"""

from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final

import msgspec

from calib.station.config import StatusSection
from calib.station.status.access import allowed, read_token
from calib.station.status.status import StationStatus, prometheus
from edge.common.errors import ConfigError
from edge.common.own_thread import OwnThread

POLL_S: Final = 0.1  # how soon it notices that it is to stop
CLOSE_S: Final = 1.0


class StatusServer(OwnThread):
    """Serves the status last shown."""

    def __init__(self, options: StatusSection, folder: Path) -> None:
        """Raises ConfigError if the address cannot be had, or the token cannot be read."""
        super().__init__("status", CLOSE_S)
        self._token = read_token(folder / options.token_file) if options.token_file else ""
        self._pages: dict[str, tuple[str, bytes]] = {}
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
        self._pages = {
            "/status.json": ("application/json", msgspec.json.encode(status)),
            "/metrics": ("text/plain; version=0.0.4", prometheus(status).encode()),
        }

    def _run(self) -> None:
        self._server.serve_forever(POLL_S)
        self._server.server_close()

    def _wake(self) -> None:
        if self._thread.is_alive():
            self._server.shutdown()

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

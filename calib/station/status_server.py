"""/status.json and /metrics over HTTP: the newest status, made once a second, handed out as it is.

The hazard is a browser that slows the tracker; so nothing is computed here, and the server has a thread of its own.
"""

import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Self

import msgspec

from calib.station.config import StatusSection
from calib.station.status import StationStatus, prometheus
from edge.errors import ConfigError


class StatusServer:
    """Serves the status last shown. Port None: nothing is served."""

    def __init__(self, options: StatusSection) -> None:
        """Raises ConfigError if the address cannot be had."""
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

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class Handler(BaseHTTPRequestHandler):
            timeout = 5  # s: a client that says nothing does not hold a thread for ever

            def do_GET(self) -> None:
                page = server._pages.get(self.path)
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

        return Handler

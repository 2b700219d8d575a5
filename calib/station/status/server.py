"""/status.json and /metrics over HTTP: the newest status, taken once a second, made into text when somebody asks.

The hazard is a browser that slows the tracker; so the loop only leaves the struct here, and threads of the server's own
make text of it.
"""

import contextlib
import logging
import socket
import ssl
import sys
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

import msgspec

from calib.station.config import StatusSection
from calib.station.status.access import TokenGate, read_token
from calib.station.status.attempts import with_door
from calib.station.status.https import serving
from calib.station.status.metrics import CONTENT_TYPE, metrics
from calib.station.status.status import StationStatus
from edge.common.errors import ConfigError
from edge.common.own_thread import OwnThread
from edge.link.settings import TlsSettings

log = logging.getLogger(__name__)

MOST_CONNECTIONS: Final = 50  # threads, at that
CONNECTION_S: Final = 10.0  # from connecting to the whole answer
STOP_POLL_S: Final = 0.1  # how soon it notices that it is to stop
STATUS_CLOSE_S: Final = 1.0
PAGES: Final[dict[str, tuple[str, Callable[[StationStatus], bytes]]]] = {
    "/status.json": ("application/json", msgspec.json.encode),
    "/metrics": (CONTENT_TYPE, metrics),
}


class _BoundedServer(ThreadingHTTPServer):
    """A thread for each connection, so many at most, and each for so long: who asks a letter a second is ended."""

    daemon_threads = True
    request_queue_size = 128  # a few slow ones more than the usual 5 would have everybody else's packets dropped

    def __init__(
        self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler], context: ssl.SSLContext | None
    ) -> None:
        super().__init__(address, handler)
        self._context = context
        self._open: dict[socket.socket, float] = {}
        self._lock = threading.Lock()
        self.turned_away = 0

    def get_request(self) -> tuple[Any, Any]:
        """The next connection; whoever is slow to shake hands keeps its own thread waiting, not this one."""
        request, address = super().get_request()
        if self._context is None:
            return request, address
        return self._context.wrap_socket(request, server_side=True, do_handshake_on_connect=False), address

    def process_request(self, request: Any, client_address: Any) -> None:
        """A connection: the oldest goes where there is no more room."""
        with self._lock:
            self._open[request] = time.monotonic()
            if len(self._open) > MOST_CONNECTIONS:
                self._end(next(iter(self._open)))
        super().process_request(request, client_address)

    def service_actions(self) -> None:
        """Called between two connections: end those whose time is over."""
        before_s = time.monotonic() - CONNECTION_S
        with self._lock:
            for request in [request for request, since_s in self._open.items() if since_s < before_s]:
                self._end(request)

    def shutdown_request(self, request: Any) -> None:
        """Its thread is done with it."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Who left before the answer, or was ended: no traceback for each."""
        log.debug("%s: %r", client_address, sys.exception())

    def _end(self, request: socket.socket) -> None:
        self.turned_away += 1
        self._open.pop(request, None)
        with contextlib.suppress(OSError):  # it ended by itself just now
            request.shutdown(socket.SHUT_RDWR)  # which wakes its thread


class StatusServer(OwnThread):
    """Serves the status last shown."""

    def __init__(self, options: StatusSection, folder: Path, tls: TlsSettings | None = None) -> None:
        """Raises ConfigError if the address cannot be had, or the token or the certificate cannot be read."""
        super().__init__("status", STATUS_CLOSE_S)
        context = None if tls is None else serving(tls)
        self._gate = TokenGate(read_token(folder / options.token_file) if options.token_file else "")
        self._status: StationStatus | None = None
        try:
            self._server = _BoundedServer((options.host, options.port or 0), self._handler(), context)
        except OSError as error:
            raise ConfigError(
                f"{options.host}:{options.port} cannot be had ({error})",
                where="status.port",
                action="choose another port, or end the program that holds it",
            ) from error

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

    def _answer(self, path: str, headers: dict[str, str], query: str, address: str) -> tuple[HTTPStatus, str, bytes]:
        """Status code, content type and body of the answer to a request; headers by names in lower case."""
        verdict = self._gate.judge(headers, query, address, time.time())
        if verdict == "wait":
            return HTTPStatus.TOO_MANY_REQUESTS, "text/plain", b"too many wrong tokens from here: wait\n"
        if verdict == "refused":
            return HTTPStatus.UNAUTHORIZED, "text/plain", b"a token is needed\n"
        if path not in PAGES:
            return HTTPStatus.NOT_FOUND, "text/plain", f"there are {' and '.join(PAGES)}\n".encode()
        if self._status is None:
            return HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"the station has just started\n"
        kind, make = PAGES[path]
        told = with_door(self._status, self._gate.attempts, self._server.turned_away, time.time())
        return HTTPStatus.OK, kind, make(told)

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class StatusHandler(BaseHTTPRequestHandler):
            timeout = 5  # s: a client that sends nothing does not hold a thread for ever

            def do_GET(self) -> None:
                path, _, query = self.path.partition("?")
                headers = {name.lower(): value for name, value in self.headers.items()}
                code, kind, body = server._answer(path, headers, query, self.client_address[0])
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Who asked is nobody's business here."""

        return StatusHandler

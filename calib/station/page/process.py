"""The page's process, as the station sees it: it is started when somebody looks, fed, and started again if it dies.

The hazard is a page that costs the tracker something. The port is held here, so that a mistake in the configuration is
found at the start and a page that dies loses nobody; who connects waits a second or two until it runs. Nothing here
blocks: what the page does not take is dropped and counted.
"""

import logging
import os
import select
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from calib.station.config import StatusSection
from calib.station.page import wire
from calib.station.status.access import read_token
from calib.station.status.https import serving
from calib.station.status.status import StationStatus
from edge.common.errors import ConfigError
from edge.link.settings import TlsSettings

log = logging.getLogger(__name__)

FASTEST_S: Final = 0.1  # between two packets of one name: ten a second is what an eye follows
QUICK_S: Final = 0.25  # between two states while somebody looks
AGAIN_S: Final = 5.0  # before a page that died is started again
PAGE_STOP_S: Final = 1.0
LIBRARY: Final = "nicegui"


def available() -> bool:
    """Whether the extra `page` is installed."""
    return find_spec(LIBRARY) is not None


def listen(host: str, port: int) -> socket.socket:
    """The page's port. Raises ConfigError if it cannot be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(64)
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"{host}:{port} cannot be had ({error})",
            where="status.port",
            action="choose another port, or end the program that holds it",
        ) from error
    return listener


class PageProcess:
    """Serves the page, /status.json and /metrics from a process of its own."""

    def __init__(
        self,
        options: StatusSection,
        folder: Path,
        site: str,
        *,
        recordings: Path | None,
        report: Path,
        tls: TlsSettings | None = None,
    ) -> None:
        """Raises ConfigError if the address cannot be had, or the token or the certificate cannot be read."""
        assert options.port is not None
        if tls is not None:
            serving(tls)  # by the page's process; what is wrong with it is found here
        token = read_token(folder / options.token_file) if options.token_file else ""
        self._hello = wire.Hello(
            site=site,
            token=token,
            recordings=None if recordings is None else str(recordings),
            tiles=None if options.tiles is None else str(folder / options.tiles),
            report=str(report),
            tls=tls,
        )
        self._listener = listen(options.host, options.port)
        self._process: subprocess.Popen[bytes] | None = None
        self._feed: socket.socket | None = None
        self._kept: dict[str, bytes] = {}
        self._sent_s: dict[str, float] = {}
        self._started_s = self._shown_s = -AGAIN_S
        self.dropped = 0
        self.starts = 0

    @property
    def port(self) -> int:
        """The port that is served."""
        return int(self._listener.getsockname()[1])

    @property
    def pid(self) -> int | None:
        """The page's process, if it runs."""
        return None if self._process is None else self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()
        self._listener.close()

    # What the station gives

    @property
    def watched(self) -> bool:
        """Whether somebody has looked."""
        return self._feed is not None

    def due(self) -> bool:
        """Whether somebody looks who should be shown a new state now. Call it often; it costs nothing."""
        return self._feed is not None and time.monotonic() - self._shown_s >= QUICK_S

    def show(self, status: StationStatus) -> None:
        """Show this from now on."""
        self._shown_s = time.monotonic()
        self.feed("status", msgspec.json.encode(status), keep=True)

    def feed(self, name: str, payload: bytes, *, keep: bool = False) -> None:
        """Hand something on, at most ten times a second of each name. keep: a page that starts gets the last one."""
        if keep:
            self._kept[name] = payload
        if self._feed is None:
            return
        now_s = time.monotonic()
        if keep or now_s - self._sent_s.get(name, -1.0) >= FASTEST_S:
            self._sent_s[name] = now_s
            self._send(name, payload)

    def commands(self) -> list[wire.OperatorCommand]:
        """What the operator wants; and the moment to start a page that somebody waits for. Call it once a turn."""
        self._look_after()
        found: list[wire.OperatorCommand] = []
        while self._feed is not None:
            try:
                packet = self._feed.recv(wire.LARGEST)
            except BlockingIOError:
                break
            except OSError as error:
                log.debug("page: %s", error)
                break
            if not packet:
                break
            try:
                found.append(msgspec.json.decode(packet, type=wire.OperatorCommand))
            except msgspec.MsgspecError as error:
                log.warning("page: a command that is none (%s)", error)
        return found

    # Its life

    def _look_after(self) -> None:
        if self._process is not None and self._process.poll() is not None:
            log.warning("the page's process died (code %s); it is started again when asked for", self._process.poll())
            self._stop()
        if self._process is None and time.monotonic() - self._started_s > AGAIN_S and self._somebody_waits():
            self._start()

    def _somebody_waits(self) -> bool:
        return bool(select.select([self._listener], [], [], 0)[0])

    def _start(self) -> None:
        self._started_s = time.monotonic()
        self.starts += 1
        self._feed, theirs = wire.open_pair()
        descriptors = (self._listener.fileno(), theirs.fileno())
        command = [sys.executable, "-m", "calib.station.page", *map(str, descriptors)]
        # What is importable here must be there too: a checkout is not always installed.
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._process = subprocess.Popen(
            command, pass_fds=descriptors, stdin=subprocess.DEVNULL, env=environment, start_new_session=True
        )
        theirs.close()
        self._send("hello", msgspec.json.encode(self._hello))
        for name, payload in self._kept.items():
            self._send(name, payload)

    def _stop(self) -> None:
        if self._feed is not None:
            self._feed.close()  # which is how the page learns that it is over
            self._feed = None
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(PAGE_STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(PAGE_STOP_S)
            self._process = None

    def _send(self, name: str, payload: bytes) -> None:
        assert self._feed is not None
        packet = wire.pack(name, payload)
        if len(packet) > wire.LARGEST:
            self.dropped += 1
            return
        try:
            self._feed.send(packet)
        except BlockingIOError:
            self.dropped += 1
        except OSError as error:  # it died: the next turn says so
            self.dropped += 1
            log.debug("page: %s", error)

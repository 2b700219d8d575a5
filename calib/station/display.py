"""Who looks at the station: the bare status over HTTP, or the operator's page, which is fed and may give orders.

The hazard is a loop that knows how it is looked at. It shows one struct, hands on what came, and asks for orders; what
nobody looks at costs it a comparison.
"""

import logging
from contextlib import ExitStack
from pathlib import Path
from typing import Final, Protocol

from calib.station.archive.state_store import REPORT_FOLDER
from calib.station.config import BaseConfig
from calib.station.page.process import PageProcess, available
from calib.station.page.wire import OperatorCommand
from calib.station.status.https import https_of
from calib.station.status.server import StatusServer
from calib.station.status.status import StationStatus
from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.messages import camera_key, camera_of_key

log = logging.getLogger(__name__)

PICTURES: Final = 64  # waiting: one of each of twice as many cameras as there may be


class StatusDisplay(Protocol):
    """Shows the newest status to whoever asks."""

    def show(self, status: StationStatus) -> None:
        """Show this from now on."""


class OperatorPage(StatusDisplay, Protocol):
    """Shows more, as it comes, and brings what the operator wants. Nothing in it blocks."""

    @property
    def watched(self) -> bool:
        """Whether somebody has looked."""

    def due(self) -> bool:
        """Whether somebody looks who should be shown a new state now."""

    def feed(self, name: str, payload: bytes, *, keep: bool = False) -> None:
        """Hand something on. keep: who comes later gets the last one."""

    def commands(self) -> list[OperatorCommand]:
        """What the operator wants; ask once a turn."""


class Display:
    """All that look at one station."""

    def __init__(self, link: Link, site: str, shown: StatusDisplay | None, page: OperatorPage | None) -> None:
        """shown: gets the status; None: nothing does. page: what `shown` is besides, if it is one."""
        self._link, self._site = link, site
        self._shown, self._page = shown, page
        self._pictures: Inbox[Received] | None = None

    def show(self, status: StationStatus) -> None:
        """The status, once a second."""
        if self._shown is not None:
            self._shown.show(status)

    def feed(self, topic: str, payload: bytes, *, key: str = "", keep: bool = False) -> None:
        """A message that came under a camera's key, or that the station sends."""
        if self._page is not None:
            self._page.feed(f"{topic}/{camera_of_key(key)}" if key else topic, payload, keep=keep)

    def due(self) -> bool:
        """Whether the status should be shown before the second is over."""
        return self._page is not None and self._page.due()

    def commands(self) -> list[OperatorCommand]:
        """What the operator wants. Hands pictures on by the way, once somebody looks: before that no box sends any."""
        if self._page is None:
            return []
        if self._pictures is None and self._page.watched:
            self._pictures = self._link.subscribe(camera_key(self._site, "*", "preview"), PICTURES)
        for picture in self._pictures.drain() if self._pictures is not None else ():
            self.feed("preview", picture.payload, key=picture.key)
        return self._page.commands()


def open_display(config: BaseConfig, folder: Path, link: Link, stack: ExitStack) -> Display:
    """The page where it is wanted and its library is installed, else the bare status. Raises ConfigError."""
    options, site, tls = config.status, config.site.name, https_of(config)
    if options.port is None:
        return Display(link, site, None, None)
    if not options.page or not available():
        if options.page:
            log.info("no operator's page: its library is not installed (pip install 'skyfix[base,page]')")
        return Display(link, site, stack.enter_context(StatusServer(options, folder, tls)), None)
    recordings = None if config.recording.folder is None else folder / config.recording.folder
    report = folder / config.state_folder / REPORT_FOLDER / "report.html"
    page = stack.enter_context(PageProcess(options, folder, site, recordings=recordings, report=report, tls=tls))
    return Display(link, site, page, page)

"""`base-station run`: the loop. What a turn does is in runner.py, what is decided in core/station.py.

Stops within three seconds of SIGTERM or Ctrl-C, in order: nothing more is received, the recording gets its end, the
solver's process and the Zenoh session are closed. A second signal ends it at once.
"""

import argparse
import logging
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Final

from calib.station.commands.arguments import add_config, folder_of
from calib.station.config import BaseConfig, load
from calib.station.runner import Runner
from calib.station.worker import LIVE, Solver
from edge.common.own_thread import give_way_soon
from edge.common.systemd_notify import Notifier
from edge.link.zenoh_log import ZenohLog

log = logging.getLogger(__name__)

HURRIED_EXIT: Final = 130  # as a shell reports an interrupted program


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station run`."""
    add_config(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run until told to stop; 0 then. Raises ConfigError, LinkError."""
    with ZenohLog():
        return run_station(load(arguments.config), folder_of(arguments.config))


def run_station(
    config: BaseConfig, folder: Path, solver: Solver | str = LIVE, stop: threading.Event | None = None
) -> int:
    """Run until told to stop. folder: what relative paths are relative to. Raises ConfigError, LinkError."""
    stopping = stop or threading.Event()
    if stop is None:
        _on_signals(stopping.set)
    give_way_soon()
    with ExitStack() as stack:
        runner = Runner(config, folder, stack, solver)
        log.info("site %s, start %d, listening on %s", config.site.name, runner.epoch, config.link.listen)
        notifier = Notifier()
        notifier.ready(f"site {config.site.name}")
        while not stopping.is_set():
            if runner.turn():  # the watchdog is fed by the loop that does the work, or not at all
                notifier.feed({"turns": runner.turns}, time.monotonic(), runner.station.standing.phase)
        notifier.stopping()
    log.info("stopped")
    return 0


def _on_signals(stop: Callable[[], None]) -> None:
    asked = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        if asked.is_set():
            os._exit(HURRIED_EXIT)
        asked.set()
        stop()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, handle)

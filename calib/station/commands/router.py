"""`base-station router`: a site's router, from the same wheel as everything else.

From about ten boxes, or with more than one listener, boxes and station all dial a router, so that none of them dials
another and each may restart alone; a headquarters' router is dialled by those of the sites. What it is, is
configuration alone: where it listens, whom it dials, and the list of who may say what. See deploy/SCALING.md.
"""

import argparse
import logging
import signal
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from edge.common.settings import load
from edge.common.systemd_notify import Notifier
from edge.health import HealthBoard
from edge.link.health import LinkHealth
from edge.link.link import Link
from edge.link.security import Bearer
from edge.link.settings import LinkSettings
from edge.link.zenoh_log import ZenohLog
from edge.messages import Name, site_key

log = logging.getLogger("skyfix.router")

TURN_S: Final = 1.0


class RouterConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of router.toml: the site's name, and the link's `connect`, `listen` and `tls`."""

    site: Annotated[Name, Meta(description="the same as on boxes and base; a headquarters' router has its own")]
    link: LinkSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station router`."""
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="router.toml")


def run(arguments: argparse.Namespace) -> int:
    """Route until told to stop; 0 then. Raises ConfigError, LinkError."""
    route(load(arguments.config, RouterConfig))
    return 0


def route(config: RouterConfig) -> None:
    """Route until SIGTERM or SIGINT."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    notifier = Notifier()
    link = Link(msgspec.structs.replace(config.link, mode="router"), name=f"router {config.site}")
    with ZenohLog(), link, ExitStack() as stack:
        link_health = stack.enter_context(LinkHealth(link, Bearer(config.site, "router")))
        board = HealthBoard(time.time_ns() // 1_000_000)
        # Its own message, come round through the session, is the proof that the session turns.
        key = site_key(config.site, "router/health")
        echo = link.subscribe(key)
        notifier.ready()
        turns = 0
        while not stop.wait(TURN_S):
            turns += 1
            found = link_health.checks(who="the router above")
            link.publish(key, board.update(time.time_ns(), found, link_health.counters(), now_ns=time.monotonic_ns()))
            echo.drain()
            notifier.feed({"session": echo.received}, time.monotonic(), link.error or "routing")
        notifier.stopping()

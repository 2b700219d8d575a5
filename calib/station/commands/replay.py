"""`base-station replay`: a track folder or a recording over Zenoh as if the cameras were there, with its own stamps."""

import argparse
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from calib.station.archive.replay_source import REPEATED_TOPICS, ReplaySource, Said, open_source
from calib.station.commands.arguments import positive
from edge.common.errors import LinkError
from edge.link.link import Link
from edge.link.settings import LOOPBACK_ENDPOINT, LinkSettings
from edge.messages import MESSAGES, camera_key, decode, station_key

BEHIND_S = 0.5  # later than this is told at the end: the replay was not at the speed asked for


def play(
    link: Link, site: str, messages: Iterable[Said], speed: float, stop: threading.Event
) -> tuple[Counter[str], float]:
    """Say each message when its time has come; how many of each camera's topics, and by how much it fell behind (s)."""
    said: Counter[str] = Counter()
    behind_s, begin_s, first_ns = 0.0, time.monotonic(), None
    for message in messages:
        first_ns = message.t_ns if first_ns is None else first_ns
        wait_s = begin_s + (message.t_ns - first_ns) * 1e-9 / speed - time.monotonic()
        if stop.wait(max(0.0, wait_s)) if wait_s > 0 else stop.is_set():
            break
        behind_s = max(behind_s, -wait_s)
        _say(link, camera_key(site, message.camera, message.topic), message)
        said[f"{message.camera} {message.topic}"] += 1
    return said, behind_s


def _say(link: Link, key: str, message: Said) -> None:
    if message.topic in REPEATED_TOPICS:
        link.set_state(key, decode(message.payload, MESSAGES[f"cam/{message.topic}"], where=key))
    else:
        link.publish_bytes(key, message.payload)


def replay(source: ReplaySource, arguments: argparse.Namespace, stop: threading.Event) -> int:
    """Open a session, wait for the station, play. Raises LinkError if there is nobody to play to."""
    site: str = arguments.site or source.site
    with Link(LinkSettings(connect=(arguments.connect,)), name="replay") as link:
        for camera in source.cameras:
            link.declare_presence(camera_key(site, camera))
        if arguments.wait > 0:
            _wait_for_station(link, site, arguments.wait, arguments.connect)
        print(f"site {site}, cameras {', '.join(source.cameras)}, at {arguments.speed:g} times speed", flush=True)
        said, behind_s = play(link, site, source.messages(time.time_ns() // 1_000_000), arguments.speed, stop)
    counters = link.counters  # closing sends what is waiting
    for topic, count in sorted(said.items()):
        print(f"  {topic}: {count}")
    if behind_s > BEHIND_S:
        print(f"fell behind by up to {behind_s:.1f} s: this computer does not reach --speed {arguments.speed:g}")
    lost = counters.dropped + counters.stale + counters.failed
    print(f"{counters.published} messages sent, {lost} lost")
    return 0 if lost == 0 else 1


def _wait_for_station(link: Link, site: str, patience_s: float, where: str) -> None:
    inbox = link.watch_presence(station_key(site))
    deadline = time.monotonic() + patience_s
    while (left_s := deadline - time.monotonic()) > 0:
        token = inbox.get(left_s)
        if token is not None and token.alive:
            return
    raise LinkError(
        f"no station of site {site!r} within {patience_s:g} s",
        where=where,
        action="start base-station with that [site] name, give --site or --connect, or --wait 0 to play to nobody",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `base-station replay`."""
    parser.add_argument("source", type=Path, metavar="FOLDER_OR_RECORDING")
    parser.add_argument("--speed", type=positive, default=1.0, help="times real time (default: 1)")
    parser.add_argument("--connect", default=LOOPBACK_ENDPOINT, help=f"Zenoh endpoint (default: {LOOPBACK_ENDPOINT})")
    parser.add_argument("--site", help="play under another site's name")
    parser.add_argument(
        "--wait", type=float, default=30.0, metavar="S", help="for the station (default: 30; 0: do not)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Read the source, play it. Raises SkyfixError if it cannot be read, or nobody hears it."""
    stop = threading.Event()
    with suppress(KeyboardInterrupt):
        return replay(open_source(arguments.source), arguments, stop)
    print("interrupted", file=sys.stderr)
    return 1

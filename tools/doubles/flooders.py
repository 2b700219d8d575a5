"""Neighbours that send without end: each a process of its own, so that it takes nothing from who measures.

python -m tools.doubles.flooders KIND TARGET SECONDS      kinds: connections, tokens, silence, questions, detections
"""

import argparse
import contextlib
import http.client
import socket
import sys
import time
from collections.abc import Callable, Iterator
from typing import Final
from urllib.parse import urlsplit

import msgspec

from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Tracks, camera_key, encode, station_key
from tools.doubles.box_messages import SITE
from tools.doubles.tracks import DETECTION

FLOODER: Final = "evil"  # the camera that it is let in as
CONNECTIONS: Final = 800
QUESTIONS_HZ: Final = 1700.0
FRAMES_HZ: Final = 1000.0
DETECTIONS: Final = 59  # a frame: one fewer than any rule of frames notices
DRIP_S: Final = 0.5  # between two letters of each connection


def connections(target: str, until_s: float) -> None:
    """Slow ones: each asks a letter at a time, and comes again when it is ended."""
    place = _place(target)
    held: list[socket.socket] = []
    while time.monotonic() < until_s:
        while len(held) < CONNECTIONS and time.monotonic() < until_s:
            try:
                one = socket.create_connection(place, timeout=1.0)
                one.sendall(b"GET /status.json HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")
                held.append(one)
            except OSError:
                break
        for one in list(held):
            try:
                one.sendall(b"a")
            except OSError:
                held.remove(one)
                one.close()
        time.sleep(DRIP_S)
    for one in held:
        one.close()


def tokens(target: str, until_s: float) -> None:
    """Wrong tokens, as fast as they are answered."""
    number = 0
    while time.monotonic() < until_s:
        connection = http.client.HTTPConnection(*_place(target), timeout=5)
        with contextlib.suppress(OSError, http.client.HTTPException), contextlib.closing(connection):
            connection.request("GET", f"/status.json?token={number:016}")
            connection.getresponse().read()
        number += 1


def silence(target: str, until_s: float) -> None:
    """Clients that connect, and neither read nor say anything."""
    held: list[socket.socket] = []
    while time.monotonic() < until_s:
        with contextlib.suppress(OSError):
            held.append(socket.create_connection(_place(target), timeout=0.2))
        if len(held) > CONNECTIONS:
            held.pop(0).close()
    for one in held:
        one.close()


def questions(target: str, until_s: float) -> None:
    """Questions for the station's state."""
    with Link(LinkSettings(connect=(target,)), name=FLOODER) as link:
        link.wait_open(10.0)
        session = link._session
        for _ in _paced(QUESTIONS_HZ, until_s):
            session.request(lambda one: one.get(station_key(SITE, "network"), lambda _: None, timeout=1.0))


def detections(target: str, until_s: float) -> None:
    """Valid frames."""
    seen = [msgspec.structs.replace(DETECTION, track=k + 1, u_px=100.0 + 20 * k) for k in range(DETECTIONS)]
    honest = Tracks(
        t_unix_ns=0, seq=0, epoch=1, clock_bound_s=1e-3, size_px=(1920, 1080), readout_s=0.0, detections=seen
    )
    with Link(LinkSettings(connect=(target,)), name=FLOODER) as link:
        link.wait_open(10.0)
        for seq in _paced(FRAMES_HZ, until_s):
            told = msgspec.structs.replace(honest, seq=seq, t_unix_ns=time.time_ns())
            link.publish_bytes(camera_key(SITE, FLOODER, "tracks"), encode(told))


KINDS: Final[dict[str, Callable[[str, float], None]]] = {
    one.__name__: one for one in (connections, tokens, silence, questions, detections)
}


def _paced(rate_hz: float, until_s: float) -> Iterator[int]:
    """Numbers, so many a second at most, until an instant of the monotonic clock."""
    began_s, number = time.monotonic(), 0
    while (now_s := time.monotonic()) < until_s:
        if number > (now_s - began_s) * rate_hz:
            time.sleep(1 / rate_hz)
            continue
        yield number
        number += 1


def _place(target: str) -> tuple[str, int]:
    parts = urlsplit(target)
    assert parts.hostname is not None
    assert parts.port is not None
    return parts.hostname, parts.port


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("target", help="of a port http://HOST:PORT, of Zenoh tcp/HOST:PORT")
    parser.add_argument("seconds", type=float)
    options = parser.parse_args()
    KINDS[options.kind](options.target, time.monotonic() + options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())

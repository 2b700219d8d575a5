"""The page's process, started by the station: `python -m calib.station.page LISTENER FEED`, inherited descriptors."""

import logging
import socket
import sys
from typing import Final

import msgspec

from calib.station.page import wire
from calib.station.page.server import Page, serve
from edge.common.niceness import step_back

PAGE_NICENESS: Final = 10  # tracking comes first


def main() -> int:
    """Serve until the station closes the feed."""
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s page %(levelname)s %(message)s")
    step_back(PAGE_NICENESS)
    listener, feed = (socket.socket(fileno=int(descriptor)) for descriptor in sys.argv[1:3])
    name, payload = wire.unpack(feed.recv(wire.LARGEST))
    if name != "hello":
        return 1
    serve(Page(msgspec.json.decode(payload, type=wire.Hello), feed), listener)
    return 0


if __name__ == "__main__":
    sys.exit(main())

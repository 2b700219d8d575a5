"""Peers that come an hour after the base: it has signed since then, and a receiver of MAVLink believes no past time.

A base starts with a clock that is an hour behind, tracks a target and signs; then its clock is set right, as if an
hour had gone by, and only now the peers start, with the clock they have.
"""

import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.outputs.mavlink.codec import ticks
from tools.doubles.base import TrackingBase, key_of
from tools.doubles.listener import Listener
from tools.doubles.peers import Peers
from tools.doubles.ports import free_port

PASSPHRASE: Final = "hill"
HOUR_S: Final = 3600.0
SETTLES_WITHIN_S: Final = 60.0  # MAVProxy loads its modules, on a busy machine
STOCK_SYSTEM: Final = 42
KINDS: Final = ("HEARTBEAT", "SYSTEM_TIME", "ADSB_VEHICLE", "TARGET_TRACK_ECEF", "TRACKER_STATUS")


def stock_sender(port: int, seconds: float) -> int:
    """Heartbeats as pymavlink signs them by itself, from a sender that started an hour ago; how many."""
    sender = common.MAVLink(None, srcSystem=STOCK_SYSTEM, srcComponent=1)
    sender.signing.secret_key, sender.signing.sign_outgoing = key_of(PASSPHRASE), True
    sender.signing.timestamp = ticks(time.time() - HOUR_S)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        for _ in range(int(seconds)):
            line.sendto(common.MAVLink_heartbeat_message(27, 8, 0, 0, 3, 3).pack(sender), ("127.0.0.1", port))
            time.sleep(1.0)
    return int(seconds)


class Hour:
    """A base that has been up for an hour, and peers that have just come."""

    def __init__(self, stack: ExitStack, peers: Peers, folder: Path) -> None:
        self.folder = folder
        self.tap = stack.enter_context(Listener())
        ports = {name: free_port(socket.SOCK_DGRAM) for name in ("MAVProxy", "stranger", "MAVSDK", "pymavlink")}
        self.port = ports["MAVProxy"]
        urls = [f"udp:127.0.0.1:{port}" for port in (self.tap.port, *ports.values())]
        base = TrackingBase(folder, [{"url": url, "profile": ["gcs", "ecef"]} for url in urls], passphrase=PASSPHRASE)
        stack.callback(base.kill)
        base.start(behind_s=HOUR_S)
        base.wait_until_up()
        stack.enter_context(base.boxes())
        while self.tap.counts["TARGET_TRACK_ECEF"] < 20:
            time.sleep(0.1)
        base.set_clock()
        time.sleep(1.5)  # it looks at its clock once a second
        self.counts: dict[str, Callable[[], Counter[str]]] = {"sent": lambda: self.tap.counts}
        self._meet(stack, peers, ports)

    def _meet(self, stack: ExitStack, peers: Peers, ports: dict[str, int]) -> None:
        late = stack.enter_context(Listener(ports["pymavlink"], key=key_of(PASSPHRASE)))
        self.counts["pymavlink, stock"] = lambda: late.counts
        if peers.has_mavproxy:
            for name, word in (("MAVProxy", PASSPHRASE), ("stranger", "another hill")):
                ear = stack.enter_context(Listener(but_system=STOCK_SYSTEM))
                self.counts[name] = lambda ear=ear: ear.counts  # type: ignore[misc]
                stack.enter_context(peers.mavproxy(name, ports[name], ear.port, word))
        if peers.has_mavsdk:
            said = stack.enter_context(peers.mavsdk(ports["MAVSDK"]))
            self.counts["MAVSDK"] = lambda: Counter({"ADSB_VEHICLE": len(said.read_text().splitlines())})

    def measure(self, seconds: float) -> tuple[dict[str, Counter[str]], int]:
        """What each took in a while, once all have taken something; and what the stock sender sent."""
        deadline = time.monotonic() + SETTLES_WITHIN_S
        while not all(count() for count in self.counts.values()) and time.monotonic() < deadline:
            time.sleep(0.1)
        before = {name: count() for name, count in self.counts.items()}
        stock = stock_sender(self.port, seconds)
        return {name: count() - before[name] for name, count in self.counts.items()}, stock

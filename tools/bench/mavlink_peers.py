"""Do others read what the base says, signed, an hour after it started? MAVProxy, MAVSDK, Wireshark and stock pymavlink.

    python -m venv peers && peers/bin/pip install MAVProxy mavsdk setuptools; apt install tshark
    python -m tools.bench.mavlink_peers --peers peers            what is not installed is said to be absent

A base starts with a clock that is an hour behind, tracks a target and signs; then its clock is set right, as if an
hour had gone by, and only now the peers start, with the clock they have. Each row counts what a peer took for good
and what was sent meanwhile, as counted by a listener that verifies nothing. Two controls: a MAVProxy with another
key, and a sender that has been up for an hour and only adds ten microseconds a message, as libraries do.
"""

import argparse
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.outputs.mavlink.codec import ticks
from tools.demonstration.site import free_port
from tools.doubles.base import Base, key_of
from tools.doubles.peers import Ear, Peers, dissected, has_wireshark

PASSPHRASE: Final = "hill"
HOUR_S: Final = 3600.0
SETTLES_S: Final = 10.0  # what MAVProxy takes to load its modules
STOCK_SYSTEM: Final = 42
KINDS: Final = ("HEARTBEAT", "SYSTEM_TIME", "ADSB_VEHICLE", "TARGET_TRACK_ECEF", "TRACKER_STATUS")
IDS: Final = {"TARGET_TRACK_ECEF": "45000", "TRACKER_STATUS": "45001", "ADSB_VEHICLE": "246", "HEARTBEAT": "0"}


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
        self.tap = stack.enter_context(Ear())
        ports = {name: free_port(socket.SOCK_DGRAM) for name in ("MAVProxy", "stranger", "MAVSDK", "pymavlink")}
        self.port = ports["MAVProxy"]
        urls = [f"udp:127.0.0.1:{port}" for port in (self.tap.port, *ports.values())]
        base = Base(folder, [{"url": url, "profile": ["gcs", "ecef"]} for url in urls], passphrase=PASSPHRASE)
        base.start(behind_s=HOUR_S)
        stack.callback(base.kill)
        stack.enter_context(base.boxes())
        while self.tap.counts["TARGET_TRACK_ECEF"] < 20:
            time.sleep(0.1)
        base.set_clock()
        time.sleep(1.5)  # it looks at its clock once a second
        self.counts: dict[str, Callable[[], Counter[str]]] = {"sent": lambda: Counter(self.tap.counts)}
        self._meet(stack, peers, ports)

    def _meet(self, stack: ExitStack, peers: Peers, ports: dict[str, int]) -> None:
        late = stack.enter_context(Ear(ports["pymavlink"], key_of(PASSPHRASE)))
        self.counts["pymavlink, stock"] = lambda: Counter(late.counts)
        if peers.has_mavproxy:
            for name, word in (("MAVProxy", PASSPHRASE), ("stranger", "another hill")):
                ear = stack.enter_context(Ear(but_system=STOCK_SYSTEM))
                self.counts[name] = lambda ear=ear: Counter(ear.counts)  # type: ignore[misc]
                stack.enter_context(peers.mavproxy(name, ports[name], ear.port, word))
        if peers.has_mavsdk:
            said = stack.enter_context(peers.mavsdk(ports["MAVSDK"]))
            self.counts["MAVSDK"] = lambda: Counter({"ADSB_VEHICLE": len(said.read_text().splitlines())})

    def measure(self, seconds: float) -> tuple[dict[str, Counter[str]], int]:
        """What each took in a while, once all are up; and what the stock sender sent."""
        time.sleep(SETTLES_S if len(self.counts) > 2 else 0.0)
        before = {name: count() for name, count in self.counts.items()}
        stock = stock_sender(self.port, seconds)
        return {name: count() - before[name] for name, count in self.counts.items()}, stock


def row(peer: str, what: str, taken: int, sent: int, asked: str = "all") -> None:
    """A line of the table."""
    print(f"{peer:40} {what:18} {taken:6} of {sent:6}   asked: {asked}", flush=True)


def report(found: dict[str, Counter[str]], stock: int) -> None:
    """The table of what was taken for good."""
    sent = found["sent"]
    for kind in KINDS:
        row("pymavlink, stock", kind, found["pymavlink, stock"][kind], sent[kind])
    row("pymavlink, stock: refused", "any", found["pymavlink, stock"]["BAD_DATA"], sum(sent.values()), "none")
    if "MAVProxy" in found:
        for kind in KINDS[:3]:
            row("MAVProxy, nothing unsigned", kind, found["MAVProxy"][kind], sent[kind])
        # Of kinds that it knows: what it does not know it hands on unread, whoever signed it.
        taken, known = (sum(counts[kind] for kind in KINDS[:3]) for counts in (found["stranger"], sent))
        row("MAVProxy with another key", "those three", taken, known, "none (control)")
        others = found["MAVProxy"]["others"]
        row("MAVProxy, from one that does not refresh", "HEARTBEAT", others, stock, "none (control)")
    if "MAVSDK" in found:
        row("MAVSDK, transponder", "ADSB_VEHICLE", found["MAVSDK"]["ADSB_VEHICLE"], sent["ADSB_VEHICLE"])


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", type=Path, required=True, help="a virtual environment with MAVProxy and mavsdk")
    parser.add_argument("--seconds", type=float, default=15.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        peers = Peers(options.peers.resolve(), Path(temporary))
        hour = Hour(stack, peers, Path(temporary))
        print("the base tracks and signs; an hour has gone by; the peers have started", flush=True)
        report(*hour.measure(options.seconds))
        if has_wireshark():
            datagrams, sent = list(hour.tap.datagrams), Counter(hour.tap.counts)
            shown = dissected(datagrams, Path(temporary))
            for kind, number in IDS.items():
                row("Wireshark, all that was sent", kind, shown[number], sent[kind])
    absent = {"MAVProxy": peers.has_mavproxy, "MAVSDK": peers.has_mavsdk, "Wireshark": has_wireshark()}
    print("absent: " + (", ".join(name for name, there in absent.items() if not there) or "nobody"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

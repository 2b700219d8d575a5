"""Do others read what the base says, signed, an hour after it started? MAVProxy, MAVSDK, Wireshark and stock pymavlink.

    make peers; apt install tshark
    python -m tools.bench.mavlink_peers            what is not installed is said to be absent

A base starts with a clock that is an hour behind, tracks a target and signs; then its clock is set right, as if an
hour had gone by, and only now the peers start, with the clock they have. Each row counts what a peer took for good
and what was sent meanwhile, as counted by a listener that verifies nothing. Two controls: a MAVProxy with another
key, and a sender that has been up for an hour and only adds ten microseconds a message, as libraries do.
"""

import argparse
import sys
import tempfile
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from tools.doubles.base import ROOT
from tools.doubles.peers import Peers, dissected, has_wireshark
from tools.doubles.peers_at_base import KINDS, Hour

PEERS: Final = ROOT / ".venv" / "peers"
IDS: Final = {"TARGET_TRACK_ECEF": "45000", "TRACKER_STATUS": "45001", "ADSB_VEHICLE": "246", "HEARTBEAT": "0"}


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
    parser.add_argument("--peers", type=Path, default=PEERS, help="a virtual environment with MAVProxy and mavsdk")
    parser.add_argument("--seconds", type=float, default=15.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        peers = Peers(options.peers.resolve(), Path(temporary))
        hour = Hour(stack, peers, Path(temporary))
        print("the base tracks and signs; an hour has gone by; the peers have started", flush=True)
        report(*hour.measure(options.seconds))
        if has_wireshark():
            datagrams, sent = hour.tap.datagrams, hour.tap.counts
            shown = dissected(datagrams, Path(temporary))
            for kind, number in IDS.items():
                row("Wireshark, all that was sent", kind, shown[number], sent[kind])
    absent = {"MAVProxy": peers.has_mavproxy, "MAVSDK": peers.has_mavsdk, "Wireshark": has_wireshark()}
    print("absent: " + (", ".join(name for name, there in absent.items() if not there) or "nobody"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

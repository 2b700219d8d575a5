"""Somebody who speaks under a camera's key: with the certificate he has, or none, what he was given, at a steady pace.

    python -m tools.doubles.intruder --connect ENDPOINT --key KEY --payloads FILE [--certificate FOLDER] [--rate HZ]

FILE holds a payload a line. Prints how many he handed to his session, which says nothing of how many arrived.
"""

import argparse
import time
from pathlib import Path

import zenoh

from edge.link.profile import zenoh_config
from edge.link.settings import LinkSettings, TlsSettings

OPENS_WITHIN_S = 5.0


def main() -> None:
    """Speak, or try to."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--connect", required=True)
    parser.add_argument("--key", required=True)
    parser.add_argument("--payloads", required=True, type=Path)
    parser.add_argument("--certificate", type=Path)
    parser.add_argument("--rate", type=float, default=100.0)
    options = parser.parse_args()
    own = options.certificate
    files = {} if own is None else {name: str(own / f"{name}.pem") for name in ("authority", "certificate", "key")}
    settings = LinkSettings(connect=(options.connect,), tls=TlsSettings(**files) if files else None)
    said = 0
    with zenoh.open(zenoh_config(settings)) as session:
        publisher = session.declare_publisher(options.key, congestion_control=zenoh.CongestionControl.BLOCK)
        deadline = time.monotonic() + OPENS_WITHIN_S
        while time.monotonic() < deadline and not publisher.matching_status.matching:  # type: ignore[attr-defined]
            time.sleep(0.05)
        for payload in options.payloads.read_bytes().splitlines():
            publisher.put(payload)
            said += 1
            time.sleep(1 / options.rate)
    print(said)


if __name__ == "__main__":
    main()

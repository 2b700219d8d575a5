"""Every recording through the reader: what was accepted, what was refused and why, and what the session is worth.

python -m tools.bench.gnss_recordings FOLDER_OR_FILE...
"""

import argparse
import sys
from pathlib import Path
from typing import Final

import numpy as np

from edge.gnss.gates import Position, offset_m
from edge.gnss.session import StaticSession

PIECE: Final = 1460  # bytes at a time: a network packet; what it cuts must not matter


def main() -> int:
    """Print the table. Returns 1 if a recording could not be read."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+", help="files, or folders of them")
    args = parser.parse_args()
    paths = [path for given in args.recordings for path in (sorted(given.iterdir()) if given.is_dir() else [given])]
    for path in paths:
        try:
            data = path.read_bytes()
        except OSError as error:
            print(f"{path}: {error}", file=sys.stderr)
            return 1
        print("\n".join(report(path.name, data)))
    return 0


def report(name: str, data: bytes) -> list[str]:
    """The lines about one recording."""
    session, accepted = play(data)
    head = f"{name}: {len(data)} bytes, {session.counts['epochs']} epochs, {len(accepted)} accepted"
    malformed, checksum = session.counts["malformed"], session.frame_counts["bad checksum"]
    if malformed or checksum:
        head += f", {malformed} sentences malformed, {checksum} checksums wrong"
    lines = [head, *(f"    refused {count:5d}  {reason}" for reason, count in session.refusals.most_common() if count)]
    surveyed = session.surveyed()
    if surveyed is None:
        return lines
    mean = surveyed.mean
    east, north, up = (1000 * sigma for sigma in mean.sigma_m)
    lines.append(f"    accepted ones lie within {spread_m(accepted):.3f} m; last {mean.duration_s:.0f} s of them:")
    if mean.fault:
        return [*lines, f"    SESSION REFUSED: {mean.fault}"]
    return [*lines, f"    session good: sigma {east:.0f} {north:.0f} {up:.0f} mm, {mean.segments} segments"]


def play(data: bytes) -> tuple[StaticSession, list[Position]]:
    """A session that has seen all of it, and what it accepted."""
    session = StaticSession()
    accepted = [
        position for at in range(0, len(data), PIECE) for position in session.feed(data[at : at + PIECE], at / 1e5)
    ]
    return session, accepted + session.interrupt(len(data) / 1e5)


def spread_m(accepted: list[Position]) -> float:
    """The largest horizontal distance from the first."""
    offsets = np.array([offset_m(position, accepted[0]) for position in accepted])
    return float(np.hypot(offsets[:, 0], offsets[:, 1]).max())


if __name__ == "__main__":
    sys.exit(main())

"""Make edge/gnss/egm96_15.xz from PROJ's egm96_15.gtx (Debian's proj-data): `python -m tools.make_geoid egm96_15.gtx`.

EGM96 is the United States' (NIMA and NASA, 1998) and in the public domain. The file holds 721 x 1440 heights of the
geoid above the ellipsoid, every quarter of a degree from 90 S 180 W, rows from south to north: 16-bit differences
along each row in units of 5 cm, little-endian, LZMA.
"""

import argparse
import lzma
import struct
from pathlib import Path

import numpy as np

from edge.gnss.geoid import COLUMNS, FILE, ROWS, UNIT_M


def main() -> None:
    """Write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gtx", type=Path)
    raw = parser.parse_args().gtx.read_bytes()
    if struct.unpack(">4d2i", raw[:40]) != (-90.0, -180.0, 0.25, 0.25, ROWS, COLUMNS):
        parser.error("not a whole Earth at 15 minutes from 90 S 180 W")
    steps = np.round(np.frombuffer(raw[40:], ">f4").reshape(ROWS, COLUMNS) / UNIT_M).astype("<i2")
    along = np.diff(steps, axis=1, prepend=np.zeros((ROWS, 1), "<i2")).astype("<i2")
    FILE.write_bytes(lzma.compress(along.tobytes(), preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main()

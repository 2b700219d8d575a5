"""How fast is the reader, compared with a line of 460 800 baud?

python -m tools.bench.gnss_throughput [RECORDING...]
"""

import argparse
import time
from pathlib import Path
from typing import Final

import numpy as np

from edge.gnss.session import StaticSession
from tools.bench.gnss_corruption import synthetic

LINE_BYTES_S: Final = 46_080  # 460 800 baud, ten bits a byte
ASKED: Final = 20
PIECE: Final = 4096
LEAST_BYTES: Final = 2_000_000


def main() -> None:
    """Time the synthetic stream (GGA, RMC, GST, ZDA and nothing else: the hardest) and the recordings given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="*")
    args = parser.parse_args()
    streams = {"GGA RMC GST ZDA only": synthetic(np.random.default_rng(1))}
    streams |= {path.name: path.read_bytes() for path in args.recordings}
    print(f"A line of 460 800 baud carries {LINE_BYTES_S} bytes/s; asked: {ASKED} times that")
    for name, stream in streams.items():
        rate = bytes_per_second(stream)
        print(f"{name:40s} {rate / 1e6:7.2f} MB/s  {rate / LINE_BYTES_S:6.1f} lines")


def bytes_per_second(stream: bytes) -> float:
    """CPU rate of framing, decoding, joining and both gates, on one core."""
    rounds = max(1, LEAST_BYTES // len(stream))
    began = time.process_time()
    for _ in range(rounds):
        session = StaticSession()
        for at in range(0, len(stream), PIECE):
            session.feed(stream[at : at + PIECE], at / LINE_BYTES_S)
    return rounds * len(stream) / (time.process_time() - began)


if __name__ == "__main__":
    main()

"""Millions of bytes of broken streams: does the reader survive, and is a wrong epoch ever accepted?

    python -m tools.bench.gnss_corruption [--bytes N] [--seed N] [RECORDING...]

A good static stream (synthetic, and the recordings given) is bit-flipped, cut, and interleaved with other streams.
Every accepted epoch is compared with what the good stream says at that time.
"""

import argparse
import datetime as dt
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from edge.gnss.decoders.ubx import fletcher
from edge.gnss.gates import Position, offset_m
from edge.gnss.session import StaticSession
from tools.doubles.receiver import Place, gga, gst, rmc, rtk_error, zda

WRONG_M: Final = 0.05
BLOCK_S: Final = 600  # of stream between fresh sessions
FLIP_RATES: Final = (1e-5, 1e-4, 1e-3)  # of bits
START: Final = dt.datetime(2026, 6, 1, 9, 0, 0, tzinfo=dt.UTC)

Damage = Callable[[bytes, np.random.Generator], bytes]


def main() -> None:
    """Run until enough bytes were fed and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("recordings", type=Path, nargs="*")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    streams = [synthetic(rng)] + [path.read_bytes() for path in args.recordings]
    print(f"seed {args.seed}, {len(streams)} good streams, {args.bytes} bytes of damaged ones")
    print("damage               bytes      epochs   accepted    lost     wrong by > 5 cm   worst (m)")
    began = time.monotonic()
    share = args.bytes // len(DAMAGES)
    worst = [row(name, damage, streams, share, rng) for name, damage in DAMAGES.items()]
    print(f"worst of all {max(worst):.4f} m; {time.monotonic() - began:.0f} s; nothing raised")


def row(name: str, damage: Damage, streams: list[bytes], least: int, rng: np.random.Generator) -> float:
    """One kind of damage: prints its line, returns the worst error of an accepted epoch."""
    truths = [{position.t_day_ms: position for position in accepted_of(stream)[0]} for stream in streams]
    fed = epochs = accepted = lost = wrong = 0
    worst = 0.0
    while fed < least:
        for stream, truth in zip(streams, truths, strict=True):
            broken = damage(stream, rng)
            positions, seen = accepted_of(broken, rng)
            errors = [error_m(position, truth) for position in positions]
            fed, epochs, accepted = fed + len(broken), epochs + seen, accepted + len(positions)
            lost += len(truth) - len(positions)
            wrong += sum(error > WRONG_M for error in errors)
            worst = max([worst, *errors])
    print(f"{name:18s} {fed:9d} {epochs:9d} {accepted:9d} {lost:9d} {wrong:12d} {worst:16.4f}")
    return worst


def accepted_of(stream: bytes, rng: np.random.Generator | None = None) -> tuple[list[Position], int]:
    """What a fresh session accepts of a stream, cut into pieces of random size, and how many epochs it saw."""
    session = StaticSession()
    accepted: list[Position] = []
    at = 0
    while at < len(stream):
        size = 4096 if rng is None else int(rng.integers(1, 4096))
        accepted += session.feed(stream[at : at + size], at / 1000)
        at += size
    return accepted + session.interrupt(at / 1000), session.counts["epochs"]


def error_m(position: Position, truth: dict[int, Position]) -> float:
    """How far an accepted epoch is from the good stream's of that time, or from its nearest in time."""
    there = truth.get(position.t_day_ms)
    if there is None:
        there = truth[min(truth, key=lambda t_day_ms: abs(t_day_ms - position.t_day_ms))]
    return float(np.linalg.norm(offset_m(position, there)))


def synthetic(rng: np.random.Generator) -> bytes:
    """Ten minutes of a good receiver with everything it can say."""
    place = Place()
    t = np.arange(float(BLOCK_S))
    times = [START + dt.timedelta(seconds=float(second)) for second in t]
    errors = rtk_error(t, rng)
    return b"".join(
        gga(when, place, error) + rmc(when) + gst(when) + zda(when) for when, error in zip(times, errors, strict=True)
    )


def flipped(rate: float) -> Damage:
    """Every bit flips with this probability."""

    def damage(stream: bytes, rng: np.random.Generator) -> bytes:
        bits = np.unpackbits(np.frombuffer(stream, np.uint8))
        bits ^= (rng.random(len(bits)) < rate).astype(np.uint8)
        return np.packbits(bits).tobytes()

    return damage


def digits_swapped(stream: bytes, rng: np.random.Generator) -> bytes:
    """Pairs of digits change so that the checksum still holds: what it cannot see."""
    out = bytearray(stream)
    for at in rng.integers(0, len(out) - 80, len(out) // 400):
        other = int(at + rng.integers(1, 60))
        low = int(rng.integers(1, 8))
        if all(48 <= out[i] <= 57 and 48 <= out[i] ^ low <= 57 for i in (at, other)):
            out[at] ^= low
            out[other] ^= low
    return bytes(out)


def cut(stream: bytes, rng: np.random.Generator) -> bytes:
    """Stretches are missing."""
    return b"".join(piece for piece in pieces(stream, rng, 2000) if rng.random() > 0.2)


def repeated(stream: bytes, rng: np.random.Generator) -> bytes:
    """Stretches come twice."""
    return b"".join(piece * (2 if rng.random() < 0.1 else 1) for piece in pieces(stream, rng, 1000))


def interleaved(stream: bytes, rng: np.random.Generator) -> bytes:
    """Noise, binary messages, false headers and foreign sentences between the pieces."""
    return b"".join(piece + foreign(rng) for piece in pieces(stream, rng, 300))


def foreign(rng: np.random.Generator) -> bytes:
    """Something that is none of this receiver's sentences."""
    kind = rng.integers(4)
    noise = rng.integers(0, 256, int(rng.integers(0, 120)), dtype=np.uint8).tobytes()
    if kind == 0:
        return noise
    if kind == 1:
        inner = b"\x02\x15" + len(noise).to_bytes(2, "little") + noise
        return b"\xb5\x62" + inner + fletcher(inner)
    if kind == 2:
        return b"\xb5\x62\x01\x07" + int(rng.integers(0, 9000)).to_bytes(2, "little")
    return b"\xd3" + (len(noise) & 0x3FF).to_bytes(2, "big") + noise


def pieces(stream: bytes, rng: np.random.Generator, size: int) -> Iterator[bytes]:
    """The stream in pieces of random size, `size` on average."""
    at = 0
    while at < len(stream):
        step = int(rng.integers(1, 2 * size))
        yield stream[at : at + step]
        at += step


DAMAGES: Final[dict[str, Damage]] = {
    **{f"bits flipped {rate:g}": flipped(rate) for rate in FLIP_RATES},
    "checksum evaded": digits_swapped,
    "cut": cut,
    "repeated": repeated,
    "interleaved": interleaved,
}


if __name__ == "__main__":
    main()

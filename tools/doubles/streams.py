"""Streams in virtual time whose own clocks lie in the ways that cameras, restreamers and recorders do.

Each frame says when it was taken in truth, what the stream and the sender say, and when it arrived; stamps are held
against the truth. Seeded: the rate, the size of a lie and its instant are drawn, the network's jitter too.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

UTC_NS: Final = 1_700_000_000 * 10**9  # UTC minus the monotonic clock of these streams
BEGIN_NS: Final = 50_000 * 10**9  # monotonic, of the first frame


@dataclass(frozen=True)
class StreamFrame:
    """One frame: true_unix_ns when it was taken, stream_ns the stream's own time, sent_unix_ns what the sender says."""

    true_unix_ns: int
    stream_ns: int
    sent_unix_ns: int | None
    arrival_ns: int


@dataclass(frozen=True)
class StreamScene:
    """How a stream lies. stream_s: its time of a frame (number, true seconds). clock_s: how far the sender's clock is
    off, None for a sender that says nothing. stall_s: further delay at a true second. skips: frames that never come."""

    fps: float
    stream_s: Callable[[int, float], float]
    clock_s: float | None
    delay_s: float
    jitter_s: float
    stall_s: Callable[[float], float] = lambda t: 0.0
    skips: Callable[[int], bool] = lambda k: False

    def frames(self, seconds: float, rng: np.random.Generator) -> Iterator[StreamFrame]:
        """The frames of some seconds, in the order they arrive."""
        last_ns = 0
        first_s = self.stream_s(0, 0.0)
        for k in range(round(seconds * self.fps)):
            t = k / self.fps
            if self.skips(k):
                continue
            late = self.delay_s + float(rng.exponential(self.jitter_s)) + self.stall_s(t)
            last_ns = max(last_ns + 100_000, BEGIN_NS + round((t + late) * 1e9))  # in order, as TCP delivers
            stream_s = self.stream_s(k, t)
            sent = None
            if self.clock_s is not None:  # tied to the stream once, at its first report
                sent = UTC_NS + BEGIN_NS + round((stream_s - first_s + self.clock_s) * 1e9)
            yield StreamFrame(UTC_NS + BEGIN_NS + round(t * 1e9), round(stream_s * 1e9), sent, last_ns)


def scenes(seed: int) -> dict[str, StreamScene]:
    """Every kind of lie, its numbers drawn from a seed."""
    rng = np.random.default_rng(seed)
    fps = float(rng.choice([5, 10, 12, 15, 20, 25, 30]))
    nominal = float(rng.choice([15, 20, 25, 30, 60]))
    at, back, ahead = float(rng.uniform(4, 20)), float(rng.uniform(2, 5000)), float(rng.uniform(2, 40_000))
    off, every = float(rng.uniform(3, 5000)), int(rng.integers(20, 80))
    delay, jitter = float(rng.uniform(0.005, 0.06)), float(rng.uniform(0.0, 0.006))
    slow = float(rng.uniform(0.12, 1.8))
    drift = float(rng.uniform(-80e-6, 80e-6))
    stall_at, stall = float(rng.uniform(5, 20)), float(rng.uniform(0.5, 6))
    true: Callable[[int, float], float] = lambda k, t: 100.0 + t  # noqa: E731
    counted: Callable[[int, float], float] = lambda k, t: k / nominal  # noqa: E731

    def fallen(k: int, t: float) -> float:
        return 10_000 + t - (back if t > at else 0.0)

    def risen(k: int, t: float) -> float:
        return t + (ahead if t > at else 0.0)

    def strays(k: int, t: float) -> float:
        return 20_000 + t + (ahead if k % every == every - 1 else 0.0)

    def strays_back(k: int, t: float) -> float:
        return 20_000 + t - (back if k % every == every - 1 else 0.0)

    def slower_later(k: int, t: float) -> float:
        return t if t < at else at + (t - at) * 0.5

    def drifting(k: int, t: float) -> float:
        return t * (1 + drift)

    def doubled(k: int, t: float) -> float:
        return (k - k % 2) / fps

    def stalled(t: float) -> float:
        return max(0.0, stall - 4 * (t - stall_at)) if t >= stall_at else 0.0

    streams = {
        "true": true, "counted": counted, "fallen": fallen, "risen": risen, "strays": strays, "drifting": drifting,
        "strays_back": strays_back, "slower_later": slower_later, "doubled": doubled,
    }  # fmt: skip
    found = {}
    for name, stream in streams.items():
        found[name] = StreamScene(fps, stream, None, delay, jitter)
        if name != "doubled":
            found[f"{name}, reports"] = StreamScene(fps, stream, 0.0, delay, jitter)
    found["clock ahead"] = StreamScene(fps, true, off, delay, jitter)
    found["clock behind"] = StreamScene(fps, true, -off, delay, jitter)
    found["clock a little behind"] = StreamScene(fps, true, -slow, delay, jitter)
    found["stalled"] = StreamScene(fps, true, None, delay, jitter, stalled)
    found["stalled, reports"] = StreamScene(fps, true, 0.0, delay, jitter, stalled)
    return found


def mixtures(seed: int) -> dict[str, StreamScene]:
    """Two lies at once, and networks that do more than jitter: twenty kinds."""
    rng = np.random.default_rng(seed)
    fps = float(rng.choice([5, 10, 12, 15, 20, 25, 30]))
    at, later = float(rng.uniform(8, 18)), float(rng.uniform(22, 40))
    jump = float(rng.choice([-1, 1]) * rng.uniform(1.5, 3000))
    rate = float(rng.choice([rng.uniform(0.4, 0.85), rng.uniform(1.2, 2.2)]))
    grown, period = float(rng.uniform(0.3, 3.0)), int(rng.integers(3, 25))
    delay, jitter, lost = float(rng.uniform(0.005, 0.06)), float(rng.uniform(0.0, 0.006)), float(rng.uniform(0.05, 0.5))
    gone = set(np.flatnonzero(rng.uniform(size=5000) < lost).tolist())
    streams: dict[str, Callable[[int, float], float]] = {
        "runs true": lambda k, t: 300.0 + t,
        "runs at another rate": lambda k, t: 300.0 + rate * t,
        "jumps": lambda k, t: 5000.0 + t + (jump if t > at else 0.0),
        "runs at another rate and jumps": lambda k, t: 5000.0 + rate * t + (jump if t > at else 0.0),
        "jumps twice": lambda k, t: 9000.0 + t + (jump if t > at else 0.0) - (jump / 2 if t > later else 0.0),
        "stands still and goes on": lambda k, t: 300.0 + (t if t < at else max(at, t - 3.0)),
    }
    networks: dict[str, Callable[[float], float]] = {
        "delay grows and falls": lambda t: grown * max(0.0, 1 - abs(t - later) / 8.0),
        "bursts": lambda t: (period - 1 - round(t * fps) % period) / fps,
    }
    found = {}
    for says, clock_s in (("", None), (", reports", 0.0)):
        for name, stream in streams.items():
            found[f"{name}, frames lost{says}"] = StreamScene(
                fps, stream, clock_s, delay, jitter, skips=lambda k: k in gone and k > 0
            )
        for name in ("runs true", "jumps"):
            for how, stall in networks.items():
                found[f"{name}, {how}{says}"] = StreamScene(fps, streams[name], clock_s, delay, jitter, stall)
    return found


def uneven(seed: int) -> dict[str, StreamScene]:
    """Stamps that are off by less than a second: uneven, rounded, by twos, a little faster, a little ahead.

    A stream with reports that begins to run much faster is not among them: that shows a frame later than it is so.
    """
    rng = np.random.default_rng(seed)
    fps = float(rng.choice([5, 8, 10, 12.5, 15, 25, 29.97, 50, 60]))
    at, every, step = float(rng.uniform(6, 25)), float(rng.uniform(2, 8)), float(rng.uniform(0.02, 0.9))
    faster, noise_s, tick_s = (
        float(rng.uniform(1.1, 3.0)),
        float(rng.uniform(0.01, 0.045)),
        float(rng.uniform(0.03, 0.1)),
    )
    delay, jitter, ahead = (
        float(rng.uniform(0.005, 0.06)),
        float(rng.uniform(0.0, 0.006)),
        float(rng.uniform(0.02, 0.4)),
    )
    off = rng.uniform(-1, 1, 5000)
    streams: dict[str, Callable[[int, float], float]] = {
        "by twos, ahead": lambda k, t: (k + k % 2) / fps,
        "by threes": lambda k, t: (k - k % 3) / fps,
        "noisy": lambda k, t: t + (noise_s * off[k % len(off)] if k else 0.0),
        "rounded": lambda k, t: round(t / tick_s) * tick_s,
        "steps ahead": lambda k, t: t + step * int(t / every),
        "steps back": lambda k, t: t - step * int(t / every),
        "faster later": lambda k, t: t if t < at else at + (t - at) * faster,
    }
    found = {name: StreamScene(fps, stream, None, delay, jitter) for name, stream in streams.items()}
    found |= {f"{name}, reports": StreamScene(fps, stream, 0.0, delay, jitter) for name, stream in streams.items()}
    del found["faster later, reports"]
    found["clock a little ahead"] = StreamScene(fps, lambda k, t: t, delay + ahead, delay, jitter)
    return found

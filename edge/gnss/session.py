"""From a receiver's bytes to a surveyed position: framing, decoding, joining, both gates and the average, in order.

Pure: bytes and times are handed in, so a live receiver, a recording and a test run the same code. A session looks at
the last ten minutes only: longer averaging gains little, and a tripod that was moved is accepted again after that. What
a receiver says while it still converges is dropped, and a minute must pass at rest before it is accepted again.
"""

import datetime as dt
import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from edge.gnss.averaging import MIN_DURATION_S, SERVICES, Service, StaticMean, average
from edge.gnss.decoder import Decoder, MalformedError
from edge.gnss.decoders import decoders as all_decoders
from edge.gnss.epoch import MS_PER_DAY, Epoch, EpochAssembler
from edge.gnss.framing import Framer, Packet
from edge.gnss.gates import (
    CONFIRMATIONS,
    MAX_STEP_H_M,
    Policy,
    Position,
    Reason,
    Refusal,
    StillnessGate,
    elapsed_ms,
    judge,
    metres_per_degree,
    offset_m,
)
from edge.gnss.way import Way

STATIC_WINDOW_S: Final = 600.0  # 180 s -> 600 s still gains a third, more hardly anything
SETTLING_S: Final = 60.0  # a receiver that has just fixed converges for up to a minute
MOST_EPOCHS: Final = 12_000  # ten minutes at 20 Hz
BASELINE_LASTS_S: Final = 60.0  # a distance that was not told for so long may be another base's by now
REMEMBERED_EPOCHS: Final = 30  # epochs that are looked back on for positions of two places in turn
# Refusals that say something of the antenna, and not only of the message: that it may be elsewhere by now.
SPEAKS_AGAINST: Final = frozenset({Reason.QUALITY, Reason.JUMP})
NS_PER_MS: Final = 1_000_000
NS_PER_DAY: Final = MS_PER_DAY * NS_PER_MS


@dataclass(frozen=True)
class Surveyed:
    """A session's result: degrees, ellipsoidal metres, and the mean it comes from.

    trusted_in_s: seconds at rest until it may be used; 0 where it may, None where waiting alone does not mend it.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    mean: StaticMean
    latest: Position
    trusted_in_s: float | None = 0.0

    @property
    def settling(self) -> bool:
        """Whether it is a good mean of an antenna that has not been at rest for long enough."""
        return bool(self.trusted_in_s) and not self.mean.young


@dataclass(frozen=True)
class _Accepted:
    t_s: float
    segment: int
    position: Position
    offset_m: tuple[float, float, float]


class StaticSession:
    """One antenna at rest."""

    def __init__(
        self,
        service: Service = SERVICES["network-rtk"],
        policy: Policy | None = None,
        *,
        baseline_m: float = 0.0,
        decoders: Iterable[Decoder] | None = None,
    ) -> None:
        """decoders: of the protocols to read; None for all there are."""
        self._service = service
        self._policy = policy or Policy()
        self.set_baseline_m = baseline_m
        self._told_baseline: tuple[float, float] | None = None  # when, by the clock of our own, and m
        self._t_s = -math.inf
        self._decoders = {decoder.name: decoder for decoder in decoders or all_decoders()}
        self._framer = Framer(self._decoders.values())
        self._assembler = EpochAssembler()
        self._gate = StillnessGate()
        self._window: deque[_Accepted] = deque(maxlen=MOST_EPOCHS)
        self._segment = 0
        self._now_s = 0.0
        self._moved_until_s = -math.inf
        self._moved = ""
        self._provisional: deque[Reason] = deque(maxlen=CONFIRMATIONS)
        self._way = Way()
        self.moves = 0  # how often the antenna was seen to move: what was averaged before is of another place
        self.carries = 0  # and of those how often it was seen on its whole way
        self.counts: Counter[str] = Counter()
        self.refusals: Counter[Reason] = Counter()
        self.last_refusal: Refusal | None = None
        self.against = ""  # why the newest epoch does not confirm the position; empty where it does
        self.jumps = 0  # epochs in a row that were elsewhere
        self.last_malformed = ""  # what could not be read of the last message that broke its own rules
        self.latest: Epoch | None = None
        self._newest: deque[Position] = deque(maxlen=3)
        self._turns: deque[bool] = deque(
            maxlen=REMEMBERED_EPOCHS
        )  # whether each was back where the last but one was, by a jump
        self.last_message_s: float | None = None
        self.last_accepted_s: float | None = None

    @property
    def frame_counts(self) -> Counter[str]:
        """Bytes, frames of each protocol and failed checksums so far."""
        return self._framer.counts

    @property
    def frames(self) -> int:
        """Whole frames so far, of any protocol."""
        return self._framer.frames

    @property
    def wanted(self) -> str:
        """The messages that a receiver must send, in words."""
        return ", or ".join(decoder.wanted for decoder in self._decoders.values())

    def feed(self, data: bytes, t_s: float) -> list[Position]:
        """The positions accepted because of `data`, which came at monotonic t_s. Feed b"" when nothing comes."""
        self._t_s = t_s
        epochs: list[Epoch] = []
        for frame in self._framer.feed(data, t_s):
            epochs += self._add(frame, t_s)
        epochs += self._assembler.idle(t_s)
        return [position for epoch in epochs for position in self._take(epoch, t_s)]

    def interrupt(self, t_s: float) -> list[Position]:
        """The port was lost or has ended: finish what is open, begin a new segment."""
        self._framer.reset()
        accepted = [position for epoch in self._assembler.flush() for position in self._take(epoch, t_s)]
        self._gate.interrupt()
        return accepted

    def restart(self) -> None:
        """Forget all positions: another tripod, or another occupation of the same."""
        self._gate.interrupt()
        self._turns.clear()
        self._window.clear()
        self._way = Way()
        self._moved_until_s = -math.inf

    def surveyed(self) -> Surveyed | None:
        """The position averaged so far; None before the first accepted epoch. Its mean's `fault` may forbid its use."""
        if not self._window:
            return None
        mean = self._mean()
        while mean.moved_until_s is not None:
            self._moved_until_s, self._moved = mean.moved_until_s, mean.fault
            self.moves += 1
            while self._window[0].t_s < mean.moved_until_s:
                self._window.popleft()
            mean = self._mean()
        rest_s = self._now_s - self._moved_until_s
        if rest_s < SETTLING_S and (not mean.fault or mean.young):
            mean = replace(mean, fault=f"{self._moved}; at rest for {rest_s:.0f} of {SETTLING_S:.0f} s", young=False)
            left_s: float | None = SETTLING_S - rest_s
        else:
            left_s = max(MIN_DURATION_S - mean.duration_s, 1.0) if mean.young else None if mean.fault else 0.0
        origin = self._origin
        east_m, north_m = metres_per_degree(origin.lat_deg)
        east, north, up = (float(value) for value in mean.mean_m)
        return Surveyed(
            origin.lat_deg + north / north_m,
            (origin.lon_deg + east / east_m + 180) % 360 - 180,
            origin.height_m + up,
            mean,
            self._window[-1].position,
            left_s,
        )

    @property
    def in_turn(self) -> bool:
        """Whether positions of two places come in turn, again and again."""
        return sum(self._turns) >= REMEMBERED_EPOCHS // 3

    @property
    def told_baseline_m(self) -> float | None:
        """How far away the receiver says that the base is of its corrections; None where it does not, or not lately."""
        if self._told_baseline is None or self._t_s - self._told_baseline[0] > BASELINE_LASTS_S:
            return None
        return self._told_baseline[1]

    def _mean(self) -> StaticMean:
        return average(
            np.array([accepted.t_s for accepted in self._window]),
            np.array([accepted.offset_m for accepted in self._window]),
            np.array([accepted.segment for accepted in self._window]),
            self._service,
            step_m=self._window[0].position.step_m,
            baseline_m=max(self.set_baseline_m, self.told_baseline_m or 0.0),
        )

    def _add(self, frame: Packet, t_s: float) -> list[Epoch]:
        try:
            part = self._decoders[frame.kind].decode(frame.body)
        except MalformedError as error:
            self.counts["malformed"] += 1
            self.last_malformed = str(error)
            return []
        self.last_message_s = t_s
        if part is not None and part.baseline_m is not None:
            self._told_baseline = (t_s, part.baseline_m)
            return []
        return self._assembler.add(part, t_s) if part is not None else []

    def _take(self, epoch: Epoch, t_s: float) -> list[Position]:
        if not epoch.solutions:
            return []  # a date or a sigma by itself is no epoch
        self.counts["epochs"] += 1
        self.latest = epoch
        judged = judge(epoch, self._policy)
        if isinstance(judged, Refusal):
            if judged.reason is Reason.QUALITY:
                self._gate.interrupt()
            self._refuse(judged)
            return []
        self._newest.append(judged)
        self._turns.append(len(self._newest) == 3 and _back_again(*self._newest))
        verdict = self._gate.judge(judged)
        self._way.add(judged)
        if verdict.refusal:
            self._provisional.append(verdict.refusal.reason)
            self._refuse(verdict.refusal)
            return []
        return self._accept(verdict.accepted, verdict.segment, t_s)

    def _refuse(self, refusal: Refusal) -> None:
        if refusal.reason in SPEAKS_AGAINST:
            self.against = str(refusal)
            self.jumps = self.jumps + 1 if refusal.reason is Reason.JUMP else 0
        self.refusals[refusal.reason] += 1
        self.last_refusal = refusal

    def _accept(self, positions: tuple[Position, ...], segment: int, t_s: float) -> list[Position]:
        # Those that had only been waiting were counted as refused.
        for _ in positions[1:]:
            self.refusals[self._provisional.pop()] -= 1
        self._provisional.clear()
        self.counts["accepted"] += len(positions)
        self.against, self.jumps = "", 0
        silence_s = t_s - self.last_accepted_s if self.last_accepted_s is not None else 0.0
        self.last_accepted_s = t_s
        carried_m = self._way.carried_m(positions[0]) if segment != self._segment else 0.0
        for position in positions:
            self._append(position, segment, silence_s if segment != self._segment else 0.0)
            self._segment = segment
        if carried_m:
            self._carried(carried_m, len(positions))
        self._way.begin(positions[-1])
        return list(positions)

    def _carried(self, distance_m: float, arrived: int) -> None:
        """The antenna was seen on its way: only what came since it arrived is of this place."""
        self.moves += 1
        self.carries += 1
        while len(self._window) > arrived:
            self._window.popleft()
        self._moved_until_s, self._moved = self._now_s, f"it was carried {distance_m:.1f} m"

    def _append(self, position: Position, segment: int, silence_s: float) -> None:
        """silence_s: how long nothing was accepted, by our own clock; the receiver's may have been set meanwhile."""
        if not self._window:
            self._origin = position
        else:
            step_s = elapsed_ms(position.t_day_ms, self._window[-1].position.t_day_ms) / 1000
            self._now_s += max(step_s, silence_s)
        self._window.append(_Accepted(self._now_s, segment, position, offset_m(position, self._origin)))
        while self._window[0].t_s < self._now_s - STATIC_WINDOW_S:
            self._window.popleft()


def _back_again(first: Position, between: Position, last: Position) -> bool:
    """Whether a position is where the last but one was, and the one between was elsewhere."""
    there = math.hypot(*offset_m(last, first)) < MAX_STEP_H_M
    return there and math.hypot(*offset_m(between, first)) > 2 * MAX_STEP_H_M


def t_unix_ns(position: Position, host_unix_ns: int) -> int:
    """UTC of a position: its own date if it has one, else the day that brings it nearest to the host's clock."""
    since_midnight_ns = position.t_day_ms * NS_PER_MS
    if position.date is not None:
        return (position.date - dt.date(1970, 1, 1)).days * NS_PER_DAY + since_midnight_ns
    day = round((host_unix_ns - since_midnight_ns) / NS_PER_DAY)
    return day * NS_PER_DAY + since_midnight_ns

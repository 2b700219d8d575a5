"""Parts -> epochs: everything a receiver reported about one instant, joined by the time each part carries.

The hazard is arrival order. A sigma sent after the next position belongs to the previous one, and a receiver that talks
NMEA and UBX at once sends the same instant twice. So parts are joined by their own time, two epochs may be open at
once, and an epoch closes when a third begins or when the receiver has been silent for 200 ms.

Nothing here knows a protocol: a decoder says in Parts what its messages mean, and the gates ask an Epoch.
"""

import datetime as dt
from dataclasses import dataclass, field
from typing import Final

MS_PER_DAY: Final = 86_400_000
RTK_FIXED: Final = 4  # of the qualities as NMEA's GGA numbers them, which every decoder translates to
SILENCE_S: Final = 0.2  # no receiver pauses this long inside an epoch at 9600 baud or more
OPEN_EPOCHS: Final = 2  # one being filled, one whose last message may still come


@dataclass(frozen=True)
class Place:
    """A position as it was sent. height_m: above the ellipsoid; above the geoid where `above_geoid`.

    separation_m: of the geoid from the ellipsoid, as far as height_m holds it; None where the message has none.
    step_m: its resolution, horizontal and vertical. resolution: the same as an operator sees it in the message.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    step_m: tuple[float, float]
    resolution: str
    above_geoid: bool = False
    separation_m: float | None = None


@dataclass(frozen=True)
class Part:
    """What one message says about one instant; what it does not say is None or empty.

    source: the message's name. t_day_ms: its instant, after midnight UTC; a message that has GPS time only belongs to
    the part of the same tow_ms (time of week), one without any time to the newest instant. quality: as GGA numbers it.
    satellites: used. age_s: of the corrections. date, and date_rank, how far it is to be trusted beside others.
    sigma_m: one sigma each of whichever directions, the receiver's own. pdop: position dilution of precision.
    contradiction: why this is no fixed solution whatever the quality. baseline_m: to the base of the corrections.
    """

    source: str
    t_day_ms: int | None = None
    tow_ms: int | None = None
    quality: int | None = None
    satellites: int | None = None
    age_s: float | None = None
    place: Place | None = None
    date: dt.date | None = None
    date_rank: int = 0
    sigma_m: tuple[float, ...] = ()
    pdop: float | None = None
    contradiction: str = ""
    baseline_m: float | None = None


@dataclass
class Epoch:
    """All that was reported about one instant, t_day_ms milliseconds after midnight UTC. parts: by their source.

    rivals: pairs of places that one source gave of this one instant.
    """

    t_day_ms: int
    parts: dict[str, Part] = field(default_factory=dict)
    pdops: list[float] = field(default_factory=list)
    rivals: list[tuple[Place, Place]] = field(default_factory=list)

    @property
    def date(self) -> dt.date | None:
        """The date, from the part that knows it best."""
        dated = [part for part in self.parts.values() if part.date is not None]
        return max(dated, key=lambda part: part.date_rank).date if dated else None

    @property
    def solutions(self) -> list[Part]:
        """The parts that say what kind of solution this is. Without any, it is no epoch but a date or a sigma."""
        return [part for part in self.parts.values() if part.quality is not None]

    @property
    def fixed(self) -> bool:
        """Whether all that say it say that this is a fixed solution."""
        return bool(self.solutions) and all(part.quality == RTK_FIXED for part in self.solutions)

    def add(self, part: Part) -> None:
        """Put a part in its place."""
        earlier = self.parts.get(part.source)
        if earlier is not None and earlier.place and part.place:
            self.rivals.append((earlier.place, part.place))
        # Two talkers may disagree about one instant; the worse of them counts.
        if earlier is None or earlier.quality in (None, RTK_FIXED) or part.quality != RTK_FIXED:
            self.parts[part.source] = part


class EpochAssembler:
    """Joins parts; hands out each epoch once, complete, in the order in which they began."""

    def __init__(self) -> None:
        self._open: dict[int, Epoch] = {}
        self._unclaimed: Part | None = None
        self._last_s = float("-inf")

    def add(self, part: Part, t_s: float) -> list[Epoch]:
        """The epochs that are complete now that `part` has come at monotonic t_s."""
        self._last_s = t_s
        if part.t_day_ms is None:
            self._add_without_utc(part)
            return []
        # Some messages give hundredths, others thousandths of a second of the same instant.
        self._open.setdefault(round(part.t_day_ms / 10), Epoch(part.t_day_ms)).add(part)
        self._claim()
        return [self._close_oldest()] if len(self._open) > OPEN_EPOCHS else []

    def idle(self, t_s: float) -> list[Epoch]:
        """The epochs that are complete because nothing has come for SILENCE_S."""
        return self.flush() if self._open and t_s - self._last_s >= SILENCE_S else []

    def flush(self) -> list[Epoch]:
        """Close everything: the stream has ended."""
        return [self._close_oldest() for _ in range(len(self._open))]

    def _close_oldest(self) -> Epoch:
        return self._open.pop(next(iter(self._open)))

    def _add_without_utc(self, part: Part) -> None:
        if part.tow_ms is not None:
            self._unclaimed = part
            self._claim()
        elif self._open and part.pdop is not None:
            next(reversed(self._open.values())).pdops.append(part.pdop)

    def _claim(self) -> None:
        """A part that has GPS time only goes to the epoch with a part of the same time of week."""
        for epoch in self._open.values():
            waiting = self._unclaimed
            if waiting and any(part.tow_ms == waiting.tow_ms for part in epoch.parts.values()):
                epoch.add(waiting)
                self._unclaimed = None

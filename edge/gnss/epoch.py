"""Records -> epochs: everything a receiver said about one instant, joined by the time field each record carries.

The hazard is arrival order. A sigma sent after the next position belongs to the previous one, and a receiver that talks
NMEA and UBX at once sends the same instant twice. So records are joined by their own time, two epochs may be open at
once, and an epoch closes when a third begins or when the receiver has been silent for 200 ms.
"""

import datetime as dt
from dataclasses import dataclass, field
from typing import Final

from edge.gnss.nmea import Gga, Gsa, Gst, Record, Rmc, Zda
from edge.gnss.ubx import HighPrecision, Pvt

SILENCE_S: Final = 0.2  # no receiver pauses this long inside an epoch at 9600 baud or more
OPEN_EPOCHS: Final = 2  # one being filled, one whose last sentence may still come


@dataclass
class Epoch:
    """All that was said about one instant, t_day_ms milliseconds after midnight UTC."""

    t_day_ms: int
    gga: Gga | None = None
    gst: Gst | None = None
    rmc: Rmc | None = None
    zda: Zda | None = None
    pvt: Pvt | None = None
    high_precision: HighPrecision | None = None
    pdops: list[float] = field(default_factory=list)

    @property
    def date(self) -> dt.date | None:
        """The date, from whichever record has one."""
        if self.pvt and self.pvt.time_resolved:
            return self.pvt.date
        if self.zda:
            return self.zda.date
        return self.rmc.date if self.rmc else None

    def add(self, record: Gga | Gst | Rmc | Zda | Pvt) -> None:
        """Put a record in its place."""
        match record:
            case Gga():
                # Two talkers may disagree about one instant; the worse of them counts.
                if self.gga is None or record.quality != 4:
                    self.gga = record
            case Gst():
                self.gst = record
            case Rmc():
                self.rmc = record
            case Zda():
                self.zda = record
            case Pvt():
                self.pvt = record


class EpochAssembler:
    """Joins records; hands out each epoch once, complete, in the order in which they began."""

    def __init__(self) -> None:
        self._open: dict[int, Epoch] = {}
        self._unclaimed: HighPrecision | None = None
        self._last_s = float("-inf")

    def add(self, record: Record | Pvt | HighPrecision, t_s: float) -> list[Epoch]:
        """The epochs that are complete now that `record` has come at monotonic t_s."""
        self._last_s = t_s
        if isinstance(record, Gsa):
            self._add_dop(record)
            return []
        if isinstance(record, HighPrecision):
            self._unclaimed = record
            self._claim()
            return []
        # Some sentences give hundredths, others thousandths of a second of the same instant.
        self._open.setdefault(round(record.t_day_ms / 10), Epoch(record.t_day_ms)).add(record)
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

    def _add_dop(self, record: Gsa) -> None:
        if self._open and record.pdop is not None:
            next(reversed(self._open.values())).pdops.append(record.pdop)

    def _claim(self) -> None:
        """NAV-HPPOSLLH has GPS time only: it belongs to the NAV-PVT of the same time of week."""
        for epoch in self._open.values():
            if self._unclaimed and epoch.pvt and epoch.pvt.itow_ms == self._unclaimed.itow_ms:
                epoch.high_precision, self._unclaimed = self._unclaimed, None

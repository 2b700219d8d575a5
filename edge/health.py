"""What is wrong, since when, and what to do about it. Pure: the caller brings the observations and the time.

Silent failure is what hurts in the field: a camera dead behind a frozen picture, a clock nobody disciplines. But an
alarm that flickers is soon ignored too. So a fault is raised at once, is only lowered after it has stayed away for a
while, and keeps the instant at which it began; the level of the whole is that of its worst item.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from edge import __version__
from edge.common.health import SEVERITY, Check, worst
from edge.messages import Health, HealthItem

CLEAR_AFTER_NS: Final = 3_000_000_000  # a better level must last so long before it is shown: longer than a flicker


@dataclass(frozen=True)
class _Held:
    """The level shown for one thing, since when, and since when the observations have been better than it."""

    check: Check
    since_ns: int
    better_since_ns: int | None = None


class HealthBoard:
    """Turns observations into a Health message, with memory. Names not observed in a call are dropped."""

    def __init__(self, epoch: int) -> None:
        self._epoch = epoch
        self._held: dict[str, _Held] = {}

    def update(
        self, now_unix_ns: int, checks: Iterable[Check], counters: Mapping[str, float], *, now_ns: int | None = None
    ) -> Health:
        """The health as of `now_unix_ns`. Worse levels show at once, better ones after they have lasted.

        now_ns: by a clock that never steps; None where UTC is one. A box that starts in 1970 and is then told the time
        would else say for good that its faults are fifty years old.
        """
        now = now_unix_ns if now_ns is None else now_ns
        self._held = {check.name: self._next(self._held.get(check.name), check, now) for check in checks}
        items = [_item(held, now_unix_ns - now) for held in self._held.values()]
        level = worst(item.level for item in items)
        return Health(
            t_unix_ns=now_unix_ns,
            epoch=self._epoch,
            level=level,
            items=items,
            counters=dict(sorted(counters.items())),
            version=__version__,
        )

    def _next(self, held: _Held | None, check: Check, now: int) -> _Held:
        if held is None or SEVERITY[check.level] > SEVERITY[held.check.level]:
            return _Held(check, now)
        if check.level == held.check.level:
            return _Held(check, held.since_ns)
        better_since = now if held.better_since_ns is None else held.better_since_ns
        if now - better_since >= CLEAR_AFTER_NS:
            return _Held(check, better_since)
        return replace(held, better_since_ns=better_since)


def _item(held: _Held, to_unix_ns: int) -> HealthItem:
    check = held.check
    return HealthItem(
        name=check.name,
        level=check.level,
        since_unix_ns=max(0, held.since_ns + to_unix_ns),
        reason=check.reason,
        action=check.action,
    )

"""What one message, one output or one turn raises ends that alone: counted, named once, and the loop goes on.

The hazard is a fault in one place that silences all others: a number nobody thought of in one camera's message ends the
station, systemd starts it again, and the next such message ends it again.
"""

import logging
from types import TracebackType
from typing import Final

from edge.common.health import Check, HealthLevel

log = logging.getLogger(__name__)

SPOKEN_OF_NS: Final = 60 * 10**9  # how long a fault is spoken of


class Fence:
    """Keeps what is raised inside it. One object, entered anew for each call: nothing is made for a frame."""

    def __init__(self, name: str, level: HealthLevel, action: str) -> None:
        """name: of what is in it, as health shows it. action: what to do about what it raises."""
        self.name = name
        self.count = 0
        self._level, self._action = level, action
        self._last = ""
        self._seen, self._seen_ns = 0, -SPOKEN_OF_NS

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        self.count += 1
        if repr(error) != self._last:  # the same again, at every frame, would fill the log
            log.error("%s: %r", self.name, error, exc_info=error)
        self._last = repr(error)
        return True

    def checks(self, now_ns: int) -> list[Check]:
        """That something was raised lately; nothing if it was not."""
        if self.count > self._seen:
            self._seen, self._seen_ns = self.count, now_ns
        if now_ns - self._seen_ns >= SPOKEN_OF_NS:
            return []
        return [Check(self.name, self._level, f"{self.count} failed, the last with {self._last}", self._action)]

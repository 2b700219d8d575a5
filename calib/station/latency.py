"""How long targets take on their way through the station, looked back on over the last few thousand messages."""

from collections import deque
from typing import Final

import numpy as np

LOOKED_BACK: Final = 2000  # messages: twenty seconds of a hundred a second


class Latencies:
    """Milliseconds from a message's arrival, and from its frame's exposure, until its targets were sent."""

    def __init__(self) -> None:
        self._arrivals_ms: deque[float] = deque(maxlen=LOOKED_BACK)
        self._exposures_ms: deque[float] = deque(maxlen=LOOKED_BACK)

    def note(self, arrived_ns: int, exposed_unix_ns: int, sent_ns: int) -> None:
        """One message whose targets were sent."""
        self._arrivals_ms.append((sent_ns - arrived_ns) * 1e-6)
        self._exposures_ms.append((sent_ns - exposed_unix_ns) * 1e-6)

    @property
    def arrival_ms(self) -> tuple[float, float] | None:
        """Median and 99th percentile from arrival to sent; None before the first."""
        if not self._arrivals_ms:
            return None
        median, late = np.percentile(np.fromiter(self._arrivals_ms, float), (50, 99))
        return float(median), float(late)

    @property
    def exposure_ms(self) -> float | None:
        """95th percentile from exposure to sent; None before the first."""
        return float(np.percentile(np.fromiter(self._exposures_ms, float), 95)) if self._exposures_ms else None

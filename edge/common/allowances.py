"""What each of several may send or ask, so that a flood of one costs the others nothing. Pure: time is handed in."""

from typing import Final

MAX_KEYS: Final = 4096  # remembered; all are forgotten when there are more, which only a flood of keys does


class Allowances:
    """A token bucket for each key."""

    def __init__(self, rate_hz: float, burst: float, max_keys: int = MAX_KEYS) -> None:
        """rate_hz: tokens a second; burst: tokens at once."""
        self._rate_hz = rate_hz
        self._burst = burst
        self._max_keys = max_keys
        self._left: dict[str, tuple[float, float]] = {}  # key: tokens that are left, and when that was so

    def take(self, key: str, now_s: float, tokens: float = 1.0) -> bool:
        """Whether this key may have so many tokens now; if not, it keeps what it has."""
        left, since_s = self._left.get(key, (self._burst, now_s))
        left = min(self._burst, left + max(now_s - since_s, 0.0) * self._rate_hz)
        if len(self._left) >= self._max_keys and key not in self._left:
            self._left.clear()
        self._left[key] = (left - tokens if left >= tokens else left, now_s)
        return left >= tokens

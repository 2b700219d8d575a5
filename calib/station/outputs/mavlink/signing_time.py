"""The time that frames are signed with: the clock's, but not at once whatever the clock says. Pure: times handed in.

The hazards come from one witness. A clock that is ten years ahead for four seconds would date all frames to come ten
years ahead, over every restart; so a leap is followed only once it has lasted, by a second clock that never leaps. A
clock that was never set would sign with times that lock this station out later; so nothing is signed before. And what
an earlier run left may itself be of such a moment; so where a disciplined clock has long said otherwise, the time goes
back to it, and that is told: who heard the frames of the future refuses others until it is started again.
"""

from dataclasses import dataclass
from typing import Final

CLOCK_SET_S: Final = 1_600_000_000  # 2020: an earlier clock was never set
LEAP_S: Final = 30.0  # of the clock against the one that never leaps: half of what receivers allow a new stream
LEAP_LASTS_S: Final = 60.0  # before a leap is followed
SIGNED_AHEAD_S: Final = 86_400.0  # of the clock: more than any clock that was let go by itself


@dataclass(frozen=True)
class SignedAt:
    """UTC by which others' frames are judged, and with which ours are signed, both s of UNIX time."""

    clock_unix_s: float
    signed_unix_s: float


class SigningTime:
    """Call `at` about once a second. taken_back: how often it went back to a clock that had long said otherwise."""

    def __init__(self, stored_unix_s: float) -> None:
        """stored_unix_s: with which an earlier run may have signed."""
        self._signed_s = stored_unix_s
        self._clock: tuple[float, float] | None = None  # as followed, and by the clock that never leaps
        self._leapt_s: float | None = None
        self._steady_s = 0.0  # since when a disciplined clock has not leapt
        self.taken_back = 0

    def at(self, unix_s: float, monotonic_s: float, *, disciplined: bool) -> SignedAt | None:
        """The times as of now; None while the clock is not set. disciplined: whether a time daemon holds the clock."""
        clock_s = self._followed(unix_s, monotonic_s)
        if clock_s < CLOCK_SET_S:
            self._clock = None
            return None
        if self._clock is None or not disciplined or self._leapt_s is not None:
            self._steady_s = monotonic_s
        self._clock = clock_s, monotonic_s
        if self._signed_s > clock_s + SIGNED_AHEAD_S and monotonic_s - self._steady_s >= LEAP_LASTS_S:
            self._signed_s = clock_s
            self.taken_back += 1
        self._signed_s = max(self._signed_s, clock_s)
        return SignedAt(clock_s, self._signed_s)

    def _followed(self, unix_s: float, monotonic_s: float) -> float:
        """The clock, or where it has just leapt, as it went on before."""
        if self._clock is None:
            return unix_s
        before_s, then_s = self._clock
        expected_s = before_s + monotonic_s - then_s
        if abs(unix_s - expected_s) <= LEAP_S:
            self._leapt_s = None
            return unix_s
        self._leapt_s = monotonic_s if self._leapt_s is None else self._leapt_s
        if monotonic_s - self._leapt_s < LEAP_LASTS_S:
            return expected_s
        self._leapt_s = None
        return unix_s

"""Units: how many of one make another."""

from typing import Final

NS: Final = 10**9  # nanoseconds in a second

"""What a unit is of another."""

from typing import Final

NS: Final = 10**9  # nanoseconds in a second

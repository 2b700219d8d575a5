"""Where false tracks keep appearing: a coarse map that learns and forgets.

A lit window or a branch is detected again and again in one place. What was followed for seconds and never went
anywhere is entered here; a track born in such a place must then go further before it is confirmed.
"""

from typing import Final

import numpy as np

CLUTTER_CELL_PX: Final = 16  # px: about the sway of a branch
FORGET_S: Final = 120.0  # s: clouds pass, lights go out
FULL: Final = 3.0  # entries that make a place wholly cluttered


class ClutterMap:
    """A grid over an image of size_px (width, height)."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        # A border of one cell, so that every neighbourhood is whole.
        self._cells = np.zeros((size_px[1] // CLUTTER_CELL_PX + 3, size_px[0] // CLUTTER_CELL_PX + 3))
        self._t_unix_ns: int | None = None

    def add(self, u_px: float, v_px: float, t_unix_ns: int) -> None:
        """Enter a place where something was followed that is no object."""
        self._forget(t_unix_ns)
        row, column = self._cell(u_px, v_px)
        self._cells[row - 1 : row + 2, column - 1 : column + 2] += 0.5
        self._cells[row, column] += 0.5

    def level(self, u_px: float, v_px: float) -> float:
        """How cluttered a place is, from 0 to 1."""
        row, column = self._cell(u_px, v_px)
        return float(min(1.0, self._cells[row, column] / FULL))

    def _cell(self, u_px: float, v_px: float) -> tuple[int, int]:
        rows, columns = self._cells.shape
        row = min(max(int(v_px // CLUTTER_CELL_PX) + 1, 1), rows - 2)
        return row, min(max(int(u_px // CLUTTER_CELL_PX) + 1, 1), columns - 2)

    def _forget(self, t_unix_ns: int) -> None:
        if self._t_unix_ns is not None:
            self._cells *= np.exp(-max(0.0, (t_unix_ns - self._t_unix_ns) / 1e9) / FORGET_S)
        self._t_unix_ns = t_unix_ns

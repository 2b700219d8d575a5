"""Finding the corners of a calibration board in a picture.

A chessboard must be seen whole; a ChArUco board, whose corners are numbered, may reach out of the picture, and so can
fill its corners, where a lens is worst. Pictures without a board are told apart from those of another size: both are
named in the report, because a picture silently left out is how a bad calibration looks good.
"""

from dataclasses import dataclass
from typing import Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image
from edge.common.arrays import Array
from edge.common.errors import ConfigError

# A second a picture. Cheaper searches were measured to find boards with a corner misplaced, which a lens fit follows.
BOARD_SEARCH: Final = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
ANY_SIZE: Final = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
FEWEST_CORNERS: Final = 12  # of a ChArUco board: six for its pose, six to say something about the lens
CHARUCO_MARKER_SHARE: Final = 0.75  # side of a marker per side of a square, as the board's drawing has it
CHARUCO_DICTIONARY: Final = cv2.aruco.DICT_5X5_1000


@dataclass(frozen=True)
class BoardView:
    """One picture's corners: board_mm `(N, 3)` on the board, image_px `(N, 2)` in the picture."""

    name: str
    board_mm: Array
    image_px: Array


class Board(Protocol):
    """A flat pattern whose corners are known."""

    def find(self, name: str, image: Image) -> BoardView | None:
        """The corners in a grey picture; None if the board is not found."""

    def other_size(self, image: Image) -> str:
        """COLSxROWS of another board than this one that a grey picture shows; empty if none is seen."""


@dataclass(frozen=True)
class Chessboard:
    """A plain chessboard of columns x rows inner corners."""

    columns: int
    rows: int
    square_mm: float

    def find(self, name: str, image: Image) -> BoardView | None:
        """The corners to about 0.05 px; None if the whole board is not found."""
        found, corners = cv2.findChessboardCornersSB(image, (self.columns, self.rows), flags=BOARD_SEARCH)
        if not found:
            return None
        across, down = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        board: Array = np.stack([across.ravel(), down.ravel(), np.zeros(across.size)], axis=1).astype(np.float64)
        return BoardView(name, board * self.square_mm, np.asarray(corners, dtype=np.float64).reshape(-1, 2))

    def other_size(self, image: Image) -> str:
        """As Board says: what there is, of any size, is found in a tenth of a second."""
        found, _, squares = cv2.findChessboardCornersSBWithMeta(image, (3, 3), ANY_SIZE)
        if not found or sorted(squares.shape) == sorted((self.columns, self.rows)):
            return ""
        return f"{max(squares.shape)}x{min(squares.shape)}"


class Charuco:
    """A ChArUco board of columns x rows inner corners, markers of the 5 x 5 dictionary at 3/4 of a square."""

    def __init__(self, columns: int, rows: int, square_mm: float) -> None:
        dictionary = cv2.aruco.getPredefinedDictionary(CHARUCO_DICTIONARY)
        marker_mm = square_mm * CHARUCO_MARKER_SHARE
        self.board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), square_mm, marker_mm, dictionary)
        self._detector = cv2.aruco.CharucoDetector(self.board)

    def find(self, name: str, image: Image) -> BoardView | None:
        """The corners that are seen; None if they are too few."""
        corners, numbers, _, _ = self._detector.detectBoard(image)
        if numbers is None or len(numbers) < FEWEST_CORNERS:
            return None
        chosen: NDArray[np.intp] = np.asarray(numbers, dtype=np.intp).ravel()
        board = np.asarray(self.board.getChessboardCorners(), dtype=np.float64)[chosen]
        return BoardView(name, board, np.asarray(corners, dtype=np.float64).reshape(-1, 2))

    def other_size(self, image: Image) -> str:
        """Nothing: its markers are numbered, and those of another board are others."""
        return ""


def parse_board(text: str, kind: str, square_mm: float) -> Board:
    """A board from "COLSxROWS" inner corners. Raises ConfigError."""
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise ConfigError(
            f"board {text!r} is no size", where="--board", action="give COLSxROWS, such as 9x6"
        ) from error
    if min(columns, rows) < 3 or square_mm <= 0:
        action = "count the inner corners: where four squares meet"
        raise ConfigError(f"a board of {columns} x {rows} corners is too small", where="--board", action=action)
    return Charuco(columns, rows, square_mm) if kind == "charuco" else Chessboard(columns, rows, square_mm)

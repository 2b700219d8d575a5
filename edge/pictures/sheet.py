"""A sheet of pictures of what was seen in a recording: all tracks over one frame, and each object from near.

A table of pixels says nothing about what was followed; a look at forty small pictures does: leaves, a gull, the drone.
Where and how a track ran stands beside it, with its number in the table.
"""

from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge.capture.frame import Image, Picture
from edge.capture.grey import as_wanted
from edge.detector.mask import Mask, shaded
from edge.messages import Detection, Tracks

SHEET_WIDTH_PX: Final = 1200
SHEET_QUALITY: Final = 85  # of 100, JPEG
TILE_PX: Final = 150  # side of one object's picture
TILE_TEXT_PX: Final = 34  # below it
LEAST_CUT_PX: Final = 48  # of the frame, shown in a tile: what is smaller needs its surroundings
CUT_TIMES: Final = 4.0  # times an object's longer side
SHOWN_TRACKS: Final = 40  # the longest
KEPT_PICTURES: Final = 1000  # of tracks, while a recording runs: 20 MB
PATH_ROWS: Final = 2000  # of a track, drawn
INK_BGR: Final = (40, 40, 40)
PATH_BGR: Final = ((60, 60, 230), (60, 170, 60), (230, 120, 40), (30, 170, 230), (190, 60, 190), (160, 140, 20))


@dataclass
class _Seen:
    """One track so far: rows, when, its best score and the picture of that look."""

    first_unix_ns: int
    last_unix_ns: int
    rows: int = 0
    score: float = -1.0
    picture: Image | None = None
    path_px: list[tuple[float, float]] = field(default_factory=list)


class Sheet:
    """Gathers what a recording's Tracks show, and draws it."""

    def __init__(self, mask: Mask | None = None) -> None:
        self._mask = mask
        self._tracks: dict[int, _Seen] = {}
        self._frame: Image | None = None
        self._begin_unix_ns: int | None = None

    @property
    def tracks(self) -> int:
        """How many there were."""
        return len(self._tracks)

    def add(self, message: Tracks, frame: Picture) -> None:
        """One more message, and the newest frame: the message's own, or a later one."""
        if self._begin_unix_ns is None:
            self._begin_unix_ns = message.t_unix_ns
        self._frame = frame.image
        for one in message.detections:
            seen = self._tracks.setdefault(one.track, _Seen(message.t_unix_ns, message.t_unix_ns))
            seen.rows += 1
            seen.first_unix_ns = min(seen.first_unix_ns, message.t_unix_ns)
            seen.last_unix_ns = max(seen.last_unix_ns, message.t_unix_ns)
            if len(seen.path_px) < PATH_ROWS:
                seen.path_px.append((one.u_px, one.v_px))
            kept = seen.picture is not None or len(self._tracks) <= KEPT_PICTURES
            if kept and message.t_unix_ns == frame.t_unix_ns and one.score > seen.score:
                seen.score, seen.picture = one.score, near(frame.image, one)

    def draw(self, title: str) -> bytes:
        """The sheet as a JPEG."""
        longest = sorted(self._tracks.items(), key=lambda pair: (-pair[1].rows, pair[0]))[:SHOWN_TRACKS]
        parts = [_line(title), self._overview([number for number, _ in longest])]
        across = SHEET_WIDTH_PX // TILE_PX
        tiles = [self._tile(number, seen) for number, seen in longest]
        for k in range(0, len(tiles), across):
            row = np.concatenate(tiles[k : k + across], axis=1)
            parts.append(cv2.copyMakeBorder(row, 0, 0, 0, SHEET_WIDTH_PX - row.shape[1], *_WHITE))
        if self.tracks > SHOWN_TRACKS:
            parts.append(_line(f"and {self.tracks - SHOWN_TRACKS} shorter tracks"))
        _, encoded = cv2.imencode(".jpg", np.concatenate(parts), [cv2.IMWRITE_JPEG_QUALITY, SHEET_QUALITY])
        return bytes(encoded)

    def _overview(self, numbers: list[int]) -> Image:
        frame = np.zeros((1, SHEET_WIDTH_PX), np.uint8) if self._frame is None else self._frame
        scale = SHEET_WIDTH_PX / frame.shape[1]
        size = (SHEET_WIDTH_PX, max(1, round(frame.shape[0] * scale)))
        resized: Image = cv2.resize(frame, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        picture = as_wanted(resized, colour=True)
        if self._mask is not None:
            picture = shaded(picture, self._mask)
        for number in numbers:
            places = np.round((np.array(self._tracks[number].path_px) + 0.5) * scale).astype(np.int32)
            cv2.polylines(picture, [places.reshape(-1, 1, 2)], isClosed=False, color=_colour(number), thickness=2)
            at = (int(places[-1, 0]) + 4, int(places[-1, 1]) - 4)
            cv2.putText(picture, str(number), at, _FONT, 0.5, _colour(number), 1, cv2.LINE_AA)
        return picture

    def _tile(self, number: int, seen: _Seen) -> Image:
        picture = np.full((TILE_PX, TILE_PX, 3), 230, np.uint8) if seen.picture is None else seen.picture
        tile: Image = cv2.copyMakeBorder(picture, 0, TILE_TEXT_PX, 0, 0, *_WHITE)
        cv2.rectangle(tile, (0, 0), (TILE_PX - 1, TILE_PX - 1), _colour(number), 2)
        begin_s, end_s = ((t - (self._begin_unix_ns or 0)) / 1e9 for t in (seen.first_unix_ns, seen.last_unix_ns))
        lines = (f"{number}: {seen.rows} rows, {max(seen.score, 0):.2f}", f"{begin_s:.1f} to {end_s:.1f} s")
        for k, text in enumerate(lines):
            cv2.putText(tile, text, (3, TILE_PX + 14 + 15 * k), _FONT, 0.42, INK_BGR, 1, cv2.LINE_AA)
        return tile


_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_WHITE: Final = (cv2.BORDER_CONSTANT, None, (255, 255, 255))


def near(image: Image, one: Detection) -> Image:
    """The object and what is around it, enlarged to a tile."""
    half = max(LEAST_CUT_PX, CUT_TIMES * max(one.width_px, one.height_px)) / 2
    height, width = image.shape[:2]
    left, top = max(0, round(one.u_px - half)), max(0, round(one.v_px - half))
    piece = image[top : min(height, round(one.v_px + half)), left : min(width, round(one.u_px + half))]
    tile: NDArray[np.uint8] = np.full((TILE_PX, TILE_PX, 3), 230, np.uint8)
    if piece.size:
        scale = TILE_PX / max(piece.shape[:2])
        size = (max(1, round(piece.shape[1] * scale)), max(1, round(piece.shape[0] * scale)))
        resized: Image = cv2.resize(piece, size, interpolation=cv2.INTER_NEAREST if scale > 1 else cv2.INTER_AREA)
        shown = as_wanted(resized, colour=True)
        tile[: shown.shape[0], : shown.shape[1]] = shown
    return tile


def _colour(number: int) -> tuple[int, int, int]:
    return PATH_BGR[number % len(PATH_BGR)]


def _line(text: str) -> Image:
    line = np.full((26, SHEET_WIDTH_PX, 3), 255, np.uint8)
    cv2.putText(line, text, (6, 18), _FONT, 0.5, INK_BGR, 1, cv2.LINE_AA)
    return line

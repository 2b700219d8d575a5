"""A recording's packets, a second witness of its pictures: whether they change their size in the midst of the file.

The hazard is the decoder that makes everything fit. OpenCV takes a file's size at its beginning; what a camera recorded
after it had started anew in another mode is stretched to that size, and nothing says so. The packets know: each key
frame brings the parameters of what follows. They are read beside the decoder, undecoded, which costs microseconds, and
where they change, the key frame is opened as a file of its own. Damaged parameters look like others; they pass.
"""

import re
import tempfile
from collections import deque
from typing import Any, Final

import cv2

from edge.capture.decoding import first_picture
from edge.common.errors import SourceError

RAW_PACKETS: Final = -1  # CAP_PROP_FORMAT that hands out packets
AHEAD_PACKETS: Final = 64  # by which packets may run before their pictures: no codec reorders more
JPEG_BEGIN: Final = b"\xff\xd8"
JPEG_SIZES: Final = frozenset({0xC0, 0xC1, 0xC2})  # markers of the segments that say a picture's size
SEQUENCE_HEADER: Final = b"\x00\x00\x01\xb3"  # of MPEG video; the size is in the three bytes after it
MPEG4_PICTURE: Final = b"\x00\x00\x01\xb6"  # of MPEG-4 part 2, where that header is a time
# Key frames of one file that are opened by themselves: parameters that change all the time say nothing.
MOST_TRIALS: Final = 8
# A parameter set up to the next unit, of H.264 (type 7) and of HEVC (type 33, layer 0).
H264_SET: Final = re.compile(rb"\x00\x00\x01([\x07\x27\x47\x67].+?)(?=\x00\x00\x01|\x00\x00\x00|$)", re.DOTALL)
HEVC_SET: Final = re.compile(rb"\x00\x00\x01(\x42\x01.+?)(?=\x00\x00\x01|\x00\x00\x00|$)", re.DOTALL)
UNDECODED: Final = (0, 0)
HEAD_BYTES: Final = 4096  # of a packet in which its parameter sets are

SizePx = tuple[int, int]


class PacketWitness:
    """Reads a file's packets beside its decoder. Says nothing of codecs that it knows no parameters of."""

    def __init__(self, path: str) -> None:
        self._capture: Any = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, RAW_PACKETS])
        self._suffix = ""
        self._first = b""
        self._verdicts: dict[bytes, str] = {}  # parameters: why pictures of them are not to be used, or empty
        self._verdict = ""
        self._ahead: deque[tuple[float, str]] = deque(maxlen=AHEAD_PACKETS)
        self._lost = not self._capture.isOpened()

    def why_not(self, pts: float) -> str:
        """What is wrong with a picture that the decoder has come to; empty if nothing. pts: its presentation time."""
        for _ in range(AHEAD_PACKETS):
            if self._lost:
                return ""
            if (verdict := self._taken(pts)) is not None:
                return verdict
            self._lost = not self._advance()
        self._lost = True  # its packets have other times than its pictures
        return ""

    def _taken(self, pts: float) -> str | None:
        """The verdict on the newest packet of a time; None if there is no such packet yet."""
        for place in range(len(self._ahead) - 1, -1, -1):
            if self._ahead[place][0] == pts:
                verdict = self._ahead[place][1]
                del self._ahead[place]
                return verdict
        return None

    def _advance(self) -> bool:
        """One more packet; False at the end, and for a codec whose parameters are not known."""
        if not self._capture.grab():
            return False
        if self._capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME):
            self._look_at_key()
        self._ahead.append((self._capture.get(cv2.CAP_PROP_PTS), self._verdict))
        return bool(self._suffix) or not self._first

    def _look_at_key(self) -> None:
        ok, data = self._capture.retrieve()
        packet = data.tobytes() if ok else b""
        if not self._first:
            self._suffix, self._first = kind_of_packet(packet), packet
            self._verdicts[parameters(packet, self._suffix)] = ""
        elif here := parameters(packet, self._suffix):
            if here not in self._verdicts and len(self._verdicts) <= MOST_TRIALS:
                self._verdicts[here] = self._differs(packet)
            self._verdict = self._verdicts.get(here, "")

    def _differs(self, packet: bytes) -> str:
        """In what a key frame's picture differs from the first one's so that it cannot be used."""
        before, after = (shown_size(one, self._suffix) for one in (self._first, packet))
        if after == UNDECODED:
            return "are interlaced, which the decoder leaves undecoded"
        if before is None or after is None or before == after:
            return ""
        return f"are {after[0]} x {after[1]} and not {before[0]} x {before[1]}"

    def close(self) -> None:
        """Close it."""
        self._capture.release()


def kind_of_packet(packet: bytes) -> str:
    """The suffix of a bare file of a key frame's codec; empty for one whose parameters are not known here."""
    head = packet[:HEAD_BYTES]
    if head.startswith(JPEG_BEGIN):
        return ".jpg"
    if SEQUENCE_HEADER in head and MPEG4_PICTURE not in head:
        return ".m2v"
    return ".h264" if H264_SET.search(head) else ".hevc" if HEVC_SET.search(head) else ""


def parameters(packet: bytes, suffix: str) -> bytes:
    """The bytes of a key frame that say how it and what follows is to be decoded; empty if it has none."""
    if suffix == ".jpg":
        return _jpeg_size(packet)
    head = packet[:HEAD_BYTES]
    if suffix == ".m2v":
        place = head.find(SEQUENCE_HEADER)
        return head[place + 4 : place + 7] if place >= 0 else b""
    match = (H264_SET if suffix == ".h264" else HEVC_SET).search(head)
    return match[1] if match else b""


def _jpeg_size(packet: bytes) -> bytes:
    """Height and width of a JPEG as they stand in it; empty if they do not."""
    place = 2
    while place + 9 <= len(packet) and packet[place] == 0xFF:
        if packet[place + 1] in JPEG_SIZES:
            return packet[place + 5 : place + 9]
        place += 2 + int.from_bytes(packet[place + 2 : place + 4], "big")
    return b""


def shown_size(packet: bytes, suffix: str) -> SizePx | None:
    """Width and height of a key frame, opened as a file of its own; None if that cannot be, UNDECODED if the decoder
    claims to decode it and does not."""
    with tempfile.NamedTemporaryFile(suffix=suffix) as file:
        file.write(packet)
        file.flush()
        if not cv2.VideoCapture(file.name, cv2.CAP_FFMPEG).isOpened():
            return None
        try:
            image = first_picture(file.name, luma=False)
        except SourceError:
            return UNDECODED
    return None if image is None else (image.shape[1], image.shape[0])

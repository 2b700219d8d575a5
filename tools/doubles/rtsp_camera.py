"""A small RTSP camera for tests and benchmarks: motion JPEG over interleaved RTP, with RTCP sender reports.

RTSP: RFC 2326. JPEG payload: RFC 2435.

Its clock can be wrong on purpose, its reports left out, and it can fall silent, as real cameras do.
"""

import socket
import struct
import threading
import time
from collections.abc import Callable

import cv2
import numpy as np

RTP_CLOCK_HZ = 90_000
NTP_MINUS_UNIX_S = 2_208_988_800
FIRST_TICKS = 1_234_567_890  # a random number in real cameras
CHUNK = 1400
JPEG_TYPE_420 = 1  # as OpenCV writes by default: 4:2:0


class RtspCamera:
    """Serves frames that `picture(k)` draws, at fps, to one client after the other. Context manager.

    clock_shift_s: how far its clock is from this machine's. drift_ppm: how much faster its stream's clock runs than
    that. reports: whether it sends sender reports. taken: when each frame was taken, on its own clock, unix ns.
    """

    def __init__(
        self,
        picture: Callable[[int], np.ndarray],
        fps: float = 25.0,
        *,
        clock_shift_s: float = 0.0,
        reports: bool = True,
        silent_after: int | None = None,
        delay_s: Callable[[int], float] = lambda k: 0.0,
        drift_ppm: float = 0.0,
    ) -> None:
        self._picture, self._fps, self._shift_s, self._reports = picture, fps, clock_shift_s, reports
        self._silent_after, self._delay_s = silent_after, delay_s
        self._ticks_hz = RTP_CLOCK_HZ * (1 + drift_ppm * 1e-6)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.2)
        self.url = f"rtsp://127.0.0.1:{self._listener.getsockname()[1]}/test"
        self.taken: list[int] = []
        self.clients = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> "RtspCamera":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(3)
        self._listener.close()

    def now_unix_s(self) -> float:
        """Its own clock."""
        return time.time() + self._shift_s

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            self.clients += 1
            with client:
                try:
                    if self._talk(client):
                        self._stream(client)
                except OSError:
                    continue  # the client has left

    def _talk(self, client: socket.socket) -> bool:
        """Answer requests until PLAY; False if the client leaves before."""
        client.settimeout(5)
        buffer = b""
        while not self._stop.is_set():
            while b"\r\n\r\n" not in buffer:
                data = client.recv(4096)
                if not data:
                    return False
                buffer += data
            request, _, buffer = buffer.partition(b"\r\n\r\n")
            method = request.split(b" ")[0].decode()
            number = next(line for line in request.decode().splitlines() if line.lower().startswith("cseq"))
            client.sendall(self._answer(method, number).encode())
            if method == "PLAY":
                return True
        return False

    def _answer(self, method: str, number: str) -> str:
        body, more = "", ""
        if method == "OPTIONS":
            more = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:track0\r\n"
            body += f"a=framerate:{self._fps}\r\n"
            more = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            more = "Session: 1\r\n"
        return f"RTSP/1.0 200 OK\r\n{number}\r\n{more}\r\n{body}"

    def _stream(self, client: socket.socket) -> None:
        began = time.monotonic()
        zero_unix_s = self.now_unix_s()
        sequence = 0
        for k in range(10**9):
            if self._stop.wait(max(0.0, began + k / self._fps - time.monotonic())):
                return
            if self._silent_after is not None and k >= self._silent_after:
                self._stop.wait(1)
                return
            taken_s = zero_unix_s + k / self._fps
            ticks = (FIRST_TICKS + round(k / self._fps * self._ticks_hz)) & 0xFFFFFFFF
            if self._reports and k % 25 == 0:
                _interleave(client, 1, _sender_report(taken_s, ticks))
            jpeg = cv2.imencode(".jpg", self._picture(k), [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
            self._stop.wait(self._delay_s(k))
            self.taken.append(round(taken_s * 1e9))
            sequence = self._send_frame(client, jpeg, sequence, ticks)

    def _send_frame(self, client: socket.socket, jpeg: bytes, sequence: int, ticks: int) -> int:
        size, tables, scan = _parts(jpeg)
        for offset in range(0, len(scan), CHUNK):
            last = offset + CHUNK >= len(scan)
            head = struct.pack(">BBHII", 0x80, 26 | (0x80 if last else 0), sequence & 0xFFFF, ticks, 0x5EED)
            head += struct.pack(">I", offset) + bytes([JPEG_TYPE_420, 255, size[0] // 8, size[1] // 8])
            if offset == 0:
                head += struct.pack(">BBH", 0, 0, len(tables)) + tables
            _interleave(client, 0, head + scan[offset : offset + CHUNK])
            sequence += 1
        return sequence


def _interleave(client: socket.socket, channel: int, packet: bytes) -> None:
    client.sendall(b"$" + struct.pack(">BH", channel, len(packet)) + packet)


def _sender_report(unix_s: float, ticks: int) -> bytes:
    seconds = unix_s + NTP_MINUS_UNIX_S
    return struct.pack(">BBHIIIIII", 0x80, 200, 6, 0x5EED, int(seconds), int((seconds % 1) * 2**32), ticks, 0, 0)


def _parts(jpeg: bytes) -> tuple[tuple[int, int], bytes, bytes]:
    """Size, quantisation tables and entropy-coded scan of a baseline JPEG with the standard Huffman tables."""
    tables, size, at = b"", (0, 0), 2
    while True:
        marker, length = jpeg[at + 1], struct.unpack(">H", jpeg[at + 2 : at + 4])[0]
        body = jpeg[at + 4 : at + 2 + length]
        if marker == 0xDB:
            for start in range(0, len(body), 65):
                tables += body[start + 1 : start + 65]
        elif marker == 0xC0:
            size = (struct.unpack(">H", body[3:5])[0], struct.unpack(">H", body[1:3])[0])
        elif marker == 0xDA:
            return size, tables, jpeg[at + 2 + length : -2]
        at += 2 + length

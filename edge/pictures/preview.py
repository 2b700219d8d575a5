"""A low-rate picture of what a camera sees, with its tracks and state: into a file, or to a browser.

It is for whoever points the camera. It must never cost the detector a frame, so a thread of its own draws the newest
frame once in a while and nothing waits for it. The server listens on this machine only: the picture of a site is
nobody else's business; reach it through a tunnel.
"""

import http.server
import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import cv2

from edge.capture.frame import Image, Picture
from edge.capture.grey import as_wanted
from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError
from edge.common.own_thread import OwnThread
from edge.detector.mask import Mask, shaded
from edge.gate import TrackRow

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.5
PREVIEW_CLOSE_S: Final = 1.0  # a picture is drawn in milliseconds
PREVIEW_POLL_S: Final = 0.1  # how often the server looks whether it is to stop
PREVIEW_WIDTH_PX: Final = 960
PREVIEW_QUALITY: Final = 70  # of 100, JPEG
CONFIRMED_BGR: Final = (80, 255, 80)
OTHER_BGR: Final = (80, 200, 255)
LEVEL_BGR: Final = {"ok": (80, 255, 80), "warn": (80, 200, 255), "fail": (80, 80, 255)}

Latest = Callable[[], tuple[Picture, list[TrackRow], str, str] | None]
"""Asks for the newest frame, its rows, the health level, and a line about it."""


def draw(frame: Picture, rows: list[TrackRow], level: str, line: str, mask: Mask | None = None) -> bytes:
    """The frame as a JPEG with its tracks, a line of state, and what the mask leaves out in the dark."""
    scale = min(1.0, PREVIEW_WIDTH_PX / frame.image.shape[1])
    size = (round(frame.image.shape[1] * scale), round(frame.image.shape[0] * scale))
    resized: Image = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
    picture = as_wanted(resized, colour=True)
    if mask is not None:
        picture = shaded(picture, mask)
    for row in rows:
        u, v = ((row.u_px + 0.5) * scale, (row.v_px + 0.5) * scale)
        half = max(6.0, row.width_px * scale / 2 + 3, row.height_px * scale / 2 + 3)
        colour = CONFIRMED_BGR if row.status == "confirmed" else OTHER_BGR
        low, high = (round(u - half), round(v - half)), (round(u + half), round(v + half))
        cv2.rectangle(picture, low, high, colour, 1)
        cv2.putText(picture, f"{row.track} {row.score:.2f}", (high[0] + 2, high[1]), _FONT, 0.4, colour, 1)
    cv2.putText(picture, line, (8, size[1] - 8), _FONT, 0.45, LEVEL_BGR.get(level, OTHER_BGR), 1)
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, PREVIEW_QUALITY])
    return bytes(encoded)


_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX


class Preview(OwnThread):
    """Draws what `latest` gives every PERIOD_S: into a file, or served on http://127.0.0.1:PORT/. Context manager."""

    def __init__(self, where: str, latest: Latest, mask: Mask | None = None) -> None:
        """where: a file name, or a port. mask: shown as what is left out. Raises ConfigError if the port is taken."""
        super().__init__("preview", PREVIEW_CLOSE_S)
        self._latest = latest
        self._mask = mask
        self._file = None if where.isdigit() else Path(where)
        self._picture = b""
        self._changed = threading.Condition()
        self._server = PreviewServer(self, int(where)) if where.isdigit() else None

    def start(self) -> None:
        """Begin to draw and to serve."""
        super().start()
        if self._server is not None:
            self._server.start()

    def close(self) -> None:
        """End both threads."""
        super().close()
        if self._server is not None:
            self._server.close()

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

    @property
    def port(self) -> int:
        """Where it is served; 0 if it goes into a file."""
        return self._server.port if self._server is not None else 0

    def next_picture(self) -> bytes:
        """Wait for the next picture; empty when it is over."""
        with self._changed:
            self._changed.wait(2 * PERIOD_S)
            return b"" if self._stop.is_set() else self._picture

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            newest = self._latest()
            if newest is None:
                continue
            picture = draw(*newest, self._mask)
            with self._changed:
                self._picture = picture
                self._changed.notify_all()
            if self._file is not None:
                try:
                    write_atomically(self._file, picture)
                except OSError as error:
                    log.warning("preview %s: cannot be written (%s)", self._file, error)


class PreviewServer(OwnThread):
    """Serves a preview's pictures to browsers of this machine."""

    def __init__(self, preview: Preview, port: int) -> None:
        """port: 0 for any. Raises ConfigError if it is taken."""
        super().__init__("preview-http", PREVIEW_CLOSE_S)
        try:
            self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), _handler(preview))
        except (OSError, OverflowError) as error:
            raise ConfigError(f"port {port} is not free ({error})", where="--preview", action="name another") from error
        self._server.daemon_threads = True

    @property
    def port(self) -> int:
        """The port that is served."""
        return int(self._server.server_address[1])

    def _run(self) -> None:
        self._server.serve_forever(PREVIEW_POLL_S)
        self._server.server_close()

    def _wake(self) -> None:
        if self._thread.is_alive():
            self._server.shutdown()


def _handler(preview: Preview) -> type[http.server.BaseHTTPRequestHandler]:
    class PreviewHandler(http.server.BaseHTTPRequestHandler):
        """One endless JPEG stream, as browsers show it by themselves."""

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            while picture := preview.next_picture():
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode() + picture + b"\r\n")
                except OSError:
                    return  # whoever watched has left

        def log_message(self, format: str, *args: object) -> None:
            log.debug(format, *args)

    return PreviewHandler

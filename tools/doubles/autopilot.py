"""A vehicle's autopilot on MAVLink, 1/1: it beats, and does what it is told."""

import socket
import time
from typing import Any, Final

from pymavlink.dialects.v20 import common

from edge.common.own_thread import OwnThread

POLL_S: Final = 0.1
BEAT_S: Final = 1.0
CLOSE_S: Final = 2.0


class Autopilot(OwnThread):
    """Sends to a ground station's UDP port. commands: that it was given. Use as a context manager."""

    def __init__(self, port: int, answers_after_s: float = 0.0) -> None:
        super().__init__("autopilot", CLOSE_S)
        self.commands: list[int] = []
        self._to, self._answers_after_s = ("127.0.0.1", port), answers_after_s
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(POLL_S)
        self._mav: Any = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._mav.robust_parsing = True
        self._armed = 0

    def close(self) -> None:
        """End it, and its socket with it."""
        super().close()
        self._socket.close()

    def _run(self) -> None:
        beaten_s = 0.0
        while not self._stop.is_set():
            if time.monotonic() - beaten_s > BEAT_S:
                beaten_s = time.monotonic()
                self._send(common.MAVLink_heartbeat_message(2, 3, 81 | self._armed, 0, 3, 3))
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionRefusedError):  # nobody there yet
                continue
            for message in self._mav.parse_buffer(data) or ():
                if message.get_type() in {"COMMAND_LONG", "COMMAND_INT"} and message.target_component in {0, 1}:
                    self._obey(message)

    def _obey(self, message: Any) -> None:
        self.commands.append(message.command)
        if message.command == common.MAV_CMD_COMPONENT_ARM_DISARM:
            self._armed = common.MAV_MODE_FLAG_SAFETY_ARMED if message.param1 else 0
        self._stop.wait(self._answers_after_s)
        self._send(common.MAVLink_command_ack_message(message.command, common.MAV_RESULT_ACCEPTED))

    def _send(self, message: Any) -> None:
        self._socket.sendto(message.pack(self._mav), self._to)
        self._mav.seq = (self._mav.seq + 1) % 256

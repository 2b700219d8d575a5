"""TIMESYNC as MAVLink's common.xml has it today: whom a request is for, and whose request an answer is to.

The hazard is to answer for somebody else: asked of the autopilot, under whose system id the station speaks, a second
answer is averaged with the first. The two fields that say so are extensions that pymavlink's message does not have:
they are the bytes after ts1.
"""

import struct
from typing import Final

from pymavlink.dialects.v20 import common

from calib.station.outputs.mavlink.codec import Codec

HEADER_V1_BYTES, HEADER_V2_BYTES = 6, 10
TIMES_BYTES: Final = 16  # tc1 and ts1; target system and component follow


def asks_us(codec: Codec, message: common.MAVLink_timesync_message) -> bool:
    """Whether a TIMESYNC is a request that `codec`'s component has to answer."""
    if message.tc1 != 0:
        return False
    system, component = target_of(bytes(message.get_msgbuf()))
    return system in (0, codec.srcSystem) and component in (0, codec.srcComponent) and (system == 0) == (component == 0)


def target_of(frame: bytes) -> tuple[int, int]:
    """The system and component that a TIMESYNC's frame names; zeros where it names none."""
    header = HEADER_V2_BYTES if frame[0] == common.PROTOCOL_MARKER_V2 else HEADER_V1_BYTES
    payload = frame[header : header + frame[1]].ljust(TIMES_BYTES + 2, b"\0")
    return payload[TIMES_BYTES], payload[TIMES_BYTES + 1]


def timesync_answer(codec: Codec, request: common.MAVLink_timesync_message, now_unix_ns: int) -> bytes:
    """The frame that answers: our time, theirs given back, and who asked."""
    return codec.encoded(_Answer(now_unix_ns, request.ts1, request.get_srcSystem(), request.get_srcComponent()))


class _Answer(common.MAVLink_timesync_message):  # type: ignore[misc]  # pymavlink is untyped
    """With the extension fields."""

    def __init__(self, tc1: int, ts1: int, system: int, component: int) -> None:
        super().__init__(tc1, ts1)
        self._asker = (system, component)

    def pack(self, mav: Codec, force_mavlink1: bool = False) -> bytes:
        """As pymavlink's, two bytes longer."""
        payload = struct.pack("<qqBB", self.tc1, self.ts1, *self._asker)
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))

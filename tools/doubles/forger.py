"""Commands that nobody was entitled to give, at a real base over UDP and TCP: how many it acts on, how many it counts.

After each attack an honest command must still be obeyed: one forged frame that moves the base's idea of time would
shut out its own operator.
"""

import random
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega, common

from calib.station.outputs.mavlink.codec import Codec
from tools.doubles.base import TrackingBase, key_of
from tools.doubles.ports import free_port

PASSPHRASE: Final = "hill"
KEY: Final = key_of(PASSPHRASE)
PACE_S: Final = 0.002  # between commands: the base takes sixteen datagrams every fiftieth of a second
PATIENCE_S: Final = 3.0
DONE: Final = (common.MAV_RESULT_ACCEPTED, common.MAV_RESULT_IN_PROGRESS)
COMPONENT: Final = 25  # the base's, that commands are for
YEAR_S: Final = 365 * 86400.0


class Line:
    """A way to the base, and what it answers there."""

    def __init__(self, connection: socket.socket, address: tuple[str, int] | None) -> None:
        self._socket, self._address = connection, address
        self._socket.setblocking(False)
        self._parser = common.MAVLink(None)  # reads signed frames too; whose they are is not on trial here
        self._parser.robust_parsing = True
        self.results: Counter[int] = Counter()

    def say(self, frame: bytes) -> None:
        """Send a frame, at a pace at which none is lost on the way, and hear what came meanwhile."""
        self._socket.sendto(frame, self._address) if self._address else self._socket.sendall(frame)
        time.sleep(PACE_S)
        self.hear()

    def hear(self) -> None:
        """Count the results of the acknowledgements that came."""
        while True:
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return
            for message in self._parser.parse_buffer(data) or ():
                if message.get_type() == "COMMAND_ACK":
                    self.results[message.result] += 1

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    @property
    def obeyed(self) -> int:
        """How many commands this line's acknowledgements say were acted on."""
        return sum(self.results[result] for result in DONE)


def command(**options: object) -> bytes:
    """A request for another message rate from the base, signed as told."""
    key, ahead_s, link = options.get("key", KEY), options.get("ahead_s", 0.0), options.get("link", 9)
    codec = Codec(255, 190, key, link)  # type: ignore[arg-type]
    codec.refresh(time.time() + ahead_s)  # type: ignore[operator]
    return codec.encoded(common.MAVLink_command_long_message(1, COMPONENT, 511, 0, 45000, 50_000, 0, 0, 0, 0, 0))


def tampered(chance: random.Random) -> bytes:
    """A good frame with another interval and a checksum that fits it: only the signature can tell."""
    frame = bytearray(command(link=8))
    frame[10 + 4 : 10 + 8] = chance.randbytes(4)
    body = bytes(frame[1:-15])
    checksum = common.x25crc(body)
    checksum.accumulate(bytes([common.MAVLink_command_long_message.crc_extra]))
    frame[-15:-13] = checksum.crc.to_bytes(2, "little")
    return bytes(frame)


def version_1() -> bytes:
    """The same command in MAVLink 1, which knows no signatures."""
    old = ardupilotmega.MAVLink(None, srcSystem=255, srcComponent=190)
    message = ardupilotmega.MAVLink_command_long_message(1, COMPONENT, 511, 0, 45000, 50_000, 0, 0, 0, 0, 0)
    return bytes(message.pack(old, force_mavlink1=True))


@dataclass
class Trial:
    """One base under attack over both its endpoints, and what became of each attack."""

    base: TrackingBase
    reach: Callable[[], dict[str, Line]]
    obeyed: list[bytes] = field(default_factory=list)  # honest commands, for replays
    failures: int = 0

    def __post_init__(self) -> None:
        self.lines = self.reach()

    def restart(self) -> None:
        """Kill -9 the base and start it again."""
        self.base.kill()
        self.lines["tcp"].close()
        self.base.start()
        self.base.wait_until_up()
        self.lines = self.reach()

    def counted(self) -> Counter[str]:
        """What the base says of commands."""
        told = self.base.status().get("counters", {})
        return Counter({name: int(n) for name, n in told.items() if name.startswith("mavlink_commands")})

    def attack(self, name: str, count: int, forge: Callable[[int], bytes]) -> None:
        """Say forged commands on each line, and print a row of the table for each."""
        for way, line in self.lines.items():
            before, acted, heard = self.counted(), line.obeyed, sum(line.results.values())
            for number in range(count):
                line.say(forge(number))
            counted = self._settled(line, before, heard, count)
            acted = line.obeyed - acted
            after = "yes" if self.honest(way) else "NO"
            refused = counted.pop("mavlink_commands_refused", 0)
            acted += counted.pop("mavlink_commands_obeyed", 0)
            reasons = ", ".join(f"{n} {key.removeprefix('mavlink_commands_')}" for key, n in counted.items() if n)
            print(f"{name:34} {way:4} {count:6} {acted:6} {refused:8}  {after:6} {reasons}", flush=True)
            self.failures += acted != 0 or refused != count or after == "NO"

    def _settled(self, line: Line, before: Counter[str], heard: int, count: int) -> Counter[str]:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            line.hear()
            gained = self.counted() - before
            if gained["mavlink_commands_refused"] >= count and sum(line.results.values()) - heard >= count:
                break
            time.sleep(0.1)
        return self.counted() - before

    def honest(self, way: str) -> bool:
        """Whether the operator's own command is obeyed, the first time it is said."""
        line, frame = self.lines[way], command()
        before, told = line.obeyed, self.counted()["mavlink_commands_obeyed"]
        line.say(frame)
        self.obeyed.append(frame)
        deadline = time.monotonic() + PATIENCE_S
        while self.counted()["mavlink_commands_obeyed"] == told and time.monotonic() < deadline:
            time.sleep(0.1)
        line.hear()
        return line.obeyed == before + 1


def lines(udp: socket.socket, tcp_port: int) -> dict[str, Line]:
    """Both ways to a base that runs."""
    udp.setblocking(False)
    with suppress(BlockingIOError):  # what a base that was killed had still said
        while udp.recv(4096):
            pass
    udp.setblocking(True)
    address = udp.recvfrom(4096)[1]  # where its heartbeat came from
    return {"udp": Line(udp, address), "tcp": Line(socket.create_connection(("127.0.0.1", tcp_port)), None)}


@contextmanager
def trial(folder: Path) -> Iterator[Trial]:
    """A base under trial, which the operator has just commanded on both lines."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        tcp_port = free_port()
        ways = (f"udp:127.0.0.1:{udp.getsockname()[1]}", f"tcpin:127.0.0.1:{tcp_port}")
        endpoints = [{"url": url, "profile": ["ecef"]} for url in ways]
        base = TrackingBase(folder, endpoints, passphrase=PASSPHRASE, ecef_component=COMPONENT)
        base.start()
        base.wait_until_up()
        try:
            made = Trial(base, lambda: lines(udp, tcp_port))
            made.failures += sum(not made.honest(way) for way in made.lines)
            yield made
            made.lines["tcp"].close()
        finally:
            base.kill()


def attacks(chance: random.Random) -> dict[str, Callable[[int], bytes]]:
    """How to forge the n-th command of each attack that needs nothing but the key, or not even that."""
    other = key_of("another hill")
    return {
        "unsigned": lambda _: command(key=None),
        "MAVLink 1": lambda _: version_1(),
        "another key": lambda _: command(key=other),
        "another key, 50 years ahead": lambda _: command(key=other, ahead_s=50 * YEAR_S),
        "our key, an hour ahead": lambda n: command(ahead_s=3600.0 + n),
        "our key, two minutes behind": lambda n: command(ahead_s=-120.0, link=100 + n % 50),
        "overheard and changed": lambda _: tampered(chance),
    }

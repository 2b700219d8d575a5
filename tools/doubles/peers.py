"""Other people's receivers of MAVLink: MAVProxy, MAVSDK, Wireshark and stock pymavlink, as processes of their own.

None of them is needed to run Skyfix; each is used where it is installed.
"""

import os
import re
import shutil
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pymavlink

from tools.doubles.base import ROOT

XML: Final = ROOT / "deploy" / "mavlink" / "skyfix.xml"
MAVSDK_SCRIPT: Final = """
import sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.transponder import Transponder

mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
while not mavsdk.get_systems():
    time.sleep(0.05)
transponder = Transponder(mavsdk.get_systems()[0])
transponder.subscribe_transponder(
    lambda vehicle, *_: print(vehicle.icao_address, vehicle.latitude_deg, vehicle.longitude_deg, flush=True)
)
while True:
    time.sleep(1.0)
"""


COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
OPERATORS_MODULES: Final = "link,log,param,cmdlong,arm,mode,misc,adsb,battery"  # of MAVProxy; others load slowly


class Operator:
    """Somebody at MAVProxy's prompt."""

    def __init__(self, process: "subprocess.Popen[str]", said: Path) -> None:
        self._process, self._said = process, said

    @property
    def said(self) -> str:
        """All that MAVProxy has written."""
        return COLOURS.sub("", self._said.read_text())

    def sees(self, words: str, within_s: float, times: int = 1) -> bool:
        """Whether it writes this, so often, now or within a while."""
        deadline = time.monotonic() + within_s
        while self.said.count(words) < times:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.05)
        return True

    def type(self, words: str) -> None:
        """Type a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(words + "\n")
        self._process.stdin.flush()


class Peers:
    """The peers in a virtual environment, and a folder that they may fill."""

    def __init__(self, environment: Path, folder: Path) -> None:
        self._python = environment / "bin" / "python"
        self._mavproxy = environment / "bin" / "mavproxy.py"
        self._mavsdk = any(environment.glob("lib/python*/site-packages/mavsdk"))
        self._folder = folder

    @property
    def has_mavproxy(self) -> bool:
        """Whether MAVProxy is installed there."""
        return self._mavproxy.exists()

    @property
    def has_mavsdk(self) -> bool:
        """Whether MAVSDK is installed there."""
        return self._mavsdk

    @contextmanager
    def mavproxy(self, name: str, port: int, out: int, passphrase: str) -> Iterator[None]:
        """MAVProxy listening at a port; it hands on to `out` what it takes for good, and nothing unsigned."""
        home = self._folder / name
        home.mkdir()
        words = f"set allow_unsigned 0; signing key {passphrase}"
        command = [str(self._mavproxy), f"--master=udpin:127.0.0.1:{port}", f"--out=udpout:127.0.0.1:{out}"]
        quiet = ["--daemon", "--non-interactive", f"--state-basedir={home}", f"--logfile={home / 'tlog'}"]
        with self._running([*command, f"--cmd={words}", "--target-system=1", *quiet], home, home / "said.txt"):
            yield

    @contextmanager
    def operator(self, port: int, out: int) -> Iterator[Operator]:
        """MAVProxy listening at a port, with somebody at its prompt; all it hears goes on to `out`."""
        home = self._folder / "operator"
        home.mkdir()
        command = [str(self._mavproxy), f"--master=udpin:127.0.0.1:{port}", f"--out=udpout:127.0.0.1:{out}"]
        own = [f"--state-basedir={home}", f"--logfile={home / 'tlog'}", f"--default-modules={OPERATORS_MODULES}"]
        with self._running([*command, *own], home, home / "said.txt") as process:
            yield Operator(process, home / "said.txt")

    @contextmanager
    def mavsdk(self, port: int) -> Iterator[Path]:
        """MAVSDK listening at a port; the file where it writes a line for each aircraft it is told of."""
        home = self._folder / "mavsdk"
        home.mkdir()
        said = home / "said.txt"
        with self._running(["-c", MAVSDK_SCRIPT, str(port)], home, said):
            yield said

    @contextmanager
    def _running(self, words: list[str], home: Path, said: Path) -> Iterator["subprocess.Popen[str]"]:
        environment = {**os.environ, "HOME": str(home), "MAVLINK20": "1"}
        command = [str(self._python), *words]
        with said.open("w") as log:
            process = subprocess.Popen(
                command,
                env=environment,
                cwd=home,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        with process:
            try:
                yield process
            finally:
                process.kill()


def has_wireshark() -> bool:
    """Whether tshark is installed."""
    return shutil.which("tshark") is not None


def dissected(datagrams: list[bytes], folder: Path) -> Counter[str]:
    """How often Wireshark reads each message id, with the dissector that MAVLink's generator makes of our XML.

    Under "malformed": of how many datagrams it complains, a message that the dissector does not know say.
    """
    definitions = Path(pymavlink.__file__).parent / "dialects" / "v20"
    for name in ("common", "standard", "minimal"):
        shutil.copy(definitions / f"{name}.xml", folder)
    shutil.copy(XML, folder)
    make = [sys.executable, "-m", "pymavlink.tools.mavgen", "--lang=WLua", "--wire-protocol=2.0", "-o"]
    subprocess.run([*make, str(folder / "skyfix"), str(folder / "skyfix.xml")], check=True, capture_output=True)
    (folder / "frames.pcap").write_bytes(pcap(datagrams))
    fields = ("mavlink_proto.msgid", "_ws.malformed", "_ws.lua.error", "_ws.expert.message")
    shown = ["-T", "fields", *(word for field in fields for word in ("-e", field))]
    command = ["tshark", "-r", str(folder / "frames.pcap"), "-X", f"lua_script:{folder / 'skyfix.lua'}", *shown]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = [line.split("\t") for line in told.stdout.splitlines()]
    found = Counter(row[0] for row in rows)
    found["malformed"] = sum(any(row[1:]) for row in rows)
    return found


def pcap(datagrams: list[bytes]) -> bytes:
    """UDP datagrams to MAVLink's port, in a capture file (link type 101: bare IP)."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)]
    for number, datagram in enumerate(datagrams):
        udp = struct.pack(">HHHH", 14555, 14550, 8 + len(datagram), 0) + datagram
        host = bytes((127, 0, 0, 1))
        packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), number & 0xFFFF, 0, 64, 17, 0) + host + host + udp
        parts.append(struct.pack("<IIII", number, 0, len(packet), len(packet)) + packet)
    return b"".join(parts)

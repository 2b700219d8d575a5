"""Corrections by RTKLIB's str2str, without the caster's password on a command line.

Everybody on a machine reads every command line in /proc, and str2str takes its source nowhere else. So it is given a
source on this machine, an address that is drawn at each start, and what it asks there is asked of the caster with the
password added. `NTRIP_SOURCE` and `NTRIP_TO` come from the environment, which only root and the service's user read.

Standard library only: the Debian packages run this with the system's own Python.
"""

import base64
import os
import re
import selectors
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass
from typing import Final

HERE: Final = "127.0.0.1"
NTRIP_PORT: Final = 2101  # IANA's, where none is given
LAST_PORT: Final = 65535
LOOK_S: Final = 1.0  # how often it is asked whether str2str still runs
CONNECTS_WITHIN_S: Final = 10.0  # as str2str's own -s
ENDS_WITHIN_S: Final = 2.0  # str2str joins its threads, and may hang in that
HEAD_B: Final = 4096  # longer than any request of str2str's
CHUNK_B: Final = 65536
# Relay the receiver's position back (-b), try again every 10 s, a line of state every ten minutes (-d; its own is 5 s).
WORDS: Final = ("-b", "1", "-s", "10000", "-r", "10000", "-d", "600000")


@dataclass(frozen=True)
class Caster:
    """Where corrections come from. user: name and password, as the caster wants them; empty for none."""

    host: str
    port: int
    mount: str
    user: str


def parse(source: str) -> Caster:
    """`ntrip://[USER[:PASSWORD]@]HOST[:PORT]/MOUNT`, as str2str reads it. Raises ValueError, without the password."""
    user, _, place = source.removeprefix("ntrip://").rpartition("@")
    found = re.fullmatch(r"(\[[0-9A-Fa-f:]+\]|[^/:\s]+)(?::(\d{1,5}))?/(\S+)", place)
    if found is None or not source.startswith("ntrip://") or int(found[2] or NTRIP_PORT) > LAST_PORT:
        raise ValueError("NTRIP_SOURCE is not ntrip://USER:PASSWORD@HOST:PORT/MOUNTPOINT")
    return Caster(found[1].strip("[]"), int(found[2] or NTRIP_PORT), found[3], user)


def asked_of(caster: Caster, head: bytes) -> bytes:
    """str2str's request as the caster wants it: from the right user, to the right host."""
    lines = [
        line for line in head.split(b"\r\n") if line and not line.lower().startswith((b"host:", b"authorization:"))
    ]
    lines.append(f"Host: {caster.host}:{caster.port}".encode())
    if caster.user:
        lines.append(b"Authorization: Basic " + base64.b64encode(caster.user.encode()))
    return b"\r\n".join(lines) + b"\r\n\r\n"


def say(what: str) -> None:
    """One line for the journal."""
    print(f"skyfix-ntrip: {what}", file=sys.stderr, flush=True)


def connected(caster: Caster, asking: socket.socket) -> socket.socket:
    """The caster, asked. Raises OSError if it cannot be, or if nothing was asked."""
    asking.settimeout(CONNECTS_WITHIN_S)
    head = b""
    while b"\r\n\r\n" not in head:
        piece = asking.recv(HEAD_B)
        if not piece or len(head) > HEAD_B:
            raise OSError("str2str asked nothing")
        head += piece
    head, _, rest = head.partition(b"\r\n\r\n")
    there = socket.create_connection((caster.host, caster.port), CONNECTS_WITHIN_S)
    try:
        there.sendall(asked_of(caster, head) + rest)
    except OSError:
        there.close()
        raise
    return there


def relay(asking: socket.socket, there: socket.socket, child: "subprocess.Popen[bytes]") -> bytes:
    """What either says to the other, until one ends, or str2str does; the first line of the caster's."""
    first = b""
    with selectors.DefaultSelector() as ready:
        ready.register(asking, selectors.EVENT_READ, there)
        ready.register(there, selectors.EVENT_READ, asking)
        while child.poll() is None:
            for key, _ in ready.select(LOOK_S):
                assert isinstance(key.fileobj, socket.socket)
                piece = key.fileobj.recv(CHUNK_B)
                if not piece:
                    return first
                if not first and key.fileobj is there:
                    first = piece.split(b"\r\n")[0]
                key.data.sendall(piece)
    return first


def _serve(caster: Caster, listener: socket.socket, child: "subprocess.Popen[bytes]") -> str | None:
    """One connection of str2str's; why there are no corrections by it, empty if there were; None: nobody asks."""
    try:
        asking, _ = listener.accept()
    except TimeoutError:
        return None
    try:
        with asking, connected(caster, asking) as there:
            first = relay(asking, there, child).decode("latin-1")
    except (OSError, UnicodeError) as error:  # UnicodeError: a name that can be none, as `a..b`
        return f"{caster.host}:{caster.port} cannot be reached ({error}); trying again every 10 s"
    if first.startswith("SOURCETABLE"):
        return f"{caster.host} has no mountpoint {caster.mount}"
    return "" if re.match(r"ICY 200|HTTP/\S+ 200", first) else f"{caster.host} says: {first or 'nothing'}"


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.terminate()
    try:
        child.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        child.kill()


def run(caster: Caster, to: str, program: str = "str2str") -> int:
    """Until str2str ends; its exit code."""
    with socket.create_server((HERE, 0)) as listener:
        listener.settimeout(LOOK_S)
        source = f"ntrip://{HERE}:{listener.getsockname()[1]}/{caster.mount}"
        told = ""
        with subprocess.Popen([program, "-in", source, "-out", to, *WORDS], stdin=subprocess.DEVNULL) as child:
            try:
                while child.poll() is None:
                    why = _serve(caster, listener, child)
                    if why and why != told:  # once, not every 10 s
                        say(why)
                    told = told if why is None else why
            finally:
                _end(child)
        return child.returncode


def main() -> int:
    """What skyfix-ntrip.service starts."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        caster = parse(os.environ.pop("NTRIP_SOURCE", ""))  # popped: str2str needs none of it
        if not (to := os.environ.get("NTRIP_TO", "")):
            raise ValueError("NTRIP_TO does not say where corrections go")
    except ValueError as error:
        say(f"{error}; correct /etc/skyfix/ntrip.env, then: systemctl restart skyfix-ntrip")
        return 2
    try:
        return run(caster, to)
    except FileNotFoundError:
        say("str2str is not installed: apt install rtklib")
        return 1


if __name__ == "__main__":
    sys.exit(main())

"""Whether this machine is as closed as its configuration says: ports, files that others may read or change, time.

The hazard is the slow drift of a machine that works: a port that was opened to try something, a key copied without its
mode, a clock that believes whoever answers first. None of it shows until somebody uses it. Pure but for the three
readers at the end; what is said is a finding for `check`, with what to do.
"""

import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from typing import Final

from edge import __version__
from edge.clock.client import ask
from edge.common.health import Check
from edge.common.hosts import is_own

LINK_LIBRARY: Final = "eclipse-zenoh"  # whose versions have to understand each other
LISTENING: Final = "0A"  # state of a TCP socket in /proc/net/tcp
AUTHENTICATED: Final = frozenset({"NTS", "SK"})  # modes in `chronyc authdata`: network time security, symmetric keys
MOST_NAMED: Final = 3  # files, or ports, in one sentence


@dataclass(frozen=True)
class OpenPort:
    """A socket that hears: protocol, address, port."""

    protocol: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol} {host}:{self.port}"


def check_ports(found: Iterable[OpenPort], configured: Iterable[tuple[str, int]]) -> Check:
    """Whether our programs hear others where the configuration does not say so. configured: host and port."""
    known = list(configured)
    others = [port for port in found if port.protocol == "tcp" and not is_own(port.host)]
    wider = [port for port in others if not any(_as_configured(port, *one) for one in known)]
    if wider:
        reason = f"open to others and not configured: {_some(map(str, wider))}"
        return Check("open ports", "fail", reason, "end what holds them; a station restarted has what is configured")
    return Check("open ports", "ok", f"to others: {_some(map(str, others)) or 'none'}")


def _as_configured(found: OpenPort, host: str, port: int) -> bool:
    everywhere = host in ("0.0.0.0", "::", "*", "")
    return found.port == port and (everywhere or found.host == host or not _is_address(host))


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def check_files(private: Iterable[Path], shared: Iterable[Path]) -> Check:
    """Whether others may change any of these files and folders, or read the private ones; missing ones are fine."""
    private, changeable, readable = list(private), [], []
    for path in {*private, *shared}:
        try:
            mode = stat.S_IMODE(path.stat().st_mode)
        except OSError:
            continue
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            changeable.append(path)
        elif path in private and mode & stat.S_IRWXO:
            readable.append(path)
    if changeable:
        action = f"chmod o-w {' '.join(map(str, sorted(changeable)))}"
        return Check("file modes", "fail", f"anybody may change {_some(map(str, sorted(changeable)))}", action)
    if readable:
        action = f"chmod o= {' '.join(map(str, sorted(readable)))}"
        return Check("file modes", "warn", f"anybody may read {_some(map(str, sorted(readable)))}", action)
    return Check("file modes", "ok", "what is private is, and nobody else may change anything")


def check_time_sources(authdata: str) -> Check | None:
    """Whether the machine's time comes from sources that prove who they are. authdata: of `chronyc -c authdata`."""
    modes = {fields[0]: fields[1] for line in authdata.splitlines() if len(fields := line.split(",")) > 1}
    if not modes:
        return None
    plain = [name for name, mode in modes.items() if mode not in AUTHENTICATED]
    if plain:
        reason = f"anybody on the network can be {_some(plain)}"
        return Check("time sources", "warn", reason, "NTS or keys: deploy/chrony/README.md")
    return Check("time sources", "ok", f"{_some(modes)}: authenticated")


def check_program() -> Check:
    """What runs here."""
    return Check("program", "ok", f"skyfix {__version__}, zenoh {version(LINK_LIBRARY)}")


def _some(names: Iterable[str]) -> str:
    all_of_them = list(names)
    more = len(all_of_them) - MOST_NAMED
    return ", ".join(all_of_them[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


# Readers


def time_sources() -> Check | None:
    """As chronyd says; None where it does not run, or has only clocks of its own."""
    said = ask("chronyc", "-c", "-n", "authdata")
    return None if said is None else check_time_sources(said)


def open_ports(of_ports: Iterable[int], proc: Path = Path("/proc")) -> list[OpenPort]:
    """Where the program hears that holds one of these ports, as far as this user may see."""
    tables = (("tcp", "tcp"), ("tcp6", "tcp"), ("udp", "udp"), ("udp6", "udp"))
    heard = {inode: port for file, protocol in tables for inode, port in _table(proc / "net" / file, protocol)}
    known, found = set(of_ports), set[OpenPort]()
    for process in (each for each in proc.iterdir() if each.name.isdigit()):
        own = {heard[inode] for inode in _sockets(process) if inode in heard}
        if any(port.protocol == "tcp" and port.port in known for port in own):
            found |= own
    return sorted(found, key=str)


def _sockets(process: Path) -> Iterator[str]:
    try:
        for descriptor in (process / "fd").iterdir():
            target = str(descriptor.readlink())
            if target.startswith("socket:["):
                yield target.removeprefix("socket:[").removesuffix("]")
    except OSError:  # it ended, or is another user's
        return


def _table(file: Path, protocol: str) -> Iterator[tuple[str, OpenPort]]:
    try:
        rows = file.read_text().splitlines()[1:]
    except OSError:
        return
    for fields in (row.split() for row in rows):
        if len(fields) > 9 and (protocol == "udp" or fields[3] == LISTENING):
            host, _, port = fields[1].partition(":")
            yield fields[9], OpenPort(protocol, _address(host), int(port, 16))


def _address(words: str) -> str:
    """An address as /proc/net has it: words of four bytes, each as the processor stores it."""
    raw = b"".join(bytes.fromhex(words[k : k + 8])[::-1] for k in range(0, len(words), 8))
    return str(IPv4Address(raw) if len(raw) == 4 else IPv6Address(raw))

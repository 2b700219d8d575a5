"""Real chronyd processes on loopback that leave the machine's clock alone (-x)."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

NTP_PORT: Final = 30_000 + os.getpid() % 5_000


def command_port(number: int) -> int:
    """Where the chronyd of this number is asked."""
    return 20_000 + 10 * (os.getpid() % 900) + number


def asked(number: int) -> tuple[str, ...]:
    """The options of chronyc that reach it."""
    return ("-h", "127.0.0.1", "-p", str(command_port(number)))


@contextmanager
def chronyds(folder: Path, *configurations: str) -> Iterator[None]:
    """One chronyd for each configuration, numbered from 0; `serving` and `following` make the lines."""
    daemons = []
    try:
        for number, lines in enumerate(configurations):
            file = folder / f"chrony{number}.conf"
            port = command_port(number)
            file.write_text(
                f"{lines}\ncmdport {port}\nbindcmdaddress /\nbindcmdaddress 127.0.0.1\npidfile {folder}/{number}.pid\n"
            )
            command = [str(shutil.which("chronyd")), "-x", "-d", "-u", "root", "-f", str(file)]
            daemons.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        yield
    finally:
        for daemon in daemons:
            daemon.terminate()
        for daemon in daemons:
            daemon.wait()


def serving(last_byte: int, local: str) -> str:
    """Serves this machine's clock on an address of loopback. local: the options of `local`."""
    return f"local {local}\nallow 127.0.0.0/8\nport {NTP_PORT}\nbindaddress 127.0.0.{last_byte}"


def following(*sources: str) -> str:
    """Follows servers on loopback: each the last byte of one's address, and further options."""
    lines = [
        f"server 127.0.0.{byte} port {NTP_PORT} iburst minpoll 0 maxpoll 1 {options}"
        for byte, _, options in (source.partition(" ") for source in sources)
    ]
    return "\n".join([*lines, "port 0"])

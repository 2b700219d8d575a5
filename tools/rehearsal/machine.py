"""One machine: a copy of the bare Debian, booted with systemd-nspawn, without a network but its own loopback.

Machines that are to hear one another are given a cable (`cable.py`).
"""

import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Final, Self

BOOTS_WITHIN_S: Final = 60.0
LOOK_S: Final = 0.25
CLEAN: Final = (
    "env",
    "-i",
    "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME=/root",
    "LANG=C.UTF-8",
)


ROOM_MB: Final = 10_000  # of memory that is free: four machines take 5 GB of it
DISK_MB: Final = 6_000  # of one machine


class CannotBoot(Exception):  # noqa: N818 -- a state of this computer
    """No machine can be booted on this computer; with what was said."""


def _free_mb() -> int:
    lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
    return int(lines["MemAvailable"].split()[0]) // 1024


def _mounted(folder: Path) -> bool:
    """A disk in memory, where one can be had: what is written, synced and removed there waits for nobody's disk."""
    words = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}M,mode=755", "none", str(folder)]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


def _clear_remains() -> None:
    """Disks in memory that a rehearsal left when it was killed."""
    for line in Path("/proc/mounts").read_text().splitlines():
        place = Path(line.split()[1])
        made_by = re.fullmatch(r"skyfix[a-z0-9-]*-(\d+)-\w+", place.name)
        if made_by and place.parent == Path(tempfile.gettempdir()) and not Path(f"/proc/{made_by[1]}").exists():
            subprocess.run(["umount", "--lazy", str(place)], check=False)
            place.rmdir()


class Machine:
    """Use as a context manager. root: its file system, as seen from here; leader: its first process, 0 while off."""

    def __init__(self, bare: Path, name: str = "skyfix", *, programs_mb: int = 0) -> None:
        """programs_mb: how large the disk of /opt is, for one that can be filled; 0 for this computer's own."""
        self._more = [f"--tmpfs=/opt:mode=755,size={programs_mb}M"] if programs_mb else []
        _clear_remains()
        self._folder = Path(tempfile.mkdtemp(prefix=f"{name}-{os.getpid()}-"))
        self._in_memory = _free_mb() > ROOM_MB and _mounted(self._folder)
        self.root = self._folder / "root"
        self._said = self._folder / "console"
        subprocess.run(["cp", "-a", "--reflink=auto", str(bare), str(self.root)], check=True)
        self._nspawn: subprocess.Popen[bytes] | None = None
        self.leader = 0
        self.booted_s = 0.0

    def __enter__(self) -> Self:
        try:
            self.boot()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.power_off()
        if self._in_memory:
            subprocess.run(["umount", "--lazy", str(self._folder)], check=False)
        shutil.rmtree(self._folder, ignore_errors=True)

    def boot(self) -> None:
        """Start it and wait for its systemd. Raises CannotBoot."""
        words = [
            "setpriv",
            "--pdeathsig",
            "KILL",
            "systemd-nspawn",
            f"--directory={self.root}",
            "--boot",
            "--private-network",
            "--register=no",
        ]
        words += [
            "--keep-unit",
            "--console=pipe",
            f"--machine={self._folder.name.replace('_', 'x')}",
            "--resolv-conf=off",
            "--timezone=off",
        ]
        words += self._more
        began_s = time.monotonic()
        with self._said.open("ab") as said:
            self._nspawn = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        while time.monotonic() - began_s < BOOTS_WITHIN_S:
            if self._nspawn.poll() is not None:
                break
            self.leader = self._find_leader(self._nspawn.pid)
            if self.leader and self.ask("systemctl is-system-running") in ("running", "degraded"):
                self.booted_s = time.monotonic() - began_s
                return
            time.sleep(LOOK_S)
        raise CannotBoot(f"systemd-nspawn boots nothing here: {self._said.read_text(errors='replace')[-500:].strip()}")

    @staticmethod
    def _find_leader(pid: int) -> int:
        try:
            children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
            return next((int(child) for child in children if Path(f"/proc/{child}/comm").read_text() == "systemd\n"), 0)
        except OSError:
            return 0

    def power_off(self) -> None:
        """At once, as when the plug is pulled."""
        if self._nspawn is None:
            return
        if self.leader and self._nspawn.poll() is None:
            subprocess.run(["kill", "-KILL", str(self.leader)], check=False)
        try:
            self._nspawn.wait(10.0)
        except subprocess.TimeoutExpired:
            self._nspawn.send_signal(signal.SIGKILL)
            self._nspawn.wait()
        self._nspawn, self.leader = None, 0

    def run(self, script: str, timeout_s: float = 300.0) -> "subprocess.CompletedProcess[str]":
        """A line of shell, as root, in it."""
        words = [*self._entered("-m", "-u", "-i", "-n", "-p", "-r", "-w"), *CLEAN, "bash", "-c", script]
        return subprocess.run(
            words, capture_output=True, text=True, check=False, timeout=timeout_s, stdin=subprocess.DEVNULL
        )

    def start(self, script: str) -> "subprocess.Popen[str]":
        """The same, beside what follows."""
        words = [*self._entered("-m", "-u", "-i", "-n", "-p", "-r", "-w"), *CLEAN, "bash", "-c", script]
        return subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    def on_its_network(self, *words: str) -> "subprocess.Popen[str]":
        """A program of this computer, on the machine's network."""
        return subprocess.Popen(
            [*self._entered("-n"), *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def ask(self, script: str) -> str:
        """What a line of shell says on stdout."""
        return self.run(script).stdout.strip()

    def becomes(self, script: str, wanted: str, within_s: float) -> bool:
        """Whether a line of shell comes to say this in time."""
        deadline_s = time.monotonic() + within_s
        while self.ask(script) != wanted:
            if time.monotonic() > deadline_s:
                return False
            time.sleep(LOOK_S)
        return True

    def journal(self, unit: str, lines: int = 15) -> str:
        """The last that a unit said."""
        return self.ask(f"journalctl --no-pager --output=cat --lines={lines} --unit={unit}")

    def _entered(self, *namespaces: str) -> list[str]:
        return ["nsenter", f"--target={self.leader}", *namespaces, "--"]

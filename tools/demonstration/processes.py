"""The real programs, started, watched and stopped.

The hazard is a demo that hangs or leaves things running: a program that dies is noticed and its last words shown, and
whatever ends the demo ends every program it started, politely first.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from edge.common.errors import SkyfixError

STOP_S: Final = 5.0  # s: the programs promise three
LAST_LINES: Final = 15  # of a log, shown when its program died


@dataclass
class Program:
    """One running program and where its output goes."""

    name: str
    log: Path
    process: "subprocess.Popen[bytes]"

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self.process.poll()

    def last_lines(self) -> str:
        """The end of its log."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-LAST_LINES:]) or "    (it said nothing)"

    def stop(self) -> int:
        """Ask it to end, insist after STOP_S; its exit code."""
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
        return self.process.wait()


@dataclass
class Programs:
    """All programs of the demo. Use as a context manager: leaving it stops what still runs, last started first."""

    logs: Path
    running: list[Program] = field(default_factory=list)

    def __enter__(self) -> Self:
        self.logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for program in reversed(self.running):
            program.stop()

    def start(self, name: str, command: str, *arguments: str) -> Program:
        """Start an installed command. Raises SkyfixError if it is not installed."""
        executable = Path(sys.executable).parent / command
        if not executable.exists():
            raise SkyfixError("is not installed", where=str(executable), action="run `make setup` first")
        log = self.logs / f"{name}.log"
        with log.open("wb") as output:
            # A session of its own: Ctrl-C is for the demo, which then stops them in order.
            process = subprocess.Popen(
                [str(executable), *arguments], stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        program = Program(name, log, process)
        self.running.append(program)
        return program

    def check(self) -> None:
        """Raises SkyfixError with its last words if any program has failed."""
        for program in self.running:
            if program.code:
                raise SkyfixError(
                    f"ended with exit code {program.code}; its last words:\n{program.last_lines()}\n",
                    where=program.name,
                    action=f"the whole log is {program.log}",
                )

    def wait(self, programs: list[Program], within_s: float) -> bool:
        """Whether all of these ended in time; raises as `check` does if one failed."""
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            self.check()
            if all(program.code is not None for program in programs):
                return True
            time.sleep(0.1)
        return False

"""The solver in a process of its own, so that tracking never waits for it.

The hazard is the shared interpreter: a solve of seconds in a thread would hold up every position for as long. The
process is spawned (Zenoh must not be forked), talks through pipes, solves one scene at a time, and may be killed at any
moment: it holds nothing that is not asked for again. What goes wrong in it comes back as words, never as silence.
"""

import importlib
import logging
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self, runtime_checkable

from calib.errors import CalibrationError, SkyfixError
from calib.network import Network
from calib.observations import Scene
from calib.station.core.jobs import Solved, SolveJob, SolveResult
from edge.common.niceness import step_back
from edge.common.own_thread import OwnThread

log = logging.getLogger(__name__)

SOLVER_STOP_S: Final = 1.0  # s it may take to stop before it is killed
SOLVER_NICENESS: Final = 10  # of the solving process: on a small computer tracking comes first
REAPED_S: Final = 0.2  # s for a process whose pipe has ended to leave its exit code; the station's turn waits for it
TOO_LONG_S: Final = 300.0  # s: a solve that takes longer is stuck


Solver = Callable[[Scene, Network | None], Solved]
LIVE: Final = "calib.station.live_solver:solve_live"  # by name: only its own process needs to load the solver


@runtime_checkable
class Reporting(Protocol):
    """A solver that can write down what it found last."""

    def report(self, folder: Path) -> None:
        """Write it into a folder. Raises OSError."""


@dataclass(frozen=True)
class ReportRequest:
    """Write the report on the job solved last into this folder."""

    folder: Path


def _loaded(solver: Solver | str) -> Solver:
    if not isinstance(solver, str):
        return solver
    module, _, name = solver.partition(":")
    loaded: Solver = getattr(importlib.import_module(module), name)
    return loaded


def _serve(pipe: Connection, wanted: Solver | str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the station's to answer
    step_back(SOLVER_NICENESS)
    solver = _loaded(wanted)
    while True:
        try:
            job: SolveJob | ReportRequest = pipe.recv()
        except EOFError:
            return
        if isinstance(job, ReportRequest):
            _report(solver, job.folder)
            continue
        began = time.monotonic()
        solved, error = None, None
        try:
            solved = solver(job.scene, job.start)
        except SkyfixError as fault:
            error = fault
        except (ArithmeticError, ValueError, LookupError, TypeError, AttributeError, RuntimeError, ImportError) as bug:
            error = _bug(bug)
        pipe.send(SolveResult(job.number, solved, error, time.monotonic() - began))


def _bug(bug: Exception) -> SkyfixError:
    return CalibrationError(
        f"the solver failed on this window ({bug!r})",
        where="solver",
        action="keep the recording and report it; the station tries again with more data",
    )


def _cause_of_death(code: int | None) -> tuple[str, str]:
    """What happened to the process and what to do: only a SIGKILL that nobody sent is the memory's."""
    if code is None:
        return "the solver's process closed its pipe", "look at its last lines in the station's log"
    if code == -signal.SIGKILL:
        return "the solver's process was killed", "look at the computer's memory"
    if code < 0:
        return f"the solver's process died of {signal.Signals(-code).name}", "report it with the recording"
    return f"the solver's process ended with code {code}", "look at its last lines in the station's log"


def _report(solver: Solver, folder: Path) -> None:
    if not isinstance(solver, Reporting):
        return
    try:
        solver.report(folder)
    except (OSError, SkyfixError) as error:
        log.warning("no report: %s", error)


class _JobSender(OwnThread):
    """Puts one job into the pipe: a process that is only starting does not read yet, and a window does not fit in."""

    def __init__(self, pipe: Connection, job: SolveJob) -> None:
        super().__init__("solver-send", SOLVER_STOP_S)
        self._pipe, self._job = pipe, job

    def _run(self) -> None:
        try:
            self._pipe.send(self._job)
        except OSError as error:  # the process died: poll says so
            log.debug("job not sent: %s", error)


class Worker:
    """One solving process, started when first needed and again when it has died."""

    def __init__(self, solver: Solver | str = LIVE) -> None:
        self._solver = solver
        self._context = multiprocessing.get_context("spawn")
        self._process: Any = None
        self._pipe: Connection | None = None
        self._sender: _JobSender | None = None
        self._job: SolveJob | None = None
        self._since = 0.0

    def __enter__(self) -> Self:
        self._start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def busy(self) -> bool:
        """Whether a job is being worked on."""
        return self._job is not None

    def submit(self, job: SolveJob) -> bool:
        """Give it a job; False if it has one already."""
        if self.busy:
            return False
        if self._process is None or not self._process.is_alive():
            self._start()
        assert self._pipe is not None
        self._job, self._since = job, time.monotonic()
        self._sender = _JobSender(self._pipe, job).__enter__()
        return True

    def report(self, folder: Path) -> None:
        """Have the report on the job solved last written; ask before the next job is given."""
        if self._pipe is not None and not self.busy:
            try:
                self._pipe.send(ReportRequest(folder))
            except OSError as error:  # the process died: the next job starts another
                log.debug("no report: %s", error)

    def poll(self) -> SolveResult | None:
        """The finished job, if it finished since the last call; a process that died has failed its job."""
        if self._job is None or self._pipe is None:
            return None
        try:
            if self._pipe.poll():
                done: SolveResult = self._pipe.recv()
                self._job = None
                return done
        except (EOFError, OSError):
            return self._died()
        if not self._process.is_alive():
            return self._died()
        if time.monotonic() - self._since > TOO_LONG_S:
            self.close()
            return self._failed(f"the solver took longer than {TOO_LONG_S:.0f} s", "report it with the recording")
        return None

    def close(self) -> None:
        """Stop the process; killed if it does not within a second."""
        if self._process is not None:
            self._process.terminate()
            self._process.join(SOLVER_STOP_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join(SOLVER_STOP_S)
            self._process = None
        if self._sender is not None:  # nobody reads any more: what it was writing has ended with an error
            self._sender.close()
            self._sender = None
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None

    def _died(self) -> SolveResult:
        self._process.join(REAPED_S)
        return self._failed(*_cause_of_death(self._process.exitcode))

    def _failed(self, what: str, action: str) -> SolveResult:
        assert self._job is not None
        number, self._job = self._job.number, None
        error = CalibrationError(what, where="solver", action=f"{action}; it is started again")
        return SolveResult(number, None, error, time.monotonic() - self._since)

    def _start(self) -> None:
        self.close()
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(theirs, self._solver), daemon=True, name="solver")
        self._process.start()
        theirs.close()

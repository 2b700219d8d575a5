"""An output in a thread of its own, behind a bounded queue: one that hangs holds up nobody.

The hazard is the call that does not come back: a name server that is down, a receiver that stopped reading. Targets
that can't be handed on are dropped, the oldest first, and counted; what must not be lost (the origin, how a calibration
ended) is kept as state and handed on before the next targets. Only an output that is known never to block is called
from within the loop.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as TooLateError
from typing import Final

from calib.geodesy import Origin
from calib.station.core.outgoing import OutgoingTarget
from calib.station.outputs.guarded import GuardedOutput
from calib.station.outputs.output import CommandHandler, Output, StationStanding
from calib.station.status.status import EndpointStatus
from edge.common.health import Check, HealthLevel
from edge.common.own_thread import OwnThread
from edge.link.inbox import Inbox

CALLS_WAITING: Final = 512  # calls waiting: a second of a hundred cameras' targets, grouped by frame
RECORDS: Final = 4096  # frames sent, on their way to the recording
IDLE_S: Final = 0.05  # without a call for so long, the output gets its turn by time
STALLED_S: Final = 2.0  # a call that takes longer is named
ANSWER_S: Final = 1.0  # that the loop may take to answer a command; it turns fifty times a second
OUTPUT_CLOSE_S: Final = 1.0

Call = Callable[[], None]
Record = Callable[[str, bytes], None]  # endpoint, frame sent


class ThreadedOutput(OwnThread):
    """An `Output` for the loop, round one that lives in a thread."""

    def __init__(self, name: str, opened: Callable[[Record], Output], record: Record) -> None:
        """opened: opens the output, which records what it sends by what it is given. record: for the loop's thread."""
        super().__init__(f"output-{name}", OUTPUT_CLOSE_S)
        self.name = name
        self._calls: Inbox[Call] = Inbox(CALLS_WAITING)
        self._records: deque[tuple[str, bytes]] = deque(maxlen=RECORDS)
        self._commands: deque[tuple[str, Future[bool]]] = deque()
        self._origins: deque[Origin] = deque(maxlen=1)
        self._endings: deque[bool] = deque(maxlen=1)
        self._now = (0, 0, False)  # arrival clock ns, data's now ns, synced: as the loop had them last
        self._since_s: float | None = None  # when the call began that the thread is in
        self._report: tuple[list[Check], dict[str, float], list[EndpointStatus]] = ([], {}, [])
        self._reported = threading.Event()
        self._record = record
        self._inner = GuardedOutput(name, opened(lambda endpoint, frame: self._records.append((endpoint, frame))))
        self.rate_hz = self._inner.rate_hz

    # The loop's side: nothing here waits

    def targets(self, targets: Sequence[OutgoingTarget], now_ns: int, synced: bool) -> None:
        """Queue targets."""
        self._now = (now_ns, self._now[1], synced)
        if targets:
            self._calls.put(lambda: self._inner.targets(targets, now_ns, synced))

    def second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        """Queue how the station is."""
        self._calls.put(lambda: self._second(standing, texts, now_ns))

    def moved(self, origin: Origin) -> None:
        """Keep the newest origin for its next turn."""
        self._origins.append(origin)

    def calibrated(self, done: bool, now_ns: int) -> None:
        """Keep how the newest calibration ended for its next turn."""
        self._endings.append(done)

    def receive(self, now_ns: int, now_unix_ns: int, command: CommandHandler) -> None:
        """Answer what the output asks for, and record what it sent."""
        self._now = (now_ns, now_unix_ns, self._now[2])
        while self._commands:
            wanted, answer = self._commands.popleft()
            if answer.set_running_or_notify_cancel():
                answer.set_result(command(wanted))
        while self._records:
            self._record(*self._records.popleft())

    def wait(self, timeout_s: float) -> None:
        """Until it has reported how it is, or the time is over."""
        self._reported.wait(timeout_s)
        self._reported.clear()

    def checks(self, now_ns: int) -> list[Check]:
        """What it reported of itself last, and whether it hangs."""
        since_s = self._since_s
        if since_s is None or time.monotonic() - since_s < STALLED_S:
            return self._report[0]
        reason = f"has not come back for {time.monotonic() - since_s:.0f} s, {self._calls.dropped} calls were dropped"
        return [*self._report[0], Check(f"output {self.name}", "warn", reason, "look at its receiver and its network")]

    @property
    def counters(self) -> dict[str, float]:
        """What it counted, and the calls that were dropped."""
        return self._report[1] | {f"{self.name}_dropped_calls": float(self._calls.dropped)}

    @property
    def status(self) -> list[EndpointStatus]:
        """How each of its receivers was a moment ago."""
        return self._report[2]

    # The thread's side

    def _run(self) -> None:
        while not self._stop.is_set():
            call = self._calls.get(IDLE_S)
            self._since_s = time.monotonic()
            self._turn(call)
            self._since_s = None
        self._inner.close()

    def _turn(self, call: Call | None) -> None:
        now_ns, now_unix_ns, synced = self._now
        while self._origins:
            self._inner.moved(self._origins.popleft())
        while self._endings:
            self._inner.calibrated(self._endings.popleft(), now_ns)
        if call is not None:
            call()
        else:
            self._inner.targets((), now_ns, synced)
        self._inner.receive(now_ns, now_unix_ns, self._command)

    def _second(self, standing: StationStanding, texts: Sequence[tuple[HealthLevel, str]], now_ns: int) -> None:
        self._inner.second(standing, texts, now_ns)
        self._report = (self._inner.checks(now_ns), self._inner.counters, self._inner.status)
        self._reported.set()

    def _command(self, wanted: str) -> bool:
        """Ask the loop, and wait for its answer: whether it can be done."""
        answer: Future[bool] = Future()
        self._commands.append((wanted, answer))
        try:
            return answer.result(ANSWER_S)
        except TooLateError:
            answer.cancel()
            return False

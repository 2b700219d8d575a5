"""The thread that owns the receiver's port, and what it makes of it: an averaged Fix, or the reason why there is none.

The hazard is silence that all looks the same: an unplugged cable, a receiver without power, a wrong baud rate, no
corrections and a tripod that sways end alike in "no position". Each is told apart here, with what to do about it. The
port is looked for again every second by its stable name; after a loss nothing half-read and no half-fixed ambiguity is
carried over.
"""

import datetime as dt
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Final

from msgspec.structs import replace as changed

from edge.common.errors import ConfigError
from edge.common.health import Check
from edge.common.own_thread import OwnThread
from edge.config import GnssConfig
from edge.gnss.averaging import SERVICES
from edge.gnss.decoders import decoders
from edge.gnss.diagnosis import Level, ReceiverState, ReceiverStatus, Watch, counters, diagnose
from edge.gnss.gates import Policy, metres_per_degree
from edge.gnss.kept_fix import WHAT_TO_DO, KeptFix
from edge.gnss.outlook import heard
from edge.gnss.port import Fault, PortError, ReceiverPort, open_port
from edge.gnss.session import StaticSession, Surveyed, t_unix_ns
from edge.messages import Fix

log = logging.getLogger(__name__)

RECEIVER_CLOSE_S: Final = 2.0  # a driver that is asked for bytes lets go within 0.1 s, opening takes longer
PORT_RETRY_S: Final = 1.0  # between attempts to open a port that is not there
MOVING_EPOCHS: Final = 5  # in a row elsewhere, by a fixed solution: one is noise, so many are an antenna that moves
HUNG_S: Final = 15.0  # opening a port or dialling a socket takes a few seconds at most, a read a tenth of one
SNAPSHOT_S: Final = 0.5  # an average of ten minutes costs a millisecond; twice a second is enough to watch it
AUTOBAUD: Final = (115200, 38400, 460800, 230400, 921600, 9600, 57600)  # the commonest first
MAX_HORIZONTAL_LEVER_M: Final = 0.010  # its direction is unknown before the camera's heading is
# Week counters wrap after 19.7 years; a receiver that wrapped says a date before this program existed.
EARLIEST: Final = dt.date(2025, 1, 1)
LATEST: Final = EARLIEST + dt.timedelta(weeks=1024)  # and one that was corrected once too often, a date after this
INSTALLED_UNIX_S: Final = Path(__file__).stat().st_mtime  # no clock that is right says less


class Receiver(OwnThread):
    """An RTK receiver in a thread of its own.

    Ask `fix()` and `status()` whenever you like: both return at once.
    on_position is called in the reader's thread with every accepted epoch.
    """

    def __init__(
        self,
        config: GnssConfig,
        *,
        undulation_m: float | None = None,
        opener: Callable[[str, int], ReceiverPort] = open_port,
        monotonic_s: Callable[[], float] = time.monotonic,
        unix_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """undulation_m: geoid above ellipsoid at the site, where it is known.

        Raises ConfigError where the antenna's offset cannot be allowed for.
        """
        super().__init__("gnss", RECEIVER_CLOSE_S)
        check_lever_arm(config)
        self._config = config
        self._undulation_m = undulation_m
        self._opener = opener
        self._monotonic_s = monotonic_s
        self._unix_ns = unix_ns
        self._bauds = cycle(AUTOBAUD) if config.baud == 0 else cycle((config.baud,))
        self._baud = next(self._bauds)
        # A recording may be years old: neither its date nor the host's clock say anything about it.
        self._recorded = Path(config.device.removeprefix("file://")).is_file()
        self._session = self._new_session()
        self._changed = threading.Condition()
        self._kept = KeptFix()
        self._moves_seen = self._carries_seen = 0
        self._fix: Fix | None = None
        self._said: Fix | None = None
        self._surveyed: Surveyed | None = None
        self._status = ReceiverStatus(ReceiverState.STARTING, "warn", "not opened yet")
        self._restart = False
        self._news_s = monotonic_s()  # when the thread last said how it is

    def fix(self) -> Fix | None:
        """The camera's position as averaged so far; None while there is none fit for use (`status` says why)."""
        with self._changed:
            return None if self._hung() else self._fix

    def said(self) -> Fix | None:
        """What the base is to know: `fix()`, or the last one with why it is no longer stood by; None if never fixed."""
        with self._changed:
            hung = self._hung()
            return _taken_back(self._said, hung, self._session) if hung else self._said

    def surveyed(self) -> Surveyed | None:
        """The antenna's position as averaged so far, with its parts and its fault if it has one."""
        with self._changed:
            return self._surveyed

    def status(self) -> ReceiverStatus:
        """State, reason and next action."""
        with self._changed:
            return self._hung() or self._status

    def _hung(self) -> ReceiverStatus | None:
        """What to say instead where the thread has been stuck in its driver for too long; else None."""
        stuck_s = self._monotonic_s() - self._news_s
        if stuck_s < HUNG_S or self._status.state in (ReceiverState.STARTING, ReceiverState.ENDED):
            return None
        reason = f"its driver has not answered for {stuck_s:.0f} s"
        action = "unplug the receiver and plug it in again; restart the box if that does not help"
        return replace(self._status, state=ReceiverState.LOST, level="fail", reason=reason, action=action)

    def wait(self, timeout_s: float) -> bool:
        """Wait for news (status, fix, surveyed); whether there is any."""
        with self._changed:
            return self._changed.wait(timeout_s)

    @property
    def tries_rates(self) -> bool:
        """Whether silence or noise at one baud rate says nothing yet, because the next one is tried."""
        return self._config.baud == 0

    def restart(self) -> None:
        """Forget the positions so far: another tripod, or another occupation."""
        with self._changed:
            self._restart = True
            self._fix = None
            self._surveyed = None

    def _new_session(self) -> StaticSession:
        policy = Policy(
            separation_m=self._config.separation_m,
            undulation_m=self._undulation_m,
            accept_unknown_age=self._config.accept_unknown_age,
            earliest=None if self._recorded else EARLIEST,
            latest=None if self._recorded else LATEST,
        )
        service = SERVICES[self._config.service]
        return StaticSession(
            service, policy, baseline_m=self._config.baseline_m, decoders=decoders(self._config.protocols)
        )

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._read_until_lost()
            except PortError as error:
                self._session.interrupt(self._monotonic_s())
                self._report_fault(error)
                if error.fault is Fault.ENDED:
                    return
                # A cable is pulled to move a tripod: what was averaged may be of another place.
                self._session.restart()
                self._kept.forget()
            self._stop.wait(PORT_RETRY_S)

    def _read_until_lost(self) -> None:
        port = self._opener(self._config.device, self._baud)
        log.info("%s: open at %d baud", self._config.device, self._baud)
        try:
            watch = Watch(self._monotonic_s(), self._baud, self._session.frames)
            while not self._stop.is_set():
                self._take(port.read(), watch)
                if self._config.baud == 0 and watch.wrong_baud(self._monotonic_s(), self._session):
                    self._baud = next(self._bauds)
                    return
        finally:
            port.close()

    def _take(self, data: bytes, watch: Watch) -> None:
        now_s = self._monotonic_s()
        with self._changed:
            if self._restart:
                self._session.restart()
                self._kept.forget()
                self._restart = False
        if data:
            watch.last_byte_s = now_s
        accepted = self._session.feed(data, now_s)
        if accepted and not self._recorded:
            host_ns = self._unix_ns()
            watch.host_minus_gnss_s = (host_ns - t_unix_ns(accepted[-1], host_ns)) * 1e-9
            watch.oldest_possible_s = host_ns * 1e-9 - INSTALLED_UNIX_S
        if now_s - watch.last_snapshot_s >= SNAPSHOT_S:
            watch.last_snapshot_s = now_s
            self._publish(watch, now_s)

    def _publish(self, watch: Watch, now_s: float) -> None:
        surveyed = self._session.surveyed()
        status = diagnose(self._session, surveyed, watch, now_s)
        fix = None
        if surveyed and status.state is ReceiverState.AVERAGING:
            fix = self._kept_fix(surveyed)
            if self._kept.reason:
                metres = f"{math.hypot(*fix.sigma_m[:2]):.2f} m horizontal, {fix.sigma_m[2]:.2f} m vertical"
                reason = f"{self._kept.reason}; its sigma covers both: {metres}; {heard(self._session)}"
                status = replace(status, level="fail", reason=reason, action=WHAT_TO_DO)
        elif surveyed and surveyed.settling:
            self._kept_fix(surveyed)  # not said yet, but held against what comes
        with self._changed:
            if self._restart:
                return
            if status.state is not self._status.state:
                log.info("%s: %s: %s; %s", self._config.device, status.state, status.reason, status.action)
            self._surveyed, self._fix, self._status, self._news_s = surveyed, fix, status, now_s
            self._said = self._confirmed(fix) or _taken_back(fix or self._said, status, self._session)
            self._changed.notify_all()

    def _confirmed(self, fix: Fix | None) -> Fix | None:
        """The fix, if the newest epoch is one of those that it is the average of."""
        return None if self._session.against else fix

    def _kept_fix(self, surveyed: Surveyed) -> Fix:
        """The fix, held against those before it; a move that was seen explains why they lie elsewhere.

        What merely wandered, by centimetres maybe, explains no contradiction that was there before.
        """
        moves, carries = self._session.moves, self._session.carries
        if carries != self._carries_seen or (moves != self._moves_seen and not self._kept.reason):
            self._kept.forget()
        self._moves_seen, self._carries_seen = moves, carries
        return self._kept.take(make_fix(surveyed, self._config, self._unix_ns()))

    def _report_fault(self, error: PortError) -> None:
        surveyed = self._session.surveyed() if error.fault is Fault.ENDED else None
        usable = surveyed is not None and not surveyed.mean.fault
        with self._changed:
            if self._status.state != error.fault.value:
                log.warning("%s", error)
            self._surveyed, self._news_s = surveyed, self._monotonic_s()
            self._fix = make_fix(surveyed, self._config, self._unix_ns()) if surveyed and usable else None
            reason = surveyed.mean.fault if surveyed and not usable else error.what
            level: Level = "ok" if usable else "fail"
            self._status = ReceiverStatus(
                ReceiverState(error.fault.value), level, reason, error.action, counters(self._session)
            )
            self._said = self._fix or _taken_back(self._said, self._status, self._session)


def _taken_back(said: Fix | None, status: ReceiverStatus, session: StaticSession) -> Fix | None:
    """The last fix, no longer stood by. What was once spoken against is not merely unconfirmed later."""
    if said is None or said.standing == "doubted":
        return said
    moving = session.jumps >= MOVING_EPOCHS
    against = moving or (status.state is ReceiverState.DOUBTED and status.level == "fail")
    averaging = status.state is ReceiverState.AVERAGING
    why = (
        f"moving: {session.against}" if moving else session.against if averaging else f"{status.state}: {status.reason}"
    )
    return changed(said, quality=0, standing="doubted" if against else "unconfirmed", why=why)


def check_lever_arm(config: GnssConfig) -> None:
    """Refuse an antenna beside the lens: which way it lies is not known before the camera's heading is."""
    if config.lever_arm_m is None:
        return
    horizontal_m = math.hypot(*config.lever_arm_m[:2])
    if horizontal_m > MAX_HORIZONTAL_LEVER_M:
        raise ConfigError(
            f"lever_arm_m puts the antenna {horizontal_m * 1000:.0f} mm beside the lens",
            where="gnss.lever_arm_m",
            action=f"mount it above the lens, within {MAX_HORIZONTAL_LEVER_M * 1000:.0f} mm of its plumb line",
        )


def check_antenna(config: GnssConfig) -> Check:
    """Whether the box knows where its antenna stands: the base must else take the lens to be anywhere near it."""
    if config.lever_arm_m is None:
        action = "measure it and give gnss.lever_arm_m; [0, 0, 0] if the antenna is at the lens"
        return Check("antenna", "warn", "its offset from the lens is not known", action)
    east_m, north_m, up_m = config.lever_arm_m
    return Check("antenna", "ok", f"{up_m:.3f} m above the lens, {math.hypot(east_m, north_m):.3f} m beside it")


def make_fix(surveyed: Surveyed, config: GnssConfig, host_unix_ns: int) -> Fix:
    """The message: the lens's position, the lever arm taken off; without a lever arm the antenna's, which it says."""
    east_m, north_m, up_m = config.lever_arm_m or (0.0, 0.0, 0.0)
    per_lon_m, per_lat_m = metres_per_degree(surveyed.lat_deg)
    east_sigma, north_sigma, up_sigma = (float(sigma) for sigma in surveyed.mean.sigma_m)
    return Fix(
        t_unix_ns=t_unix_ns(surveyed.latest, host_unix_ns),
        lat_deg=surveyed.lat_deg - north_m / per_lat_m,
        lon_deg=surveyed.lon_deg - east_m / per_lon_m,
        height_m=surveyed.height_m - up_m,
        quality=4,
        sigma_m=(east_sigma, north_sigma, up_sigma),
        frame=config.frame,
        samples=surveyed.mean.samples,
        of="antenna" if config.lever_arm_m is None else "lens",
    )

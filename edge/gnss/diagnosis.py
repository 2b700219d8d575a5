"""What is wrong with the receiver and what to do: every cause of "no position" told apart. Pure: time is handed in."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Literal

from edge.gnss.gates import Reason
from edge.gnss.outlook import outlook
from edge.gnss.session import StaticSession, Surveyed

SILENT_S: Final = 3.0  # every receiver speaks at least once a second
STALE_S: Final = 10.0  # a mean that has got no epoch for so long is not the antenna's present position
AUTOBAUD_PATIENCE_S: Final = 2.5  # a receiver at 1 Hz speaks at least twice in it
FRAMES_PROVE_BAUD: Final = 2  # one checksum of eight bits may be right by chance
DAYS_S: Final = 86_400.0  # s; no clock that was ever set drifts by a day
MAX_CLOCK_APART_S: Final = 1.0  # serial positions come 10 to 700 ms late; more is a clock that is wrong

Level = Literal["ok", "warn", "fail"]


class ReceiverState(StrEnum):
    """Where the receiver stands."""

    STARTING = "starting"
    ABSENT = "absent"
    DENIED = "denied"
    BUSY = "busy"
    REFUSED = "refused"
    LOST = "lost"
    SILENT = "silent"
    UNREADABLE = "unreadable"
    NO_FIX = "no fix"
    DOUBTED = "doubted"
    AVERAGING = "averaging"
    ENDED = "ended"


@dataclass(frozen=True)
class ReceiverStatus:
    """How the receiver is: state, its weight, why, and what to do. counters only grow.

    mends: whether waiting may help; what a setting has to mend does not mend itself.
    """

    state: ReceiverState
    level: Level
    reason: str
    action: str = ""
    counters: dict[str, int] = field(default_factory=dict)
    host_minus_gnss_s: float | None = None
    mends: bool = True


# Refusals that stay until somebody changes a setting.
OF_SETTINGS: Final = frozenset({Reason.AGE_UNKNOWN, Reason.RESOLUTION, Reason.SEPARATION, Reason.GEOID, Reason.DATE})

Finding = tuple[ReceiverState, Level, str, str]


@dataclass
class Watch:
    """What is known about one opening of the port."""

    opened_s: float
    baud: int
    frames_before: int
    last_byte_s: float | None = None
    last_snapshot_s: float = float("-inf")
    host_minus_gnss_s: float | None = None
    oldest_possible_s: float = 0.0  # this box's clock minus the time of the newest file it was installed with

    def frames(self, session: StaticSession) -> int:
        """Whole frames since the port was opened."""
        return session.frames - self.frames_before

    def wrong_baud(self, now_s: float, session: StaticSession) -> bool:
        """Whether another rate should be tried: nothing readable has come for a while."""
        return now_s - self.opened_s > AUTOBAUD_PATIENCE_S and self.frames(session) < FRAMES_PROVE_BAUD


def diagnose(session: StaticSession, surveyed: Surveyed | None, watch: Watch, now_s: float) -> ReceiverStatus:
    """The status of an open port at monotonic now_s."""
    state, level, reason, action = _finding(session, surveyed, watch, now_s)
    refusal = session.last_refusal
    mends = state is not ReceiverState.NO_FIX or refusal is None or refusal.reason not in OF_SETTINGS
    return ReceiverStatus(state, level, reason, action, counters(session), watch.host_minus_gnss_s, mends)


def _finding(session: StaticSession, surveyed: Surveyed | None, watch: Watch, now_s: float) -> Finding:
    """What is wrong, the first of it; and how the receiver stands, where it speaks."""
    if found := _of_line(session, watch, now_s):
        return found
    heard = outlook(session, surveyed if _accepts(session, now_s) else None)
    state, level, reason, action = _of_turns(session) or _of_epochs(session, watch, now_s) or _of_mean(surveyed, watch)
    return state, level, "; ".join(part for part in (reason, heard) if part), action


def _accepts(session: StaticSession, now_s: float) -> bool:
    """Whether an epoch has been accepted lately."""
    return session.last_accepted_s is not None and now_s - session.last_accepted_s <= STALE_S


def _of_line(session: StaticSession, watch: Watch, now_s: float) -> Finding | None:
    """What the bytes say, if they say that something is wrong."""
    silent_s = now_s - (watch.last_byte_s or watch.opened_s)
    if silent_s > SILENT_S:
        action = "check the receiver's power and that it sends on this port"
        return ReceiverState.SILENT, "fail", f"no byte for {silent_s:.0f} s", action
    unread_s = now_s - (session.last_message_s or watch.opened_s)
    if min(unread_s, now_s - watch.opened_s) > SILENT_S:
        reason = f"bytes come at {watch.baud} baud, but no message in them"
        return ReceiverState.UNREADABLE, "fail", reason, "set the receiver's baud rate, or 0 to try them all"
    return None


def _of_turns(session: StaticSession) -> Finding | None:
    """Whether two antennas speak in turn."""
    if not session.in_turn:
        return None
    reason = "positions of two places come in turn: two receivers on one port, or one that jumps"
    return ReceiverState.DOUBTED, "fail", reason, "let one receiver alone send on this port"


def _of_epochs(session: StaticSession, watch: Watch, now_s: float) -> Finding | None:
    """Why no epoch has been accepted lately, if none has."""
    if _accepts(session, now_s):
        return None
    if session.last_refusal is None and session.last_malformed:
        reason = f"it cannot be read: {session.last_malformed} ({session.counts['malformed']} messages so)"
        return ReceiverState.NO_FIX, "warn", reason, "set the receiver to plain NMEA 0183, or report what it sends"
    if session.last_refusal is None and now_s - watch.opened_s <= SILENT_S:
        return ReceiverState.STARTING, "warn", "listening", "wait"
    if session.last_refusal is None:
        action = f"make it send {session.wanted}"
        return ReceiverState.NO_FIX, "warn", "no position among its messages", action
    return ReceiverState.NO_FIX, "warn", str(session.last_refusal), ADVICE[session.last_refusal.reason]


def _of_mean(surveyed: Surveyed | None, watch: Watch) -> Finding:
    """What the average is worth."""
    if surveyed is None:
        return ReceiverState.AVERAGING, "warn", "averaging begins", "wait"
    mean = surveyed.mean
    if mean.young:
        return ReceiverState.DOUBTED, "warn", mean.fault, "wait"
    if mean.fault:
        action = "break the corrections or cover the antenna, let it fix again, and do not move it"
        return ReceiverState.DOUBTED, "fail", mean.fault, action
    if watch.host_minus_gnss_s is not None and abs(watch.host_minus_gnss_s) > MAX_CLOCK_APART_S:
        reason, action = _of_clocks(watch.host_minus_gnss_s, watch.oldest_possible_s)
        return ReceiverState.AVERAGING, "warn", reason, action
    if mean.warnings:
        return ReceiverState.AVERAGING, "warn", mean.warnings[0], "change the receiver's settings"
    return ReceiverState.AVERAGING, "ok", "", ""


def _of_clocks(host_minus_gnss_s: float, host_minus_newest_file_s: float) -> tuple[str, str]:
    """Which of the two clocks is wrong, as far as the files say that are on this box: reason and action."""
    if abs(host_minus_gnss_s) < DAYS_S or host_minus_newest_file_s < 0:
        reason = f"this box's clock is {host_minus_gnss_s:+.1f} s off the receiver's UTC"
        return reason, "set the box's clock: run chrony"
    reason = f"this box's clock and the receiver's date are {abs(host_minus_gnss_s) / DAYS_S:.0f} days apart"
    return reason, "see which is wrong (date -u): set the clock with chrony, or update the receiver's firmware"


ADVICE: Final = {
    Reason.NO_POSITION: "give the antenna a free view of the sky and wait",
    Reason.QUALITY: "check that corrections reach the receiver, and wait for it to fix",
    Reason.AGE: "check the link that brings the corrections",
    Reason.AGE_UNKNOWN: "make the receiver send the age, or set accept_unknown_age",
    Reason.RESOLUTION: "switch the receiver's high-precision output on (u-blox: CFG-NMEA-HIGHPREC)",
    Reason.SEPARATION: "make the receiver send the geoid separation, or set separation_m",
    Reason.GEOID: (
        "make the receiver send the right one, or set separation_m, which then replaces it: 0 if its heights are above "
        "the ellipsoid already"
    ),
    Reason.RANGE: "check the receiver's settings",
    Reason.DOUBT: "give the antenna a free view of the sky and wait",
    Reason.GEOMETRY: "wait for the satellites to move, or give the antenna a free view of the sky",
    Reason.DISAGREE: "let one receiver alone send on this port, or restart it",
    Reason.DATE: "update the receiver's firmware: its week counter has wrapped",
    Reason.LEAP_SECOND: "wait a second",
    Reason.TIME_ORDER: "stop whatever else writes to this port",
    Reason.JUMP: "keep the antenna still",
    Reason.UNCONFIRMED: "keep the antenna still",
}


def counters(session: StaticSession) -> dict[str, int]:
    """Bytes, frames, epochs accepted, and refused for each reason."""
    refused = {f"refused: {reason}": count for reason, count in session.refusals.items() if count}
    return {**session.frame_counts, **session.counts, **refused}

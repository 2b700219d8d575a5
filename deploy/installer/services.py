"""Systemd, asked and told: does a service run, does it come up, and does it stay up.

A service that is `failed` is not waited for, nor is one that has died twice since it was started: a wrong
configuration and a crash are known within seconds.
"""

import subprocess
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from .places import SERVICES

STARTS_WITHIN_S: Final = 60.0  # Python, numpy and a model from an SD card take about 15 s on a Raspberry Pi 4
POLL_S: Final = 0.5
STAYS_S: Final = 600.0  # in which it did not die: whatever it died of before, it is not that it cannot run here
FAILED: Final = "MESSAGE_ID=d9b373ed55a64feb8242e02dbe79a49c"  # systemd's SD_MESSAGE_UNIT_FAILURE_RESULT
DEATHS: Final = 2  # since it was started: once may be a device that was still held


def booted() -> bool:
    """Whether systemd runs this machine."""
    return Path("/run/systemd/system").is_dir()


def control(*words: str) -> str:
    """`systemctl`; what it said, whatever its verdict."""
    return subprocess.run(["systemctl", *words], capture_output=True, text=True, check=False).stdout.strip()


def show(unit: str, *properties: str) -> list[str]:
    """Properties of a unit, in the order asked for."""
    told = control("show", *(f"--property={name}" for name in properties), f"{unit}.service")
    found = dict(line.split("=", 1) for line in told.splitlines() if "=" in line)
    return [found.get(name, "") for name in properties]


def running() -> list[str]:
    """Our services that are up now."""
    return [unit for unit in SERVICES if show(unit, "ActiveState") == ["active"]]


def enabled(unit: str) -> bool:
    """Whether it starts by itself."""
    return control("is-enabled", f"{unit}.service") in ("enabled", "enabled-runtime")


def restart(units: Iterable[str]) -> None:
    """Start them anew, whatever became of them, without waiting."""
    for unit in units:
        control("reset-failed", f"{unit}.service")
        control("--no-block", "restart", f"{unit}.service")


def runs_from(unit: str, prefix: Path) -> Path | None:
    """The version that a running service was started from, by its interpreter."""
    (pid,) = show(unit, "MainPID")
    try:
        interpreter = Path(Path(f"/proc/{int(pid or 0)}/cmdline").read_bytes().split(b"\0")[0].decode())
    except (OSError, ValueError):
        return None
    if not interpreter.is_relative_to(prefix):
        return None
    folder = prefix / interpreter.relative_to(prefix).parts[0]
    return folder.resolve() if folder.is_dir() else None


def keeps_dying(unit: str, since_s: float) -> bool:
    """Whether a unit that is meant to run dies again and again. since_s: how long ago its version came up.

    What ended as it was told to, for a new list of certificates, did not die. One that has failed waits for a person:
    that is its configuration, not its version.
    """
    if show(unit, "ActiveState") == ["failed"] or not enabled(unit):
        return False
    # Once may be a cable; within the first minutes of a version it is the version.
    return failures(unit, min(since_s, STAYS_S)) >= (1 if since_s < STAYS_S else DEATHS)


def failures(unit: str, within_s: float) -> int:
    """How often it failed of late, by systemd's own word in the journal; 0 where there is none."""
    words = ["journalctl", "--quiet", "--no-pager", "--output=cat", f"--unit={unit}.service", FAILED]
    try:
        told = subprocess.run(
            [*words, f"--since=-{int(within_s * 1000)}ms"], capture_output=True, text=True, check=False
        ).stdout
    except OSError:
        return 0
    return len(told.splitlines())


def come_up(units: Iterable[str], watched_s: float) -> dict[str, str]:
    """Wait until each is up and has stayed so; why not, for each that has not."""
    pending, faults = list(units), dict[str, str]()
    up: dict[str, tuple[float, str]] = {}
    deadline_s = time.monotonic() + STARTS_WITHIN_S
    while pending:
        time.sleep(POLL_S)
        for unit in [*pending]:
            verdict = _judge(unit, up, deadline_s, watched_s)
            if verdict is not None:
                pending.remove(unit)
                if verdict:
                    faults[unit] = verdict
    return faults


def _judge(unit: str, up: dict[str, tuple[float, str]], deadline_s: float, watched_s: float) -> str | None:
    """Empty: it is up and stayed so; a reason: it is not; None: not known yet."""
    names = ("ActiveState", "SubState", "NRestarts", "MainPID", "ExecMainStatus", "Result", "Job")
    state, sub, deaths, pid, status, result, job = show(unit, *names)
    now_s = time.monotonic()
    # With a job to come it is the version before that failed, to end when it was told to.
    if state == "failed" and job in ("", "0"):
        return f"failed ({result}, exit code {status})"
    if state == "inactive" and job in ("", "0") and result == "success" and unit in up:
        return ""  # a box that has played its recording to the end
    if int(deaths or 0) >= DEATHS or (sub == "auto-restart" and unit in up):
        return f"died {int(deaths or 0) + (sub == 'auto-restart')} times since it was started"
    if state == "active" and sub == "running":
        since_s, first = up.setdefault(unit, (now_s, pid))
        if pid != first:
            return f"died and was started again ({result})"
        return "" if now_s - since_s >= watched_s else None
    return f"not up within {STARTS_WITHIN_S:.0f} s ({state}, {sub})" if now_s > deadline_s and unit not in up else None


def journal(unit: str, lines: int = 8) -> str:
    """The last lines that a unit said."""
    words = ["journalctl", "--no-pager", "--output=cat", f"--lines={lines}", f"--unit={unit}.service"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=False).stdout.rstrip()
    except OSError as error:
        return f"(no journal: {error})"

"""From one version to another: switched, started, watched; and back again if it does not stay up.

The way back is the same way: what ran before is started, whatever became of it meanwhile, and seen to run.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn

from . import machine, services
from .places import ROLES, Places
from .telling import RefusedError, say, warn
from .versions import Versions

WATCHED_S: Final = 40.0  # of an upgrade: what opens late (a camera, a receiver, the network) has been opened by then
GLANCE_S: Final = 3.0  # where there is nothing to go back to


@dataclass(frozen=True)
class Machine:
    """Where a change takes place."""

    versions: Versions
    places: Places
    watched_s: float = WATCHED_S

    def enter(self, version: Path, instead_of: Path | None) -> None:
        """Make it the current one, with its units."""
        self.versions.switch(version)
        machine.lay_units(self.places, version, instead_of)


def change(here: Machine, target: Path, wanted: list[str], prepare: Callable[[], bool]) -> dict[str, str]:
    """Make a version the current one, with what ran before and what is wanted; faults of units that were not running.

    prepare: what the new version needs beside it, once it is current; whether anything of it is new. Raises
    RefusedError, with all as it was, if what ran before does not come up.
    """
    versions = here.versions
    ran = services.running() if services.booted() else []
    was, older = _in_force(versions, ran), versions.previous
    dying = _withdraw_if_dying(versions, was)
    before = older if dying and older not in (None, target) else was
    ran = list(dict.fromkeys([*ran, *dying]))
    if before not in (None, target) and versions.came_up(before):
        versions.remember(before)  # now, for the power may fail before the end
    here.enter(target, was)
    is_new = prepare()
    if not services.booted():
        return {}
    upgraded = was not in (None, target)
    # What runs already as it should is left alone: whoever only asks for the time loses no second of a flight.
    left = ran if was == target and not is_new and not dying else []
    units = [unit for unit in (*ran, *wanted) if unit not in left]
    faults = _start(units, here.watched_s if ran and upgraded else GLANCE_S)
    lost = {unit: why for unit, why in faults.items() if unit in ran}
    if lost and before is not None and upgraded:
        _put_back(here, before, older, target, {unit: lost.get(unit, "") for unit in ran})
    if not faults and (ran or wanted):
        versions.mark(target)
    if versions.previous == target:
        versions.remember(before if versions.came_up(before) and before != target else None)
    return faults


def _put_back(here: Machine, before: Path, older: Path | None, failed: Path, ran: dict[str, str]) -> NoReturn:
    """What ran before runs again, or the one before that if it kept dying. ran: why each does not now; RefusedError."""
    for unit, why in ran.items():
        if not why:
            continue
        warn(f"{unit} of {failed.name} {why}; its last words:")
        print(services.journal(unit), flush=True)
    say(f"going back to {before.name}")
    here.enter(before, failed)
    still = _start([*ran], GLANCE_S)
    here.versions.remember(older if older not in (failed, before) else None)
    if not still:
        here.versions.mark(before)  # anew: what the unit died of meanwhile was the other version
    if still:
        raise RefusedError(_reasons(still), f"{failed.name} was not kept, and {before.name} does not run either")
    raise RefusedError(f"{failed.name} was not kept", f"{before.name} runs as before")


def _in_force(versions: Versions, ran: list[str]) -> Path | None:
    """The version to go back to: what runs, for an installer may have been killed between two versions."""
    current = versions.current
    folders = {services.runs_from(unit, versions.prefix) for unit in ran} - {None}
    if len(folders) == 1:
        (running,) = folders
        assert running is not None
        if not versions.came_up(running):
            versions.mark(running)  # it runs: nobody needs a better proof
        return running
    if current is not None and not versions.came_up(current) and versions.previous is not None:
        return versions.previous
    return current


def _withdraw_if_dying(versions: Versions, was: Path | None) -> list[str]:
    """The units of a version that came up while it was watched, and have died since: it is none to go back to."""
    if was is None or not services.booted():
        return []
    dying = [unit for unit in _wanted() if services.keeps_dying(unit, versions.came_up_s_ago(was))]
    if dying:
        versions.withdraw(was)
        warn(f"{' and '.join(dying)} of {was.name} came up and did not stay: it is not kept to go back to")
    return dying


def _start(units: list[str], watched_s: float) -> dict[str, str]:
    units = list(dict.fromkeys(units))
    if not units:
        return {}
    services.restart(units)
    if watched_s > GLANCE_S:
        say(f"watching {' and '.join(units)} for {watched_s:.0f} s")
    faults = services.come_up(units, watched_s)
    for unit in units:
        say(f"{unit} {faults.get(unit, 'runs')}")
    return faults


def _reasons(faults: dict[str, str]) -> str:
    return "; ".join(f"{unit} {why}" for unit, why in faults.items())


def roll_back(here: Machine) -> None:
    """To the version before, if it came up then. Raises RefusedError: nothing was changed, or what ran was put back."""
    versions = here.versions
    last, current = versions.previous, versions.current
    if last is None or last == current:
        raise RefusedError("there is no version before", "nothing was changed")
    if not versions.came_up(last):
        raise RefusedError(f"{last.name} never came up", "nothing was changed; install a version that does")
    needed = {ROLES[role].unit for role in versions.roles(current)} & set(_wanted())
    has = {ROLES[role].unit for role in versions.roles(last)}
    if needed - has:
        raise RefusedError(f"{last.name} has no {', '.join(sorted(needed - has))}", "nothing was changed")
    failed = [unit for unit in _wanted() if unit not in services.running()]
    faults = change(here, last, failed, lambda: True)
    if faults:
        raise RefusedError(_reasons(faults), "read: journalctl -u " + next(iter(faults)))
    say(f"the current version is {last.name}")


def _wanted() -> list[str]:
    """What is meant to run here."""
    return [unit for unit in (role.unit for role in ROLES.values()) if services.booted() and services.enabled(unit)]

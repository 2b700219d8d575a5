"""`install.sh`, from where a Python is found: checks first, then lays, then changes over, then says what is missing."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from . import changeover, configuration, machine, programs, services, site_part, site_time, source, words
from .places import ROLES, Places, Role
from .telling import RefusedError, say, warn
from .versions import NEW, Versions

HERE = Path(__file__).resolve().parents[2]  # the bundle, a version that is laid, or a source tree


def main() -> int:
    """Do what is wanted; the exit code."""
    os.environ.pop("PYTHONPATH", None)
    os.umask(0o022)  # the programs are read by another user than lays them
    places = Places()
    try:
        wanted = words.parse(sys.argv[1:])
        if os.getuid() != 0:
            raise RefusedError("not root", "run it with sudo")
        machine.check_writable(places)
        with machine.alone(places):
            _act(wanted, places, Versions(places.prefix))
    except RefusedError as refusal:
        print(f"skyfix: {refusal}", file=sys.stderr)
        return refusal.code
    return 0


def _act(wanted: argparse.Namespace, places: Places, versions: Versions) -> None:
    versions.clear_remains()
    if wanted.act == "rollback":
        changeover.roll_back(changeover.Machine(versions, places, wanted.watch))
    elif wanted.act == "uninstall":
        machine.uninstall(places, purge=wanted.purge)
    elif wanted.offline is not None and wanted.offline.is_file():
        programs.check_space(places.prefix, wanted.offline.stat().st_size)
        with tempfile.TemporaryDirectory(prefix=f"unpacked{NEW}", dir=places.prefix) as folder:
            install(wanted, places, versions, source.unpack(wanted.offline, Path(folder)))
    else:
        install(wanted, places, versions, wanted.offline or HERE)


def install(wanted: argparse.Namespace, places: Places, versions: Versions, tree: Path) -> None:
    """Install or upgrade a role. Raises RefusedError, with what ran before running."""
    role, origin = ROLES[wanted.act], source.open_source(tree)
    source.check_signature(origin, places.config, wanted.signers, unsigned=wanted.unsigned)
    site_part.check(wanted, role, places.config)
    had = versions.roles(versions.current)
    target = programs.lay(origin, had | {role.name}, versions)
    machine.make_user(places)
    source.remember_signers(origin, places.config)
    part = site_part.part_of(wanted, role, places.config, target)
    asleep = role.name in had and services.booted() and not services.enabled(role.unit)
    wakes = services.booted() and not wanted.no_start and not asleep

    def prepare() -> bool:
        carried = None
        if part is not None:
            carried = site_part.configuration_of(part, role, places.config)
            site_part.lay_part(part, role, places.config)
        deploy = places.prefix / "current/deploy"
        written = configuration.lay_configuration(places.config, deploy, role, vars(wanted), carried)
        if wakes:
            services.control("--quiet", "enable", f"{role.unit}.service", "skyfix-access.path")
            services.control("restart", "skyfix-access.path")
        return written or part is not None

    try:
        faults = changeover.change(
            changeover.Machine(versions, places, wanted.watch), target, [role.unit] if wakes else [], prepare
        )
    finally:
        if gone := versions.prune():
            say(f"removed {', '.join(gone)}")
    _report(role, places, faults, asleep=asleep, started=wakes)
    say(f"{target.name} is installed as {role.name}")
    # Last: a receiver that is not plugged in yet must not keep a base from running.
    site_time.lay_time(places, versions, role.name, wanted.time, wanted.base or site_part.base_of(part, role))


def _report(role: Role, places: Places, faults: dict[str, str], *, asleep: bool, started: bool) -> None:
    if asleep:
        say(f"{role.unit} was disabled and stays so: systemctl enable --now {role.unit}")
    elif not started:
        say(f"not started; start it with: systemctl enable --now {role.unit}")
    for unit, why in faults.items():
        warn(
            f"{unit} does not run yet ({why}): correct {places.config}/{role.name}.toml, then: systemctl restart {unit}"
        )
    if role.program is None:
        return
    say("what is missing on this machine:")
    check = [
        str(places.prefix / "current/bin" / role.program),
        "check",
        "--config",
        f"{places.config}/{role.name}.toml",
    ]
    told = subprocess.run(check, capture_output=True, text=True, check=False)
    for line in (told.stdout + told.stderr).splitlines():
        if line.startswith(("PASS", "WARN", "FAIL", f"{role.program}:")):
            print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())

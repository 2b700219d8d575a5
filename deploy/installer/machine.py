"""What a machine has beside the programs: user, folders, units, names of devices, a sysctl, the commands' names."""

import contextlib
import errno
import fcntl
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from . import services, site_time
from .places import PROGRAMS, SERVICES, Places
from .telling import RefusedError, say

USER: Final = "skyfix"
GROUPS: Final = ("video", "dialout")  # cameras, serial ports
BACK_OFF_SINCE: Final = 254  # systemd's version; older ones know the words not
BACK_OFF: Final = "[Service]\nRestartSteps=6\nRestartMaxDelaySec=60\n"
UDEV: Final = "udev/rules.d/70-skyfix.rules"
SYSCTL: Final = "sysctl.d/60-skyfix.conf"
SETTINGS_BEFORE: Final = ".settings-before"


@contextlib.contextmanager
def alone(places: Places) -> Iterator[None]:
    """One installer at a time; the second waits and says so."""
    places.prefix.mkdir(parents=True, exist_ok=True)
    with (places.prefix / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another installation is going on: waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def check_writable(places: Places) -> None:
    """Raises RefusedError naming a folder that cannot be written, before anything is done."""
    for folder in (places.prefix, places.config, places.units, places.state):
        there = next(each for each in (folder, *folder.parents) if each.is_dir())
        probe = there / f".skyfix-{os.getpid()}"
        try:
            probe.touch()
            probe.unlink()
        except OSError as error:
            cure = "look at its rights"
            if error.errno == errno.EROFS:
                cure = "its disk is mounted read-only: mount -o remount,rw (raspi-config: overlay file system off)"
            raise RefusedError(f"{there} cannot be written ({error.strerror})", cure) from None


def make_user(places: Places) -> None:
    """The user of all services, and its folders."""
    if not _known("passwd", USER):
        home = ["--home-dir", str(places.state), "--no-create-home", "--shell", "/usr/sbin/nologin"]
        _must("useradd", "--system", "--user-group", *home, USER)
    for group in GROUPS:
        if _known("group", group):
            _must("usermod", "--append", "--groups", group, USER)
    for folder, mode, owner in (
        (places.state, 0o750, USER),
        (places.config, 0o750, "root"),
        (places.config / "certs", 0o750, "root"),
    ):
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(mode)
        shutil.chown(folder, owner, USER)


def _known(database: str, name: str) -> bool:
    return subprocess.run(["getent", database, name], capture_output=True, check=False).returncode == 0


def _must(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RefusedError(f"{words[0]}: {done.stderr.strip()}", "nothing was changed")


def lay_units(places: Places, version: Path, before: Path | None) -> None:
    """That version's units and settings in place of the other's."""
    units = {file.name for file in (version / "systemd").iterdir()}
    if before is not None and (before / "systemd").is_dir():
        for file in (before / "systemd").iterdir():
            if file.name not in units:
                _remove_unit(places, file.name)
    places.units.mkdir(parents=True, exist_ok=True)
    for name in units:
        _lay(version / "systemd" / name, places.units / name)
    _lay(version / "deploy/udev/70-skyfix.rules", places.etc(UDEV))
    _remember_settings(places, version / "deploy/sysctl/60-skyfix.conf")
    _lay(version / "deploy/sysctl/60-skyfix.conf", places.etc(SYSCTL))
    _name_commands(places)
    if services.booted():
        _back_off(places)
        services.control("daemon-reload")
        _quietly("/usr/lib/systemd/systemd-sysctl", str(places.etc(SYSCTL)))
        if Path("/run/udev/control").exists():
            _quietly("udevadm", "control", "--reload")
            _quietly("udevadm", "trigger")


def _remember_settings(places: Places, ours: Path) -> None:
    """What the kernel had before ours, once: it is what it gets back."""
    kept = places.prefix / SETTINGS_BEFORE
    if kept.exists() or places.etc(SYSCTL).exists():
        return
    lines = []
    for name in re.findall(r"^(\S+) =", ours.read_text(), re.MULTILINE):
        with contextlib.suppress(OSError):
            lines.append(f"{name} = {_setting(name).read_text().strip()}\n")
    kept.write_text("".join(lines))


def _restore_settings(places: Places) -> None:
    """What ours had changed is as before at once, not only after the next start."""
    kept = places.prefix / SETTINGS_BEFORE
    for name, value in re.findall(r"^(\S+) = (.+)$", kept.read_text() if kept.exists() else "", re.MULTILINE):
        with contextlib.suppress(OSError):  # a container may not
            _setting(name).write_text(value)


def _setting(name: str) -> Path:
    return Path("/proc/sys") / name.replace(".", "/")


def _lay(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    following = target.with_name(f".{target.name}.new")
    shutil.copyfile(source, following)
    following.chmod(0o644)
    following.rename(target)


def _remove_unit(places: Places, name: str) -> None:
    if services.booted():
        services.control("--quiet", "disable", "--now", name)
    (places.units / name).unlink(missing_ok=True)


def _back_off(places: Places) -> None:
    words = services.control("--version").split()
    if len(words) > 1 and words[1].isdigit() and int(words[1]) >= BACK_OFF_SINCE:
        for unit in SERVICES:
            folder = places.units / f"{unit}.service.d"
            folder.mkdir(exist_ok=True)
            (folder / "back-off.conf").write_text(BACK_OFF)


def _quietly(*words: str) -> None:
    subprocess.run(words, capture_output=True, check=False)


def _name_commands(places: Places) -> None:
    """What the guide says to type is found; a file of somebody else's is left alone."""
    places.commands.mkdir(parents=True, exist_ok=True)
    for name in PROGRAMS:
        link = places.commands / name
        if link.is_symlink() or not link.exists():
            link.unlink(missing_ok=True)
            link.symlink_to(places.prefix / "current/bin" / name)


def uninstall(places: Places, *, purge: bool) -> None:
    """Take the programs off; configuration and what was measured only if asked to."""
    ours = [*(f"{unit}.service" for unit in (*SERVICES, "skyfix-ntrip", "skyfix-access")), "skyfix-access.path"]
    if services.booted():
        for unit in ours:
            services.control("--quiet", "disable", "--now", unit)
    for unit in ours:
        (places.units / unit).unlink(missing_ok=True)
    for unit in SERVICES:
        (places.units / f"{unit}.service.d/back-off.conf").unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            (places.units / f"{unit}.service.d").rmdir()  # what an administrator added there stays
    site_time.take_back(places)
    _restore_settings(places)
    for name in (UDEV, SYSCTL):
        places.etc(name).unlink(missing_ok=True)
    for name in PROGRAMS:
        link = places.commands / name
        if link.is_symlink() and link.readlink().is_relative_to(places.prefix):
            link.unlink()
    shutil.rmtree(places.prefix, ignore_errors=True)
    if services.booted():
        services.control("daemon-reload")
        services.control("reset-failed")
    if not purge:
        say(f"removed; {places.config} and {places.state} are kept (--purge removes them)")
        return
    shutil.rmtree(places.config, ignore_errors=True)
    shutil.rmtree(places.state, ignore_errors=True)
    if _known("passwd", USER):
        _must("userdel", USER)
    say("removed, with configuration and recordings")

"""Laying a version: whole and beside what runs, or not at all.

It is made under a name of its own and renamed when it is whole; the programs' first lines name their interpreter by
its path, so they are written for the name that it will have.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from . import slimming, unpacking, wheelhouse
from .places import ROLES
from .source import SUMS, Source
from .telling import RefusedError, say
from .versions import NEW, ROLES_FILE, Versions

MB: Final = 10**6
SPARE_B: Final = 50 * MB  # for everybody else on that disk
FETCHED_B: Final = 900 * MB  # a base from the internet, unpacked; measured


def lay(source: Source, roles: frozenset[str], versions: Versions) -> Path:
    """The folder of that version for these roles; an existing one if it is the same. Raises RefusedError."""
    for folder in versions.laid():
        if _same(folder, source) and roles <= versions.roles(folder):
            say(f"{folder.name} is laid already")
            return folder
    extras = {extra for role in roles for extra in ROLES[role].extras}
    wheels = wheelhouse.needed(source.wheels, extras) if source.is_bundle else []
    # What Python compiles is less than what is then cut off the libraries (a box: 278 MB, 276 MB; a base: 473, 463).
    check_space(versions.prefix, sum(unpacking.size_of(wheel.path) for wheel in wheels) or FETCHED_B)
    place = versions.name_for(source.version)
    growing = place.with_name(f"{place.name}{NEW}{os.getpid()}")
    say(f"laying {place.name} for {' and '.join(sorted(roles))} with Python {sys.version.split()[0]}")
    try:
        _grow(growing, place, source, wheels, extras)
        (growing / ROLES_FILE).write_text(" ".join(sorted(roles)) + "\n")
        subprocess.run(["sync", "--file-system", str(growing)], check=False)  # whole before it has its name
        growing.rename(place)
    except (OSError, zipfile.BadZipFile) as error:
        raise RefusedError(f"{place.name} could not be laid ({error})", "nothing was changed") from error
    finally:
        shutil.rmtree(growing, ignore_errors=True)
    return place


def _same(folder: Path, source: Source) -> bool:
    sums = folder / SUMS
    return source.is_bundle and sums.exists() and sums.read_bytes() == (source.tree / SUMS).read_bytes()


def check_space(folder: Path, needed_b: int) -> None:
    """Raises RefusedError, with numbers, if the disk cannot take it."""
    free_b = shutil.disk_usage(folder).free
    if free_b < needed_b + SPARE_B:
        raise RefusedError(
            f"{(needed_b + SPARE_B) // MB} MB are needed in {folder}, {free_b // MB} MB are free",
            "free some (old recordings?); nothing was changed",
        )


def _grow(growing: Path, place: Path, source: Source, wheels: list[wheelhouse.Wheel], extras: Iterable[str]) -> None:
    _run([sys.executable, "-m", "venv", "--without-pip", str(growing)], "no environment could be made")
    python = growing / "bin/python"
    packages = next((growing / "lib").glob("python3.*")) / "site-packages"
    if wheels:
        for wheel in wheels:
            unpacking.unpack_wheel(wheel.path, packages)
        slimming.strip_all(packages)
        shutil.copyfile(source.tree / SUMS, growing / SUMS)
    else:
        _from_the_internet(python, source.tree, extras)
        slimming.slim(packages)
    _keep_programs(growing / "bin", place)
    for name in ("deploy", "systemd"):
        shutil.copytree(source.tree / name, growing / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copyfile(source.tree / "README.md", growing / "README.md")
    _run([str(python), str(growing / "deploy/installer/loading.py")], "the programs that were laid do not load")


PIP: Final = ("--isolated", "--quiet", "--disable-pip-version-check", "install", "--no-compile")


def _from_the_internet(python: Path, tree: Path, extras: Iterable[str]) -> None:
    lock = (tree / "requirements.lock").read_text()
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as pins:
        pins.write("".join(f"{pin}\n" for pin in re.findall(r"^[\w.-]+==[^\s\\]+", lock, re.MULTILINE)))
        pins.flush()
        _run([str(python), "-m", "ensurepip"], "no pip for this Python: apt install python3-venv, or use the bundle")
        words = [*PIP, "--constraint", pins.name, f"{tree}[{','.join(sorted(extras))}]"]
        _run([str(python), "-m", "pip", *words], "pip could not fetch the programs")
        _run([str(python), "-m", "pip", "--quiet", "uninstall", "--yes", "pip", "setuptools"], "pip could not leave")


def _run(words: list[str], fault: str) -> None:
    """Raises RefusedError with the program's own last words."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(words, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        told = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()][-3:]
        raise RefusedError(f"{fault}: {' / '.join(told)}", "nothing was changed")


def _keep_programs(folder: Path, place: Path) -> None:
    for file in folder.iterdir():
        if not file.name.startswith("python"):
            file.unlink()
    unpacking.write_programs(folder, f"{place}/bin/python")

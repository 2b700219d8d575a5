"""A package's environment: the wheels of its role, laid where apt will put them, without running anything of them."""

import compileall
import os
import py_compile
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from deploy.installer import slimming, unpacking
from deploy.installer.places import ROLES, Role
from tools.bundle import PLATFORMS, ROOT, pins, refuse_strangers

PYTHON: Final = "3.11"  # Debian 12's
INTERPRETER: Final = f"/usr/bin/python{PYTHON}"
UNCHECKED: Final = py_compile.PycInvalidationMode.UNCHECKED_HASH  # the same bytes on every computer
PACKAGES: Final = {"edge": "skyfix-box", "base": "skyfix-base", "router": "skyfix-router"}


def home(role: Role) -> str:
    """Where the environment of a role lies once it is installed."""
    return f"/usr/lib/{PACKAGES[role.name]}"


def lay(root: Path, role: Role, wheel: Path, wheels: Path, machine: str) -> None:
    """A role's environment below a package's root. Raises SystemExit under another Python than the packages'."""
    if f"{sys.version_info.major}.{sys.version_info.minor}" != PYTHON:
        raise SystemExit(f"packages for Debian 12 are built with its own Python: python{PYTHON} -m tools.debs")
    folder = root / home(role).lstrip("/")
    packages = folder / f"lib/python{PYTHON}/site-packages"
    _download(wheels, wheel, role, machine)
    _install(packages, wheel, wheels, role, machine)
    (folder / "bin").mkdir()
    for name in ("python", "python3", f"python{PYTHON}"):
        (folder / "bin" / name).symlink_to(os.path.relpath(INTERPRETER, f"{home(role)}/bin"))
    (folder / "pyvenv.cfg").write_text(f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {PYTHON}\n")
    unpacking.write_programs(folder / "bin", f"{home(role)}/bin/python")
    slimming.slim(packages)
    shutil.rmtree(packages / "bin", ignore_errors=True)
    _tidy(packages)
    place = home(role) + str(packages).removeprefix(str(folder))
    compileall.compile_dir(packages, quiet=2, stripdir=str(packages), prependdir=place, invalidation_mode=UNCHECKED)


def _tags(machine: str) -> list[str]:
    return [word for name in PLATFORMS[machine] for word in ("--platform", name)]


def _download(wheels: Path, wheel: Path, role: Role, machine: str) -> None:
    constraints = wheels / "constraints.txt"
    lock = (ROOT / "requirements.lock").read_text()
    constraints.write_text(pins(lock))
    what = f"{wheel}[{','.join(role.extras)}]" if role.extras else str(wheel)
    words = ["download", "--dest", str(wheels), "--only-binary=:all:", "--python-version", PYTHON, *_tags(machine)]
    _pip(*words, "--constraint", str(constraints), what)
    refuse_strangers(wheels, lock)


def _install(packages: Path, wheel: Path, wheels: Path, role: Role, machine: str) -> None:
    what = f"{wheel}[{','.join(role.extras)}]" if role.extras else str(wheel)
    words = ["install", "--target", str(packages), "--only-binary=:all:", "--python-version", PYTHON, *_tags(machine)]
    _pip(*words, "--no-compile", "--no-index", "--find-links", str(wheels), what)


def _pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, check=True, cwd=ROOT)


def _tidy(packages: Path) -> None:
    """Rights as dpkg's, and nothing that only pip reads about itself."""
    for path in packages.rglob("*"):
        if path.is_symlink():
            continue
        path.chmod(0o755 if path.is_dir() else 0o644)


def roles() -> list[Role]:
    """All that get a package."""
    return list(ROLES.values())

"""The bare Debian, made once and kept: `python3 -m tools.rehearsal.debian` makes it (80 s, standard library only)."""

import fcntl
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

SUITE: Final = "bookworm"
PYTHON: Final = "3.11"  # that suite's
MIRROR: Final = "https://deb.debian.org/debian"
# What a minimal Debian has, and the README's `apt install`. No pip, no compiler, nothing of Skyfix's.
PACKAGES: Final = "systemd,systemd-sysv,dbus,udev,kmod,iproute2,python3,chrony,openssh-client"
LEAN: Final = [f"--dpkgopt=path-exclude=/usr/share/{name}/*" for name in ("man", "locale", "doc")]


def cache() -> Path:
    """Where it is kept."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "skyfix" / f"debian-{SUITE}-{platform.machine()}"


def missing() -> str:
    """Why it cannot be made here; empty if it can, or is there."""
    if os.geteuid() != 0:
        return "a machine to boot needs root"
    if cache().is_dir() or shutil.which("mmdebstrap"):
        return ""
    return "mmdebstrap is not installed (Debian package mmdebstrap)"


def make() -> Path:
    """The root folder, made if it is not there; one maker at a time. Raises CalledProcessError, with what was said."""
    root = cache()
    root.parent.mkdir(parents=True, exist_ok=True)
    with root.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not root.is_dir():
            _grow(root)
    return root


def _grow(root: Path) -> None:
    growing = root.with_name(f"{root.name}.new")
    shutil.rmtree(growing, ignore_errors=True)
    words = [
        "mmdebstrap",
        "--quiet",
        "--variant=minbase",
        f"--include={PACKAGES}",
        '--aptopt=Acquire::Languages "none"',
    ]
    subprocess.run([*words, *LEAN, SUITE, str(growing), MIRROR], check=True, stdin=subprocess.DEVNULL)
    growing.rename(root)


if __name__ == "__main__":
    if reason := missing():
        sys.exit(reason)
    print(make())

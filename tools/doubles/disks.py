"""Disks that refuse: full or read-only, as a mount of its own that only the program under test sees."""

import os
import subprocess
from pathlib import Path


def possible() -> str:
    """Why this machine cannot do it; empty if it can."""
    if os.geteuid() != 0:
        return "mounting needs root"
    tried = subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False)
    return "" if tried.returncode == 0 else f"`unshare --mount` is not permitted ({tried.stderr.decode().strip()})"


def on_read_only_disk(folder: Path) -> list[str]:
    """The words before a command that make it see this folder as it is, and unable to change it."""
    return _mounted(f"mount --bind '{folder}' '{folder}' && mount -o remount,bind,ro '{folder}'")


def on_full_disk(folder: Path, megabytes: int = 4) -> list[str]:
    """The words before a command that make it see this folder copied to a small disk that a file `filler` fills."""
    copied = (
        f'mount -t tmpfs -o size={megabytes}m disk "$T" && cp -a \'{folder}/.\' "$T" && mount --move "$T" \'{folder}\''
    )
    fill = f"{{ dd if=/dev/zero of='{folder}/filler' bs=4k 2>/dev/null || true; }}"
    return _mounted(f"mount --make-rprivate / && T=$(mktemp -d) && {copied} && {fill}")


def filler_of(process: "subprocess.Popen[bytes]", folder: Path) -> Path:
    """The file that fills the disk that a process sees; deleting it makes room."""
    return Path(f"/proc/{process.pid}/root{folder}/filler")


def _mounted(mounting: str) -> list[str]:
    return ["unshare", "--mount", "--propagation", "private", "sh", "-c", f'{mounting} && exec "$@"', "mounted"]

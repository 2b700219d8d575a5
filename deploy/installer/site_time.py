"""Chrony's part: a base that serves the site's time, boxes that take it from there."""

import re
import shutil
import subprocess
from typing import Final

from . import services
from .places import Places
from .telling import RefusedError, warn
from .versions import Versions

FILE: Final = "chrony/conf.d/skyfix.conf"
PLACEHOLDER: Final = "192.0.2.1"  # in box.conf, for the base's address


def lay_time(places: Places, versions: Versions, role: str, kind: str, base: str | None) -> None:
    """Chrony's configuration for this role, where one was asked for. Raises RefusedError if chronyd cannot read it."""
    template = ""
    if role == "base" and kind != "none":
        template = f"base-{kind}.conf"
    elif role == "edge" and base:
        template = "box.conf"
    if not template or versions.current is None:
        return
    if shutil.which("chronyd") is None:
        warn("chrony is not installed: apt install chrony, then run this again; without it times are not comparable")
        return
    text = (versions.current / "deploy/chrony" / template).read_text()
    text = re.sub(rf"^(server .*?){re.escape(PLACEHOLDER)}", rf"\g<1>{base}", text, flags=re.MULTILINE)
    file = places.etc(FILE)
    file.parent.mkdir(parents=True, exist_ok=True)
    following = file.with_suffix(".new")
    following.write_text(text)
    following.chmod(0o644)
    told = subprocess.run(["chronyd", "-p", "-f", str(following)], capture_output=True, text=True, check=False)
    if told.returncode:
        following.unlink()
        raise RefusedError(f"chronyd does not understand {template}: {told.stderr.strip()}", "time is as it was")
    following.rename(file)
    if services.booted():
        services.control("try-restart", "chrony.service")

"""Chrony's part: a base that serves the site's time, boxes that take it from there.

What is done, and put back if chronyd does not come up with it, is deploy/chrony/lay.sh's, which also runs by itself.
"""

import os
import subprocess
from typing import Final

from .places import Places
from .telling import RefusedError
from .versions import Versions

SCRIPT: Final = "deploy/chrony/lay.sh"


def lay_time(places: Places, versions: Versions, role: str, kind: str, base: str | None) -> None:
    """Chrony's configuration for this role, where one was asked for. Raises RefusedError if chronyd cannot read it."""
    words: tuple[str, ...] = ()
    if role == "base" and kind != "none":
        words = (f"base-{kind}",)
    elif role == "edge" and base:
        words = ("box", base)
    if words and versions.current is not None and _run(places, versions.current / SCRIPT, words):
        raise RefusedError("chrony's configuration was not laid", "time is as it was; all else is installed and runs")


def take_back(places: Places) -> None:
    """Debian's own configuration is chronyd's again."""
    script = places.prefix / "current" / SCRIPT
    if script.exists():
        _run(places, script, ("none",))


def _run(places: Places, script: "os.PathLike[str]", words: tuple[str, ...]) -> int:
    environment = os.environ | {"SKYFIX_ETC": str(places.etc("."))}
    return subprocess.run(["bash", str(script), *words], env=environment, check=False).returncode

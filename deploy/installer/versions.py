"""Which versions are laid, which one is current, and which of them ever came up.

The hazard is the way back that leads to another broken version: `previous` is only ever one whose services were seen to
run and had not kept dying when the next one came, and a version that never ran is removed again. A folder is named by
its version; the same version with other content, or for one more role, is laid beside as <version>.2, <version>.3, ...
"""

import math
import shutil
import time
from itertools import count
from pathlib import Path
from typing import Final

from .places import ROLES

CAME_UP: Final = ".came-up"
ROLES_FILE: Final = ".roles"
NEW: Final = ".new-"


class Versions:
    """The folder of versions."""

    def __init__(self, prefix: Path) -> None:
        self.prefix = prefix

    @property
    def current(self) -> Path | None:
        """The version in force, if there is one and it is whole."""
        return self._linked("current")

    @property
    def previous(self) -> Path | None:
        """The one that came up before."""
        return self._linked("previous")

    def laid(self) -> list[Path]:
        """All of them."""
        if not self.prefix.is_dir():
            return []
        return sorted(one for one in self.prefix.iterdir() if not one.is_symlink() and (one / "bin/python").exists())

    def roles(self, folder: Path | None) -> frozenset[str]:
        """What a version was laid for; an older installer's marks are understood."""
        if folder is None:
            return frozenset()
        if (folder / ROLES_FILE).exists():
            return frozenset((folder / ROLES_FILE).read_text().split()) & ROLES.keys()
        return frozenset(role for role in ROLES if (folder / f".complete-{role}").exists())

    def came_up(self, folder: Path | None) -> bool:
        """Whether its services were seen to run."""
        return folder is not None and (folder / CAME_UP).exists()

    def mark(self, folder: Path) -> None:
        """They were, just now."""
        (folder / CAME_UP).write_text(f"{time.time():.3f}\n")

    def came_up_s_ago(self, folder: Path) -> float:
        """How long ago that was, s; infinite if it does not say."""
        try:
            return time.time() - float((folder / CAME_UP).read_text())
        except (OSError, ValueError):
            return math.inf

    def withdraw(self, folder: Path) -> None:
        """It came up, and did not stay."""
        (folder / CAME_UP).unlink(missing_ok=True)

    def name_for(self, version: str) -> Path:
        """A folder that nobody has yet."""
        names = (version if number == 1 else f"{version}.{number}" for number in count(1))
        return next(self.prefix / name for name in names if not (self.prefix / name).exists())

    def clear_remains(self) -> None:
        """Remove what an installer that was killed left half laid. Only with the lock held."""
        for remains in self.prefix.glob(f"*{NEW}*"):
            shutil.rmtree(remains, ignore_errors=True)

    def switch(self, folder: Path) -> None:
        """Make it the current one, in one step."""
        self._link("current", folder)

    def remember(self, folder: Path | None) -> None:
        """The one that `rollback` leads to; None: there is none."""
        if folder is None:
            (self.prefix / "previous").unlink(missing_ok=True)
        else:
            self._link("previous", folder)

    def prune(self) -> list[str]:
        """Remove all but current and previous; their names."""
        kept = {self.current, self.previous}
        gone = [one for one in self.laid() if one not in kept]
        for one in gone:
            shutil.rmtree(one, ignore_errors=True)
        return [one.name for one in gone]

    def _linked(self, name: str) -> Path | None:
        link = self.prefix / name
        if not link.is_symlink():
            return None
        folder = self.prefix / link.readlink().name
        return folder if (folder / "bin/python").exists() else None

    def _link(self, name: str, folder: Path) -> None:
        following = self.prefix / f".next-{name}"
        following.unlink(missing_ok=True)
        following.symlink_to(folder.name)
        following.rename(self.prefix / name)

"""Wheels laid without pip: a wheel is an archive of what is to stand in site-packages, and most of it is ours to pick.

What nobody loads (`slimming.py`) is never written: a third of a base, on a small card. Scripts are not made of what
wheels ask for: the programs that a machine needs are written by name. Everything was checked against the bundle's sums.
"""

import re
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from .places import PROGRAMS
from .slimming import dropped

BLOCK_B: Final = 4096  # what the smallest file takes of a disk
# Guarded: the solver's process loads this file again.
PROGRAM: Final = """\
#!{python}
import sys
from {module} import main

if __name__ == "__main__":
    sys.exit(main())
"""


def laid(archive: zipfile.ZipFile) -> Iterator[tuple[zipfile.ZipInfo, str]]:
    """What of a wheel is laid, with its name below site-packages; `.data` holds what goes there too, and scripts."""
    for entry in archive.infolist():
        name = re.sub(r"^[^/]+\.data/(purelib|platlib)/", "", entry.filename)
        if not entry.is_dir() and not re.match(r"[^/]+\.data/", name) and not dropped(name):
            yield entry, name


def size_of(wheel: Path) -> int:
    """Bytes that a wheel takes of a disk once it is laid."""
    with zipfile.ZipFile(wheel) as archive:
        return sum(-(-entry.file_size // BLOCK_B) * BLOCK_B for entry, _ in laid(archive))


def unpack_wheel(wheel: Path, packages: Path) -> None:
    """Into a site-packages folder. Raises OSError, zipfile.BadZipFile."""
    with zipfile.ZipFile(wheel) as archive:
        for entry, name in laid(archive):
            target = packages / name
            if not target.resolve().is_relative_to(packages.resolve()):
                raise zipfile.BadZipFile(f"{wheel.name} holds {name}, which leads out of the folder")
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(entry) as source, target.open("wb") as file:
                shutil.copyfileobj(source, file, 1 << 20)


def write_programs(folder: Path, python: str) -> None:
    """Both programs, which name their interpreter by the path that it will have."""
    for name, module in PROGRAMS.items():
        (folder / name).write_text(PROGRAM.format(python=python, module=module))
        (folder / name).chmod(0o755)

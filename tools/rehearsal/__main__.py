"""Rehearse installations, as root; a finding a line, 1 if one is FAIL.

python -m tools.rehearsal                      what CI lives through: four machines, and what the pages say
python -m tools.rehearsal trouble              machines that are full, read-only, old, or set on purpose
python -m tools.rehearsal packages             the Debian packages, by apt's own means
python -m tools.rehearsal upgrades --seed 7    twenty upgrades, every third broken: half an hour
"""

import argparse
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final

from tools import bundle
from tools.rehearsal import debian
from tools.rehearsal.bench import first_base, flight, second_role
from tools.rehearsal.life import Life, lived
from tools.rehearsal.machine import CannotBoot
from tools.rehearsal.packages import built_debs, packages
from tools.rehearsal.trouble import trouble
from tools.rehearsal.upgrades import upgrades
from tools.rehearsal.whole import whole


def _upgraded(life: Life, seed: int) -> None:
    first_base(life)
    flight(life)
    second_role(life)
    upgrades(life, seed)


def _whole(life: Life, _seed: int) -> None:
    whole(life)


def _packages(life: Life, _seed: int) -> None:
    packages(life)


def _trouble(life: Life, _seed: int) -> None:
    trouble(life)


# What each part does, and how large its disk for programs is (MB; 0: as large as there is room).
PARTS: Final = {
    "packages": (_packages, 0),
    "trouble": (_trouble, 0),
    "upgrades": (_upgraded, 2000),
    "whole": (_whole, 0),
}


def built(folder: Path, archive: Path | None) -> Path:
    """The bundle's folder: unpacked, or built of this checkout for this machine."""
    if archive is None:
        (folder / "built").mkdir()
        bundle.lay_out(folder / "built", [bundle.this_machine()], [debian.PYTHON])
        return folder / "built"
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    return next(folder.glob("skyfix-*-bundle"))


def _made(part: str, folder: Path, archive: Path | None) -> Path:
    """What that part installs."""
    return built_debs(folder / "debs", bundle.this_machine()) if part == "packages" else built(folder, archive)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.rehearsal", description="A life on a booted machine.")
    parser.add_argument("--bundle", type=Path, metavar="TAR", help="one that is built already")
    parser.add_argument("part", nargs="?", choices=sorted(PARTS), default="whole")
    parser.add_argument("--seed", type=int, default=7, help="upgrades: which are broken, and how (default: 7)")
    options = parser.parse_args()
    print(f"{options.part}, seed {options.seed}", flush=True)
    if reason := debian.missing():
        sys.exit(reason)
    part, programs_mb = PARTS[options.part]

    def lead(life: Life) -> None:
        part(life, options.seed)

    with tempfile.TemporaryDirectory() as folder:
        try:
            made = _made(options.part, Path(folder), options.bundle)
            with lived(debian.make(), made, Path(folder), lead, programs_mb=programs_mb) as life:
                return int(not all(finding.came_true for finding in life.findings))
        except CannotBoot as reason:
            sys.exit(str(reason))


if __name__ == "__main__":
    sys.exit(main())

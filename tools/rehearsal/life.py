"""A life of Skyfix on one machine, or on several: what is done to it, and what was found.

Each thing asked is one Finding, kept whether it came true or not: the tests of tests/machine look at them, and
`python -m tools.rehearsal` prints them.
"""

import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tools.rehearsal.bundles import variant
from tools.rehearsal.machine import Machine

ROOT: Final = Path(__file__).parents[2]
PORT: Final = 14550  # base.example.toml's own
POSITIONS: Final = 50
FLOWN_S: Final = 120.0  # a minute at its own pace, and the solver on a busy computer
WATCH_S: Final = 6.0  # of an upgrade, here; 40 s in the field
SETTLED_S: Final = 90.0  # for anything to happen on a busy computer


@dataclass(frozen=True)
class Finding:
    """One thing that was asked. took_s: of everything since the one before."""

    name: str
    came_true: bool
    found: str
    took_s: float


@dataclass
class Life:
    """A machine's, and what was found in it. bundles: a folder to work in; bare: the Debian to boot others from;
    told: what all installations said.
    """

    machine: Machine
    bundles: Path
    built: Path
    bare: Path
    findings: list[Finding] = field(default_factory=list)
    told: str = ""
    _since_s: float = field(default_factory=time.monotonic)

    def note(self, name: str, came_true: bool, found: object = "") -> None:
        """Keep what was found."""
        now_s = time.monotonic()
        finding = Finding(name, bool(came_true), str(found).strip(), now_s - self._since_s)
        self.findings.append(finding)
        self._since_s = now_s
        print(f"{'ok  ' if came_true else 'FAIL'} {finding.took_s:6.1f} s  {name}: {finding.found[-600:]}", flush=True)

    def found(self, name: str) -> Finding:
        """What was found under a name."""
        return next(finding for finding in self.findings if finding.name == name)

    # What is done

    def bring(self, version: str, fault: str = "good") -> str:
        """A bundle laid in the machine; its path there."""
        made = self.bundles / version
        if not made.exists():
            variant(self.built, made, version, fault)
        place = self.machine.root / "root" / f"skyfix-{version}-bundle"
        if not place.exists():
            shutil.copytree(made, place)
        return f"/root/skyfix-{version}-bundle"

    def install(self, version: str, words: str, fault: str = "good") -> "subprocess.CompletedProcess[str]":
        """Install it as the README says."""
        folder = self.bring(version, fault)
        done = self.machine.run(f"{folder}/install.sh {words}", timeout_s=900)
        shutil.rmtree(self.machine.root / folder.lstrip("/"))
        self.told += done.stdout + done.stderr
        return done

    def last_words(self) -> str:
        """What the station said last that is no news of a camera."""
        said = self.machine.journal("base-station", 60).splitlines()
        return " / ".join([line for line in said if "camera" not in line][-4:])

    def state(self) -> str:
        """Which version is current, and who runs."""
        return self.machine.ask(
            "echo $(basename $(readlink /opt/skyfix/current)) $(systemctl is-active base-station) "
            "$(systemctl is-active edge-node)"
        )


@contextmanager
def lived(
    bare: Path, built: Path, folder: Path, parts: Callable[[Life], None], *, programs_mb: int = 0
) -> Iterator[Life]:
    """A machine on which these parts of a life took place. programs_mb: as Machine's. Raises CannotBoot."""
    with Machine(bare, programs_mb=programs_mb) as machine:
        life = Life(machine, folder, built, bare)
        parts(life)
        yield life

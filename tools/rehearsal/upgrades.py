"""Twenty upgrades in a row, every third broken in a drawn way, the disk full once, the installer killed once.

After each, both services have to be up, on the newest version that was good, with what was measured and configured
there as before.
"""

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tools.rehearsal.life import WATCH_S, Life

BROKEN: Final = ("exit2", "crash", "late", "hang", "unloadable")
FIELD_WATCH_S: Final = 40  # what a fault that comes late needs, and the installer's own default
LEFT_MB: Final = 92  # on the full disk
KEPT: Final = "cd / && sha256sum /etc/skyfix/*.toml /etc/skyfix/mavlink.key /var/lib/skyfix/network.toml | sha256sum"


@dataclass(frozen=True)
class Step:
    """One upgrade. kind: good, a fault of the version, or what happens to the machine: full, killed."""

    version: str
    kind: str
    role: str


def drawn(seed: int, count: int) -> Iterator[Step]:
    """Every third is broken; one of the good ones meets a full disk, another a kill."""
    chance = random.Random(seed)
    good = [k for k in range(count) if k % 3 != 2]
    full, killed = chance.sample(good, 2)
    faults = [*BROKEN, *chance.choices(BROKEN, k=max(0, count // 3 - len(BROKEN)))]  # each kind, if there is room
    chance.shuffle(faults)
    for k in range(count):
        kind = "full" if k == full else "killed" if k == killed else faults.pop() if k % 3 == 2 else "good"
        yield Step(f"1.{k}.0", kind, chance.choice(("base", "edge")))


def upgrades(life: Life, seed: int, count: int = 20) -> None:
    """Live through them. Both roles must be installed, and the base calibrated."""
    kept, good = life.machine.ask(KEPT), life.state().split()[0]
    chance = random.Random(seed)
    for step in drawn(seed, count):
        said = _take(life, step, chance)
        if step.kind in ("good", "killed"):
            good = step.version
        state = life.state()
        fine = state == f"{good} active active" and life.machine.ask(KEPT) == kept
        life.note(f"upgrade {step.version} by {step.role}, {step.kind}", fine, f"{state}; {said}")
    laid = life.machine.ask("cd /opt/skyfix && ls | grep -v -e current -e previous").split()
    life.note("two versions are left", len(laid) == 2, laid)


def _take(life: Life, step: Step, chance: random.Random) -> str:
    fault = step.kind if step.kind in BROKEN else "good"
    watch = FIELD_WATCH_S if fault == "late" else WATCH_S
    words = f"{step.role} --watch {watch:g}"
    if step.kind == "full":
        return _on_a_full_disk(life, step.version, words)
    if step.kind == "killed":
        _killed(life, step.version, words, chance)
    done = life.install(step.version, words, fault)
    return " / ".join((done.stdout + done.stderr).strip().splitlines()[-2:])


def _on_a_full_disk(life: Life, version: str, words: str) -> str:
    free = int(life.machine.ask("df --output=avail -m /opt | tail -1"))
    filled = life.machine.run(f"fallocate -l {free - LEFT_MB}M /opt/film")
    done = life.install(version, words)
    life.machine.run("rm -f /opt/film")
    told = done.stderr.strip()
    return f"{told} {filled.stderr}" if done.returncode == 1 and "MB are needed" in told else f"NOT TOLD: {told}"


def _killed(life: Life, version: str, words: str, chance: random.Random) -> None:
    """As by a cut of the power to whoever sits there: the installer and all that it started are gone."""
    folder = life.bring(version)
    life.machine.start(f"echo $$ >/run/installing; exec setsid {folder}/install.sh {words}")
    time.sleep(chance.uniform(2.0, 20.0))
    life.machine.run("kill -KILL -- -$(cat /run/installing) || kill -KILL $(cat /run/installing)")

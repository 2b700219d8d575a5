"""A life of Skyfix on one machine: installed, calibrated, upgraded to what is broken, put back, removed.

Each thing asked is one Finding, kept whether it came true or not: the tests of tests/machine look at them, and
`python -m tools.rehearsal` prints them.
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from tools.rehearsal.bundles import variant
from tools.rehearsal.machine import Machine

ROOT: Final = Path(__file__).parents[2]
PORT: Final = 14550  # base.example.toml's own
POSITIONS: Final = 50
FLIGHT: Final = Path(__file__).with_name("flight.toml")
FLOWN_S: Final = 120.0  # a minute at its own pace, and the solver on a busy computer
WATCH_S: Final = 6.0  # of an upgrade, here; 40 s in the field
LENS: Final = (
    'lens = { model = "radtan", intrinsics = [300.0, 300.0, 160.0, 120.0], distortion = [0.0, 0.0, 0.0, 0.0], '
    "size_px = [320, 240], rms_px = 0.3 }"
)
SETTLED_S: Final = 90.0  # for anything to happen on a busy computer


# Asked in the machine: does the station hear its first camera.
ONLINE: Final = (
    "import json, urllib.request as u; "
    "print(json.load(u.urlopen('http://127.0.0.1:8080/status.json', timeout=20))['cameras'][0]['online'])"
)


@dataclass(frozen=True)
class Finding:
    """One thing that was asked. took_s: of everything since the one before."""

    name: str
    came_true: bool
    found: str
    took_s: float


@dataclass
class Life:
    """A machine's, and what was found in it."""

    machine: Machine
    bundles: Path
    built: Path
    findings: list[Finding] = field(default_factory=list)
    _since_s: float = field(default_factory=time.monotonic)

    def note(self, name: str, came_true: bool, found: object = "") -> None:
        """Keep what was found."""
        now_s = time.monotonic()
        finding = Finding(name, bool(came_true), str(found).strip(), now_s - self._since_s)
        self.findings.append(finding)
        self._since_s = now_s
        print(f"{'ok  ' if came_true else 'FAIL'} {finding.took_s:6.1f} s  {name}: {finding.found[-400:]}", flush=True)

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


# The findings of `heart`, by which tests know them before the life is lived.
ASKED: Final = (
    "boots",
    "a base is installed",
    "the base runs",
    "the check after it finds no fault",
    "positions come out",
    "nothing that it asks is forbidden",
    "the page is served",
    "certificates can be made",
    "a box is installed beside it",
    "both run",
    "the base hears the box",
    "a broken version is refused",
    "what ran before runs again",
    "the broken one is gone",
    "no way back leads to it",
    "a good version is kept",
    "rollback leads to the one before",
    "two versions are kept",
    "a new list of certificates is taken up",
    "it is removed without a rest",
)


def heart(life: Life) -> None:
    """The part that CI lives through."""
    machine = life.machine
    life.note("boots", True, f"{machine.booted_s:.1f} s; {machine.ask('systemctl --version').splitlines()[0]}")
    first_base(life)
    flight(life)
    page_and_certificates(life)
    second_role(life)
    refused_upgrade(life)
    upgrade_and_rollback(life)
    access_list(life)
    removed(life)


def first_base(life: Life) -> None:
    """A base from a bare machine, by the README's lines."""
    base_is_there(life, life.install("0.1.0", "base"))


def base_is_there(life: Life, done: "subprocess.CompletedProcess[str]") -> None:
    """What an installation says, and what then runs."""
    life.note("a base is installed", done.returncode == 0, done.stdout + done.stderr)
    life.note("the base runs", life.machine.ask("systemctl is-active base-station") == "active", life.state())
    failed = [line for line in done.stdout.splitlines() if line.startswith("FAIL")]
    life.note("the check after it finds no fault", "PASS" in done.stdout and not failed, "; ".join(failed) or "no FAIL")


def flight(life: Life) -> None:
    """A flight replayed to it until MAVLink positions come out."""
    folder = life.machine.root / "root/flight"
    simulate = [sys.executable, "-m", "calib.station.app", "simulate", str(FLIGHT), "-o", str(folder)]
    subprocess.run(simulate, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    site = life.machine.ask("grep -m1 ^name /etc/skyfix/base.toml | cut -d'\"' -f2")
    words = (str(PORT), str(POSITIONS), str(FLOWN_S))
    listening = life.machine.on_its_network(sys.executable, "-m", "tools.rehearsal.positions", *words)
    assert listening.stdout is not None
    listening.stdout.readline()
    replay = f"echo $$ >/run/replay; exec base-station replay /root/{folder.name} --site {site}"
    playing = life.machine.start(replay)
    told, errors = listening.communicate()
    played = "still playing" if playing.poll() is None else f"replay ended with {playing.returncode}"
    life.note("positions come out", listening.returncode == 0, f"{told}{errors}{played}; {life.last_words()}")
    life.machine.run("kill $(cat /run/replay)")  # what is to be seen was seen: nobody waits for the rest of the minute
    playing.communicate()
    said = life.machine.journal("base-station", 400)
    forbidden = ("ermission", "not permitted", "Traceback", "Read-only")
    ill = [line for line in said.splitlines() if any(word in line for word in forbidden)]
    life.note("nothing that it asks is forbidden", not ill, "\n".join(ill) or said[-600:])


def page_and_certificates(life: Life) -> None:
    """Both are there without the internet."""
    get = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8080/', timeout=60).read().decode()[:100000])"
    page = life.machine.ask(f'python3 -c "{get}"')
    life.note(
        "the page is served", "<html" in page and "nicegui" in page, page[:80] or life.machine.journal("base-station")
    )
    certs = "cd /root && base-station certs init hill && base-station certs issue cam0 && ls certs/issued/*"
    done = life.machine.run(certs)
    life.note("certificates can be made", done.returncode == 0 and "key.pem" in done.stdout, done.stdout + done.stderr)


def second_role(life: Life) -> None:
    """A box on the same machine: the base goes on, and hears it."""
    machine = life.machine
    pid = machine.ask("systemctl show -P MainPID base-station")
    film(machine.root / "root/film.avi")
    machine.run("mkdir -p /etc/skyfix /var/lib/skyfix; cp /root/film.avi /var/lib/skyfix/")
    configure_box(machine)
    done = life.install("0.1.0", f"edge --watch {WATCH_S:g}")
    life.note("a box is installed beside it", done.returncode == 0, done.stdout + done.stderr)
    life.note("both run", life.state() == "0.1.0.2 active active", f"{life.state()}; base was {pid}")
    heard = machine.becomes(f'python3 -c "{ONLINE}"', "True", SETTLED_S)
    life.note("the base hears the box", heard, machine.journal("edge-node", 5))


def film(file: Path) -> None:
    """Ten seconds of a sky with a dot in it."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (320, 240))
    for k in range(100):
        picture = np.full((240, 320, 3), 180, np.uint8)
        picture[100:104, 20 + 2 * k : 24 + 2 * k] = 20
        writer.write(picture)
    writer.release()


def configure_box(machine: Machine, site: str = "field1") -> None:
    """edge.toml as a person would edit the example: a film for a camera, a lens, no receiver."""
    text = (ROOT / "deploy/edge.example.toml").read_text().replace('site = "field1"', f'site = "{site}"')
    text = text.replace(
        'path = "/dev/video0"',
        'path = "/var/lib/skyfix/film.avi"\nrealtime = true\nloop = true\nt0_unix_ns = 1700000000000000000',
    )
    text = text.replace('lens = "cam0.lens.toml" ', LENS + " ")
    before, _, rest = text.partition("[gnss]")
    text = before + "[spool]" + rest.partition("[spool]")[2]
    (machine.root / "etc/skyfix").mkdir(exist_ok=True)
    (machine.root / "etc/skyfix/edge.toml").write_text(text)


def refused_upgrade(life: Life) -> None:
    """A version that refuses the configuration: what ran before runs again."""
    done = life.install("0.2.0", f"base --watch {WATCH_S:g}", "exit2")
    life.note("a broken version is refused", done.returncode == 1, done.stdout + done.stderr)
    life.note("what ran before runs again", life.state() == "0.1.0.2 active active", life.state())
    left = life.machine.ask("ls /opt/skyfix")
    life.note("the broken one is gone", "0.2.0" not in left, left)
    done = life.machine.run(f"/opt/skyfix/current/deploy/install.sh rollback --watch {WATCH_S:g}")
    life.note("no way back leads to it", life.state() == "0.1.0.2 active active", done.stdout + done.stderr)


def upgrade_and_rollback(life: Life) -> None:
    """A good version, and back."""
    done = life.install("0.3.0", f"edge --watch {WATCH_S:g}")
    good = done.returncode == 0 and life.state() == "0.3.0 active active"
    life.note("a good version is kept", good, done.stdout + done.stderr + life.state())
    done = life.machine.run(f"/opt/skyfix/current/deploy/install.sh rollback --watch {WATCH_S:g}")
    back = done.returncode == 0 and life.state() == "0.1.0.2 active active"
    life.note("rollback leads to the one before", back, done.stdout + done.stderr + life.state())
    laid = life.machine.ask("cd /opt/skyfix && ls -d 0.*").split()
    life.note("two versions are kept", laid == ["0.1.0.2", "0.3.0"], laid)


def access_list(life: Life) -> None:
    """The site's list of certificates changes: whoever listens starts anew."""
    pid = life.machine.ask("systemctl show -P MainPID base-station")
    life.machine.run("echo '{}' >/etc/skyfix/certs/access.json")
    now = "p=$(systemctl show -P MainPID base-station)"
    new = f"{now}; [ $p != 0 ] && [ $p != {pid} ] && systemctl is-active base-station"
    again = life.machine.becomes(new, "active", 30.0)
    life.note("a new list of certificates is taken up", again, life.machine.journal("skyfix-access", 5))


def removed(life: Life) -> None:
    """Nothing is left but what was asked to stay."""
    done = life.machine.run("/opt/skyfix/current/deploy/install.sh uninstall --purge")
    units = life.machine.ask("systemctl list-unit-files --no-legend 'edge-node*' 'base-station*' 'skyfix*'")
    left = life.machine.ask(
        "ls -d /opt/skyfix /etc/skyfix /var/lib/skyfix /usr/local/bin/* 2>/dev/null; getent passwd skyfix"
    )
    life.note("it is removed without a rest", done.returncode == 0 and not left and not units, left + units)


@contextmanager
def lived(
    bare: Path, built: Path, folder: Path, parts: Callable[[Life], None] = heart, *, programs_mb: int = 0
) -> Iterator[Life]:
    """A machine on which these parts of a life took place. programs_mb: as Machine's. Raises CannotBoot."""
    with Machine(bare, programs_mb=programs_mb) as machine:
        life = Life(machine, folder, built)
        parts(life)
        yield life

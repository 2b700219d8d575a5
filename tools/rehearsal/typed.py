"""From a bare machine to positions, and back, by what the pages tell a person to type: word for word.

The hazard is a page that nobody follows. A machine has no internet, no receiver and no `sudo` here; the rest is as it
stands in README.md, deploy/README.md and those of certificates, time and corrections.
"""

import os
import subprocess
import time
from typing import Final

from tools import bundle
from tools.rehearsal.life import (
    ONLINE,
    SETTLED_S,
    Life,
    base_is_there,
    configure_box,
    film,
    flight,
)
from tools.rehearsal.pages import TYPED, line
from tools.rehearsal.signing import signed

SUDO: Final = 'sudo() { "$@"; }; '
BASE: Final = "192.168.7.1"  # the address in the pages
# A container may not set the clock, so Debian's unit starts no chronyd in one: here it starts one that does not.
NO_CLOCK: Final = "[Unit]\nConditionCapability=\n[Service]\nExecStart=\nExecStart=!/usr/sbin/chronyd -x $DAEMON_OPTS\n"
CHRONY: Final = "systemctl is-active chrony; tr '\\0' ' ' </proc/$(systemctl show -P MainPID chrony)/cmdline"
STR2STR: Final = '#!/bin/sh\necho "str2str $*"\nexec sleep 1000\n'
HEARD: Final = "journalctl --output=cat --unit=skyfix-ntrip | grep -c 'str2str -in ntrip://127.0.0.1:'"
# That of ntrip.example.env; the brackets keep this line from finding itself.
SEEN: Final = "cat /proc/[0-9]*/cmdline | tr '\\0' ' ' | grep -c ':[P]ASSWORD@'"


# The findings, by which tests know them before the life is lived.
ASKED: Final = (
    "the bundle is unpacked",
    "a base is installed",
    "the base runs",
    "the check after it finds no fault",
    "positions come out",
    "nothing that it asks is forbidden",
    "from a bare root to positions",
    "certificates are made as the page says",
    "a box is installed, and says what it lacks",
    "what was given stands in its configuration",
    "its clock follows the base",
    "corrected as it says, it runs and is heard",
    "the lines of the page about time do what they say",
    "a time that chronyd cannot have is taken back",
    "corrections run under their unit",
    "nobody sees the caster's password",
    "a signed bundle is taken, and its signers are kept",
    "a changed bundle is refused",
    "a stranger's bundle is refused",
    "an unsigned bundle is refused",
    "a bundle of the right signer is taken again",
    "rollback does what the page says",
    "uninstall does what the page says",
    "every line was typed",
)


class Typist:
    """Types lines of pages in a machine, and remembers which. folder: where the next line is typed."""

    def __init__(self, life: Life) -> None:
        self._life = life
        self.folder = "/root"
        self.typed: set[tuple[str, str]] = set()

    def types(self, page: str, words: str) -> "subprocess.CompletedProcess[str]":
        """One line of a page, as it stands there."""
        self.typed.add((page, words))
        return self._life.machine.run(f"{SUDO}cd {self.folder}\n{line(page, words)}", timeout_s=900)


def typed(life: Life) -> None:
    """The whole way."""
    typist = Typist(life)
    bundle.pack(life.built, life.machine.root / "root/skyfix-0.1.0-bundle.tar")
    _container_clock(life)
    _base(life, typist)
    _certificates(life, typist)
    _box(life, typist)
    _time(life, typist)
    _corrections(life, typist)
    signed(life)
    _back(life, typist)
    # deploy/README.md says the first three again; a test holds that they are the same lines.
    missing = {(page, words) for page, each in TYPED.items() for words in each} - typist.typed
    missing -= {("deploy/README.md", words) for words in TYPED["README.md"]}
    life.note("every line was typed", not missing, sorted(missing))


def _container_clock(life: Life) -> None:
    folder = life.machine.root / "etc/systemd/system/chrony.service.d"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "container.conf").write_text(NO_CLOCK)
    life.machine.run(f"ip address add {BASE}/24 dev lo; systemctl daemon-reload; systemctl restart chrony")


def _base(life: Life, typist: Typist) -> None:
    began_s = time.monotonic()
    done = typist.types("README.md", "tar xf")
    life.note("the bundle is unpacked", done.returncode == 0, done.stderr)
    installing_s = time.monotonic()
    base_is_there(life, typist.types("README.md", "install.sh base"))
    flying_s = time.monotonic()
    flight(life)
    size = life.machine.ask("du -s --block-size=1MB /opt/skyfix/current/ | cut -f1")
    parts = f"unpacked {installing_s - began_s:.0f} s, installed ({size} MB) {flying_s - installing_s:.0f} s"
    first = life.found("positions come out").found.partition("}")[0]
    load = f"this computer's load of the last minute {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    life.note("from a bare root to positions", True, f"{parts}, flight {first}}}; {load}")


def _certificates(life: Life, typist: Typist) -> None:
    page = "deploy/certs/README.md"
    done = [typist.types(page, words) for words in TYPED[page]]
    names = ("cam0", "mast", "base", "map")
    fine = all(one.returncode == 0 for one in done) and all(name in done[-1].stdout for name in names)
    life.note("certificates are made as the page says", fine, done[-1].stdout + "".join(one.stderr for one in done))


def _box(life: Life, typist: Typist) -> None:
    machine = life.machine
    done = typist.types("README.md", "install.sh edge")
    told = "does not run yet" in done.stderr and "correct /etc/skyfix/edge.toml, then: systemctl restart" in done.stderr
    life.note("a box is installed, and says what it lacks", done.returncode == 0 and told, done.stdout + done.stderr)
    text = (machine.root / "etc/skyfix/edge.toml").read_text()
    wanted = ('site = "hill"', 'id = "cam0"', f'connect = ["tls/{BASE}:7447"]')
    life.note("what was given stands in its configuration", all(each in text for each in wanted), text[:300])
    running, sources = machine.ask(CHRONY), machine.ask("chronyc -n sources")
    follows = running.startswith("active") and "skyfix.conf" in running and BASE in sources
    life.note("its clock follows the base", follows, f"{running} {sources}")
    film(machine.root / "var/lib/skyfix/film.avi")
    configure_box(machine, "hill")
    machine.run("systemctl restart edge-node")
    heard = machine.becomes(f'python3 -c "{ONLINE}"', "True", SETTLED_S)
    up = machine.ask("systemctl is-active base-station edge-node").split()
    life.note(
        "corrected as it says, it runs and is heard", heard and up == ["active"] * 2, machine.journal("edge-node")
    )


def _time(life: Life, typist: Typist) -> None:
    page, machine = "deploy/chrony/README.md", life.machine
    typist.folder = "/root/skyfix-0.1.0-bundle"
    ntp, pps, box, *checks = (typist.types(page, words) for words in TYPED[page])
    fine = "time: base-ntp" in ntp.stdout and "time was left as it was" in pps.stdout and f"box of {BASE}" in box.stdout
    fine = fine and all("clock" in check.stdout for check in checks)
    life.note("the lines of the page about time do what they say", fine, [one.stdout[-200:] for one in (ntp, pps, box)])
    # A pulse that is none: what there was before is in force again, and chronyd runs.
    done = machine.run("ln -s /dev/null /dev/pps0; /opt/skyfix/current/deploy/chrony/lay.sh base-pps; rm /dev/pps0")
    running, sources = machine.ask(CHRONY), machine.ask("chronyc -n sources")
    back = "what was there before is put back" in done.stdout + done.stderr and running.startswith("active")
    told = f"{done.stdout}{done.stderr}{running} {sources}"
    life.note("a time that chronyd cannot have is taken back", back and BASE in sources, told)


def _corrections(life: Life, typist: Typist) -> None:
    page, machine = "deploy/ntrip/README.md", life.machine
    (machine.root / "usr/bin/str2str").write_text(STR2STR)
    (machine.root / "usr/bin/str2str").chmod(0o755)
    done = [typist.types(page, words) for words in TYPED[page]]
    up = machine.becomes(HEARD, "1", SETTLED_S)
    mode = machine.ask("stat -c '%a %U' /etc/skyfix/ntrip.env")
    fine = up and mode == "600 skyfix" and not any(one.returncode for one in done)
    life.note("corrections run under their unit", fine, f"{mode}; {machine.journal('skyfix-ntrip')}")
    seen = machine.ask(SEEN)
    fine = seen == "0" and machine.ask("systemctl is-active skyfix-ntrip") == "active"
    life.note("nobody sees the caster's password", fine, f"{seen} command lines")


def _back(life: Life, typist: Typist) -> None:
    typist.folder = "/root"
    done = typist.types("deploy/README.md", "rollback")
    fine = done.returncode == 0 and life.state() == "0.1.0.2 active active"
    life.note("rollback does what the page says", fine, done.stdout[-300:] + done.stderr)
    done = typist.types("deploy/README.md", "uninstall")
    kept = life.machine.ask("ls /etc/skyfix/base.toml /var/lib/skyfix/network.toml; ls -d /opt/skyfix 2>/dev/null")
    running = life.machine.ask(CHRONY)
    fine = kept.split() == ["/etc/skyfix/base.toml", "/var/lib/skyfix/network.toml"]
    fine = fine and done.returncode == 0 and running.startswith("active") and "skyfix.conf" not in running
    life.note("uninstall does what the page says", fine, f"{kept} {running} {done.stderr}")

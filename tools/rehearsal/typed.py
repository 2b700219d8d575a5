"""What the pages tell a person to type, word for word, on the machines that they tell it of.

The hazard is a page that nobody follows. A machine has no internet, no receiver and no `sudo` here; the rest is as it
stands in README.md, deploy/README.md and those of certificates, time and corrections.
"""

import subprocess
from typing import Final

from tools.rehearsal.boxes import BASE, Field
from tools.rehearsal.life import SETTLED_S, Life
from tools.rehearsal.machine import Machine
from tools.rehearsal.pages import TYPED, line

SUDO: Final = 'sudo() { "$@"; }; '
# A container may not set the clock, so Debian's unit starts no chronyd in one: here it starts one that does not.
NO_CLOCK: Final = "[Unit]\nConditionCapability=\n[Service]\nExecStart=\nExecStart=!/usr/sbin/chronyd -x $DAEMON_OPTS\n"
CHRONY: Final = "systemctl is-active chrony; tr '\\0' ' ' </proc/$(systemctl show -P MainPID chrony)/cmdline"
STR2STR: Final = '#!/bin/sh\necho "str2str $*"\nexec sleep 1000\n'
STREAMS: Final = "journalctl --output=cat --unit=skyfix-ntrip | grep -c 'str2str -in ntrip://127.0.0.1:'"
# That of ntrip.example.env; the brackets keep this line from finding itself.
SEEN: Final = "cat /proc/[0-9]*/cmdline | tr '\\0' ' ' | grep -c ':[P]ASSWORD@'"
UNPACKED: Final = "/root/skyfix-0.1.0-bundle"


class Typist:
    """Types lines of pages in a machine, and remembers which."""

    def __init__(self) -> None:
        self._typed: set[tuple[str, str]] = set()

    def types(
        self, machine: Machine, page: str, words: str, folder: str = "/root"
    ) -> "subprocess.CompletedProcess[str]":
        """One line of a page, as it stands there."""
        self._typed.add((page, words))
        return machine.run(f"{SUDO}cd {folder}\n{line(page, words)}", timeout_s=900)

    def untyped(self) -> list[tuple[str, str]]:
        """What no machine was told."""
        missing = {(page, words) for page, each in TYPED.items() for words in each} - self._typed
        # deploy/README.md says the first three again; a test holds that they are the same lines.
        return sorted(missing - {("deploy/README.md", words) for words in TYPED["README.md"]})


def container_clock(machine: Machine) -> None:
    """A chronyd that runs in a container."""
    folder = machine.root / "etc/systemd/system/chrony.service.d"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "container.conf").write_text(NO_CLOCK)
    machine.run("systemctl daemon-reload; systemctl restart chrony")


def certificates(life: Life, typist: Typist) -> None:
    """An authority of one's own, by the page."""
    page = "deploy/certs/README.md"
    done = [typist.types(life.machine, page, words) for words in TYPED[page]]
    names = ("cam0", "mast", "base", "map")
    fine = all(one.returncode == 0 for one in done) and all(name in done[-1].stdout for name in names)
    life.note("certificates are made as the page says", fine, done[-1].stdout + "".join(one.stderr for one in done))


def time_of_site(there: Field, typist: Typist) -> None:
    """The base's lines on the base, the box's on a box; then a pulse that is none."""
    page, base, box = "deploy/chrony/README.md", there.life.machine, there.boxes["cam0"]
    running, sources = box.ask(CHRONY), box.ask("chronyc -n sources")
    follows = running.startswith("active") and "skyfix.conf" in running and BASE in sources
    there.life.note("its clock follows the base, which proves that it is the base", follows, f"{running} {sources}")
    typed = [(words, typist.types(box if "edge" in words else base, page, words, UNPACKED)) for words in TYPED[page]]
    ntp, pps, follow, *checks = (done.stdout for _, done in typed)
    fine = "time: base-ntp" in ntp and "time was left as it was" in pps and f"box of {BASE}" in follow
    fine = fine and all("clock" in check for check in checks)
    there.life.note(
        "the lines of the page about time do what they say", fine, [each[-200:] for each in (ntp, pps, follow)]
    )
    done = box.run("ln -s /dev/null /dev/pps0; /opt/skyfix/current/deploy/chrony/lay.sh base-pps; rm /dev/pps0")
    running, sources = box.ask(CHRONY), box.ask("chronyc -n sources")
    back = "what was there before is put back" in done.stdout + done.stderr and running.startswith("active")
    told = f"{done.stdout}{done.stderr}{running} {sources}"
    there.life.note("a time that chronyd cannot have is taken back", back and BASE in sources, told)


def corrections(there: Field, typist: Typist) -> None:
    """On a box, with a stand-in for RTKLIB's program."""
    page, box, life = "deploy/ntrip/README.md", there.boxes["cam0"], there.life
    (box.root / "usr/bin/str2str").write_text(STR2STR)
    (box.root / "usr/bin/str2str").chmod(0o755)
    done = [typist.types(box, page, words) for words in TYPED[page]]
    up = box.becomes(STREAMS, "1", SETTLED_S)
    mode = box.ask("stat -c '%a %U' /etc/skyfix/ntrip.env")
    fine = up and mode == "600 skyfix" and not any(one.returncode for one in done)
    life.note("corrections run under their unit", fine, f"{mode}; {box.journal('skyfix-ntrip')}")
    seen = box.ask(SEEN)
    fine = seen == "0" and box.ask("systemctl is-active skyfix-ntrip") == "active"
    life.note("nobody sees the caster's password", fine, f"{seen} command lines")


def back(life: Life, typist: Typist) -> None:
    """To the version before, and off."""
    machine = life.machine
    before = machine.ask("basename $(readlink /opt/skyfix/previous)")
    done = typist.types(machine, "deploy/README.md", "rollback")
    fine = done.returncode == 0 and life.state() == f"{before} active active"
    life.note("rollback does what the page says", fine, done.stdout[-300:] + done.stderr)
    laid = machine.ask("cd /opt/skyfix && ls -d 0.*").split()
    life.note("two versions are kept", len(laid) == 2 and before in laid, laid)
    done = typist.types(machine, "deploy/README.md", "uninstall")
    kept = machine.ask("ls /etc/skyfix/base.toml /var/lib/skyfix/network.toml; ls -d /opt/skyfix 2>/dev/null")
    running = machine.ask(CHRONY)
    fine = kept.split() == ["/etc/skyfix/base.toml", "/var/lib/skyfix/network.toml"]
    fine = fine and done.returncode == 0 and running.startswith("active") and "skyfix.conf" not in running
    life.note("uninstall does what the page says", fine, f"{kept} {running} {done.stderr}")

"""What the machine itself may be like: full, read-only, somebody else's, set to something on purpose."""

import time
from typing import Final

from tools.rehearsal.life import Life

# Says its version, as a real one does, and that it is too old.
FAKE_PYTHON: Final = "#!/bin/sh\ncase $2 in *print*) echo 3.9;; *) exit 1;; esac\n"
# All that a refused installation may leave: the lock, and the folder that it lies in.
LEFT: Final = "find /opt/skyfix /etc/skyfix /etc/systemd/system/edge-node.service -mindepth 1 ! -name .lock 2>/dev/null"


def trouble(life: Life) -> None:
    """On a bare machine."""
    folder = life.bring("0.1.0")
    _refusals(life, folder)
    _umask(life, folder)
    _twice_at_once(life, folder)
    _disabled(life, folder)
    _configuration(life, folder)
    _time(life, folder)


def _time(life: Life, folder: str) -> None:
    done = life.machine.run(f"{folder}/install.sh base --time pps", timeout_s=600)
    up = life.machine.ask("systemctl is-active base-station")
    told = done.returncode == 0 and "there is no /dev/pps0: time was left as it was" in done.stdout
    life.note("a receiver that is not there leaves a base that runs", told and up == "active", done.stdout[-300:])


def _refusals(life: Life, folder: str) -> None:
    machine = life.machine
    done = machine.run(f"mkdir -p /opt && mount -t tmpfs -o size=120M none /opt && {folder}/install.sh edge")
    machine.run("umount /opt")
    life.note("too little space is told in numbers", "MB are needed in /opt/skyfix, 1" in done.stderr, done.stderr)
    done = machine.run(f"mount -t tmpfs -o ro none /opt; {folder}/install.sh edge; umount /opt")
    life.note("a read-only disk is named", "/opt cannot be written (Read-only file system)" in done.stderr, done.stderr)
    fake = machine.root / "usr/local/bin/getconf"
    fake.write_text("#!/bin/sh\necho 32\n")
    done = machine.run(f"chmod +x /usr/local/bin/getconf; {folder}/install.sh edge; rm /usr/local/bin/getconf")
    life.note("a 32-bit system is told so", "this is a 32-bit system" in done.stderr, done.stderr)
    (machine.root / "usr/local/bin/python3").write_text(FAKE_PYTHON)
    old = f"chmod +x /usr/local/bin/python3; mv /usr/bin/python3.11 /usr/bin/p; {folder}/install.sh edge"
    done = machine.run(f"{old}; mv /usr/bin/p /usr/bin/python3.11; rm /usr/local/bin/python3")
    life.note(
        "an old Python is told with its version", "no Python 3.11 or later (found: 3.9)" in done.stderr, done.stderr
    )
    done = machine.run(f"echo damage >>{folder}/README.md; {folder}/install.sh edge; sed -i '$d' {folder}/README.md")
    life.note("a damaged bundle is named", "README.md is not what SHA256SUMS says" in done.stderr, done.stderr)
    nothing = machine.ask(LEFT)
    life.note("none of these left anything", not nothing, nothing)


def _umask(life: Life, folder: str) -> None:
    done = life.machine.run(f"umask 077; {folder}/install.sh router")
    up = life.machine.ask("systemctl is-active skyfix-router")
    life.note("umask 077 makes no programs that nobody reads", up == "active", done.stdout + done.stderr)


def _twice_at_once(life: Life, folder: str) -> None:
    first = life.machine.start(f"{folder}/install.sh base")
    time.sleep(1.5)
    second = life.machine.run(f"{folder}/install.sh base", timeout_s=600)
    told = first.communicate()[0]
    fine = first.returncode == 0 and second.returncode == 0 and "waiting for it" in second.stdout
    life.note("a second installer waits", fine and "laid already" in second.stdout, told[-200:] + second.stdout)
    both = life.machine.ask("systemctl is-active skyfix-router base-station")
    life.note("the role that was there goes on", both == "active\nactive", both)


def _disabled(life: Life, folder: str) -> None:
    life.machine.run("systemctl disable --now skyfix-router")
    done = life.install("0.4.0", "router --watch 3")
    now = life.machine.ask("systemctl is-enabled skyfix-router; systemctl is-active skyfix-router base-station")
    life.note(
        "what was disabled on purpose stays so", now.split() == ["disabled", "inactive", "active"], now + done.stdout
    )


def _configuration(life: Life, folder: str) -> None:
    life.machine.run(f"{folder}/install.sh edge --site hill --camera west --base 192.168.7.1 --no-start", timeout_s=600)
    text = (life.machine.root / "etc/skyfix/edge.toml").read_text()
    wanted = ('site = "hill"', 'id = "west"', 'connect = ["tls/192.168.7.1:7447"]')
    life.note("what is given stands in the configuration", all(line in text for line in wanted), text[:300])

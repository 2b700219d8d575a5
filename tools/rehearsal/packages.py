"""The Debian packages' life in a machine: installed offline, upgraded, downgraded, removed, purged, by apt's own means.

The hazard is the package whose scripts forget: a configuration that was edited, a calibration, a service that was
disabled, have to outlive every version.
"""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Final

from tools.debs.__main__ import all_of
from tools.rehearsal.bench import ONLINE, configure_box, film, flight
from tools.rehearsal.life import SETTLED_S, Life

APT: Final = "export DEBIAN_FRONTEND=noninteractive; cd /root/{folder} && apt-get -q --yes {more} install {files} 2>&1"
LATER: Final = "9.0.0"
EDITED: Final = "# somebody's own line\n"
KEPT: Final = "sha256sum /etc/skyfix/base.toml /etc/skyfix/mavlink.key /var/lib/skyfix/network.toml | sha256sum"
RUN: Final = "systemctl is-active base-station edge-node"
ASKED: Final = (
    "a base is installed by apt, offline",
    "its unit runs",
    "what debconf was told stands in its configuration",
    "positions come out",
    "nothing that it asks is forbidden",
    "a box is installed beside it by apt",
    "both run, and the base hears the box",
    "a later version is taken",
    "it keeps configuration and calibration",
    "the earlier version is taken back",
    "that keeps them too",
    "what was disabled on purpose stays so",
    "removed, the configuration stays",
    "purged, what was measured stays",
    "beside a bundle it is refused",
)


def built_debs(folder: Path, machine: str) -> Path:
    """The packages of this checkout and of a later version, below a folder."""
    folder.mkdir(exist_ok=True)
    for file in all_of(folder / "now", machine, "none"):
        renumbered(file, folder / "later", LATER)
    return folder


def renumbered(deb: Path, to: Path, version: str) -> Path:
    """The same package under another version."""
    tree = to / deb.stem
    tree.parent.mkdir(exist_ok=True)
    subprocess.run(["dpkg-deb", "--raw-extract", str(deb), str(tree)], check=True)
    control = tree / "DEBIAN/control"
    text = re.sub(r"^Version: .*$", f"Version: {version}", control.read_text(), flags=re.MULTILINE)
    control.write_text(re.sub(r"skyfix-common \(= .*?\)", f"skyfix-common (= {version})", text))
    made = to / re.sub(r"_.*_", f"_{version}_", deb.name)
    words = ["dpkg-deb", "--root-owner-group", "-Znone", "--build", str(tree), str(made)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    shutil.rmtree(tree)
    return made


def packages(life: Life) -> None:
    """The whole life. life.built: the folder of the packages."""
    shutil.copytree(life.built, life.machine.root / "root/debs")
    _first(life)
    flight(life)
    _box(life)
    _later(life)
    _disabled(life)
    _gone(life)


def _apt(life: Life, folder: str, *roles: str, more: str = "") -> "subprocess.CompletedProcess[str]":
    files = " ".join(f"./skyfix-{role}_*.deb" for role in roles)
    return life.machine.run(APT.format(folder=f"debs/{folder}", more=more, files=files), timeout_s=600)


def _tell(life: Life, package: str, **answers: str) -> None:
    lines = "\n".join(f"{package} {package}/{question} string {answer}" for question, answer in answers.items())
    life.machine.run(f"debconf-set-selections <<'END'\n{lines}\nEND")


def _first(life: Life) -> None:
    _tell(life, "skyfix-base", site="hill")
    done = _apt(life, "now", "common", "base")
    life.note("a base is installed by apt, offline", done.returncode == 0, done.stdout[-600:])
    up = life.machine.becomes("systemctl is-active base-station", "active", SETTLED_S)
    life.note("its unit runs", up, life.machine.journal("base-station"))
    name = life.machine.ask("grep -m1 ^name /etc/skyfix/base.toml")
    life.note("what debconf was told stands in its configuration", 'name = "hill"' in re.sub(" +", " ", name), name)


def _box(life: Life) -> None:
    _tell(life, "skyfix-box", site="hill", camera="west", base="192.168.7.1")
    film(life.machine.root / "var/lib/skyfix/film.avi")
    done = _apt(life, "now", "box")
    text = (life.machine.root / "etc/skyfix/edge.toml").read_text()
    given = all(word in text for word in ('"hill"', '"west"', '"tls/192.168.7.1:7447"'))
    life.note("a box is installed beside it by apt", done.returncode == 0 and given, done.stdout[-600:])
    configure_box(life.machine, "hill")
    life.machine.run("systemctl restart edge-node")
    heard = life.machine.becomes(f'python3 -c "{ONLINE}"', "True", SETTLED_S)
    run = life.machine.ask(RUN).split()
    fine = heard and run == ["active", "active"]
    life.note("both run, and the base hears the box", fine, life.machine.journal("edge-node"))


def _later(life: Life) -> None:
    machine = life.machine
    machine.run(f"printf '{EDITED.strip()}\\n' >>/etc/skyfix/base.toml; systemctl restart base-station")
    kept = machine.ask(KEPT)
    for folder, more, name, kept_name in (
        ("later", "", "a later version is taken", "it keeps configuration and calibration"),
        ("now", "--allow-downgrades", "the earlier version is taken back", "that keeps them too"),
    ):
        pids = machine.ask("systemctl show -P MainPID base-station edge-node")
        done = _apt(life, folder, "common", "base", "box", more=more)
        again = machine.becomes(RUN, "active\nactive", SETTLED_S)
        new = machine.ask("systemctl show -P MainPID base-station edge-node")
        anew = again and not set(pids.split()) & set(new.split())
        life.note(name, done.returncode == 0 and anew, f"{done.stdout[-300:]} {machine.ask(RUN)}")
        versions = machine.ask("dpkg-query --show --showformat='${Version} ' 'skyfix-*'")
        life.note(kept_name, machine.ask(KEPT) == kept, versions)


def _disabled(life: Life) -> None:
    life.machine.run("systemctl disable --now edge-node")
    done = _apt(life, "later", "common", "base", "box")
    now = life.machine.ask("systemctl is-enabled edge-node; systemctl is-active edge-node base-station").split()
    life.note(
        "what was disabled on purpose stays so", now == ["disabled", "inactive", "active"], f"{now} {done.stderr}"
    )


def _gone(life: Life) -> None:
    machine, apt = life.machine, "DEBIAN_FRONTEND=noninteractive apt-get -q --yes"
    done = machine.run(f"{apt} remove skyfix-base skyfix-box skyfix-common 2>&1")
    left = machine.ask("ls /etc/skyfix/base.toml; ls -d /usr/lib/skyfix-* /usr/bin/base-station 2>/dev/null")
    retries = machine.ask("cat /proc/sys/net/ipv4/tcp_retries2")
    fine = done.returncode == 0 and left == "/etc/skyfix/base.toml" and retries == "15"
    life.note("removed, the configuration stays", fine, f"{left} {retries} {done.stdout[-300:]}")
    done = machine.run(f"{apt} purge skyfix-base skyfix-box skyfix-common 2>&1")
    left = machine.ask("ls -d /etc/skyfix /var/lib/skyfix/network.toml 2>/dev/null")
    fine = done.returncode == 0 and left == "/var/lib/skyfix/network.toml"
    life.note("purged, what was measured stays", fine, f"{left} {done.stdout[-300:]}")
    machine.run("mkdir -p /opt/skyfix/0.1.0; ln -s 0.1.0 /opt/skyfix/current")
    done = _apt(life, "now", "common", "router")
    life.note("beside a bundle it is refused", done.returncode != 0 and "a bundle is installed here" in done.stdout, "")

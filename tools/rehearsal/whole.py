"""The life that CI lives through: a site of four machines by the pages' lines, and what becomes of its base.

From bare roots to positions over mutual TLS; then the base alone: a box beside it, a version that is broken, signed
ones, the way back, and off again.
"""

import os
import shutil
import time
from typing import Final

from tools import bundle
from tools.rehearsal import boxes as field
from tools.rehearsal import ptp, typed
from tools.rehearsal.bench import base_is_there, film
from tools.rehearsal.boxes import BUNDLE, Field
from tools.rehearsal.bundles import variant
from tools.rehearsal.life import SETTLED_S, WATCH_S, Life
from tools.rehearsal.signing import signed
from tools.rehearsal.typed import Typist

FIRST: Final = "cam0"  # the box that the pages name
GLANCE_S: Final = 2.0  # of the version that dies later,
DIES_AFTER_S: Final = 30.0  # so long after its start that on a busy computer it has come up before
PAUSED: Final = "cam1"
STOLEN: Final = "cam2"  # revoked; its successor is a box beside the base
PAGE: Final = (
    "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8080/', timeout=60).read().decode()[:100000])"
)
# The findings, by which tests know them before the life is lived.
ASKED: Final = (
    "boots",
    "the bundle is unpacked",
    "a base is installed",
    "the base runs",
    "the check after it finds no fault",
    "three boxes are installed, and say what they lack",
    "what each was given stands in its configuration",
    "the base hears every box",
    "positions come out",
    "from bare roots to positions",
    "nothing that they ask is forbidden",
    "the page is served",
    "its clock follows the base, which proves that it is the base",
    "the lines of the page about time do what they say",
    "a time that chronyd cannot have is taken back",
    "PTP is asked under the unit, and told",
    "corrections run under their unit",
    "nobody sees the caster's password",
    "what was disabled on purpose stays so",
    "a box that was revoked is heard no more",
    "certificates are made as the page says",
    "a box is installed beside the base",
    "both run",
    "the base hears it by a certificate of its own",
    "a broken version is refused",
    "what ran before runs again",
    "the broken one is gone",
    "no way back leads to it",
    "a signed bundle is taken, and its signers are kept",
    "a changed bundle is refused",
    "a stranger's bundle is refused",
    "an unsigned bundle is refused",
    "a bundle of the right signer is taken again",
    "one that died after it was watched is no way back",
    "rollback does what the page says",
    "two versions are kept",
    "uninstall does what the page says",
    "the kernel has its settings back",
    "it is removed without a rest",
    "every line was typed",
)


def whole(life: Life) -> None:
    """The whole way."""
    typist = Typist()
    bundle.pack(life.built, life.machine.root / BUNDLE)
    with field.boxes(life) as there:
        booted = ", ".join(f"{each.booted_s:.1f}" for each in (life.machine, *there.boxes.values()))
        life.note("boots", True, f"{booted} s; {life.machine.ask('systemctl --version').splitlines()[0]}")
        for machine in (life.machine, *there.boxes.values()):
            typed.container_clock(machine)
        _to_positions(there, typist)
        page = life.machine.ask(f'python3 -c "{PAGE}"')
        life.note("the page is served", "<html" in page and "nicegui" in page, page[:80])
        typed.time_of_site(there, typist)
        ptp.lay(there)
        ptp.followed(there)
        typed.corrections(there, typist)
        _disabled(there)
        field.revoked(there, STOLEN)
    typed.certificates(life, typist)
    _box_beside(life)
    _refused(life)
    _dies_later(life)
    typed.back(life, typist)
    _removed(life)
    missing = typist.untyped()
    life.note("every line was typed", not missing, missing)


def _to_positions(there: Field, typist: Typist) -> None:
    life, began_s = there.life, time.monotonic()
    done = typist.types(life.machine, "README.md", "tar xf")
    life.note("the bundle is unpacked", done.returncode == 0, done.stderr)
    base_is_there(life, typist.types(life.machine, "README.md", "install.sh base"))
    based_s = time.monotonic()
    field.carry(there)
    box = there.boxes[FIRST]
    typist.types(box, "README.md", "tar xf")
    there.said[FIRST] = typist.types(box, "README.md", "install.sh edge")
    field.install_others(there, FIRST)
    _boxes_are_there(there)
    installed_s = time.monotonic()
    field.flown(there)
    flown_s = time.monotonic()
    size = life.machine.ask("du -s --block-size=1MB /opt/skyfix/current/ | cut -f1")
    small = box.ask("du -s --block-size=1MB /opt/skyfix/current/ | cut -f1")
    parts = f"base ({size} MB) {based_s - began_s:.0f} s, three boxes ({small} MB) {installed_s - based_s:.0f} s"
    load = f"this computer's load of the last minute {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    told = f"{flown_s - began_s:.0f} s: {parts}, flight {flown_s - installed_s:.0f} s; {load}"
    life.note("from bare roots to positions", life.found("positions come out").came_true, told)
    field.forbidden(there)


def _boxes_are_there(there: Field) -> None:
    lacks = [
        done.returncode == 0
        and "does not run yet" in done.stderr
        and "correct /etc/skyfix/edge.toml, then: systemctl restart" in done.stderr
        for done in there.said.values()
    ]
    told = "".join(done.stdout[-500:] + done.stderr for done in there.said.values())
    there.life.note("three boxes are installed, and say what they lack", len(lacks) == 3 and all(lacks), told)
    given = []
    for camera, box in there.boxes.items():
        text = (box.root / "etc/skyfix/edge.toml").read_text()
        wanted = ('site = "hill"', f'id = "{camera}"', f'connect = ["tls/{field.BASE}:7447"]')
        given.append(all(each in text for each in wanted))
    there.life.note("what each was given stands in its configuration", all(given), given)


def _disabled(there: Field) -> None:
    """A box that somebody switched off for the winter, and upgrades with the others."""
    box = there.boxes[PAUSED]
    box.run("systemctl disable --now edge-node")
    done = box.run(f"{typed.UNPACKED}/install.sh edge --watch {GLANCE_S:g}", timeout_s=900)
    now = box.ask("systemctl is-enabled edge-node; systemctl is-active edge-node").split()
    fine = done.returncode == 0 and now == ["disabled", "inactive"]
    there.life.note("what was disabled on purpose stays so", fine, f"{now} {done.stdout[-300:]}")
    box.run("systemctl enable --now edge-node")


def _box_beside(life: Life) -> None:
    """The stolen box's successor is a camera on the base's own machine, with a certificate of its own."""
    machine = life.machine
    machine.run("cd /root/hill && base-station certs issue cam2 && cp certs/access.json /etc/skyfix/certs/")
    film(machine.root / "var/lib/skyfix/film.avi")
    config = machine.root / "root/hill/cam2/edge.toml"
    source = (
        'path = "/var/lib/skyfix/film.avi"\nrealtime = true\nloop = true\nt0_unix_ns = 1700000000000000000\nbound_s = 0'
    )
    config.write_text(config.read_text().replace('path = "/dev/video0"', source))
    shutil.rmtree(machine.root / "root/hill/cam2/certs")
    shutil.copytree(machine.root / "root/hill/certs/issued/cam2", machine.root / "root/hill/cam2/certs")
    (machine.root / "root/hill/cam2/cam2.lens.toml").write_text(
        'model = "radtan"\nintrinsics = [300.0, 300.0, 160.0, 120.0]\ndistortion = [0.0, 0.0, 0.0, 0.0]\n'
        "size_px = [320, 240]\nrms_px = 0.3\n"
    )
    words = f"skyfix-0.1.0-bundle/install.sh edge --from hill/cam2 --watch {WATCH_S:g}"
    done = machine.run(f"cd /root && {words}", timeout_s=900)
    life.note("a box is installed beside the base", done.returncode == 0, done.stdout + done.stderr)
    life.note("both run", life.state() == "0.1.0.2 active active", life.state())
    heard = machine.becomes(f'python3 -c "{field.HEARD}"', "cam2", SETTLED_S)
    own = machine.ask("head -1 /etc/skyfix/certs/certificate.pem /etc/skyfix/certs-edge/certificate.pem")
    life.note("the base hears it by a certificate of its own", heard, own + machine.journal("edge-node", 5))


def _refused(life: Life) -> None:
    """A version that refuses the configuration: what ran before runs again."""
    done = life.install("0.2.0", f"base --watch {WATCH_S:g}", "exit2")
    life.note("a broken version is refused", done.returncode == 1, done.stdout + done.stderr)
    life.note("what ran before runs again", life.state() == "0.1.0.2 active active", life.state())
    left = life.machine.ask("ls /opt/skyfix").split()
    life.note("the broken one is gone", left == ["0.1.0", "0.1.0.2", "current", "previous"], left)
    done = life.machine.run(f"/opt/skyfix/current/deploy/install.sh rollback --watch {WATCH_S:g}")
    life.note("no way back leads to it", life.state() == "0.1.0.2 active active", done.stdout + done.stderr)


def _dies_later(life: Life) -> None:
    """A version that came up while it was watched and died after: what comes next does not keep it to go back to."""
    variant(life.built, life.bundles / "0.2.1", "0.2.1", "late", after_s=DIES_AFTER_S)
    done = life.install("0.2.1", f"base --watch {GLANCE_S:g}")
    kept = done.returncode == 0 and life.state().startswith("0.2.1 ")
    died = life.machine.becomes(
        "journalctl --unit=base-station | grep -q 'Failed with result'; echo $?", "0", SETTLED_S
    )
    signed(life)
    told = "of 0.2.1 came up and did not stay" in life.told
    before = life.machine.ask("basename $(readlink /opt/skyfix/previous)")
    found = f"kept: {kept}, died: {died}, previous: {before}; {life.told[-300:]}"
    life.note(
        "one that died after it was watched is no way back", kept and died and told and before == "0.1.0.2", found
    )


def _removed(life: Life) -> None:
    """Nothing is left but what was asked to stay."""
    machine = life.machine
    # The kernel's own: 15, as no other file of this Debian's says anything of it.
    retries = machine.ask("cat /proc/sys/net/ipv4/tcp_retries2")
    life.note("the kernel has its settings back", retries == "15", retries)
    done = machine.run(f"{typed.UNPACKED}/install.sh uninstall --purge")
    units = machine.ask("systemctl list-unit-files --no-legend 'edge-node*' 'base-station*' 'skyfix*'")
    left = machine.ask(
        "ls -d /opt/skyfix /etc/skyfix /var/lib/skyfix /usr/local/bin/* 2>/dev/null; getent passwd skyfix"
    )
    life.note("it is removed without a rest", done.returncode == 0 and not left and not units, left + units)

"""PTP between two boxes, under their units: one leads, one follows, with time stamps of the kernel's.

The hazard is the question that a sandbox forbids: ptp4l is root's, `pmc` needs a socket of its own for the answer, and
the box's unit writes hardly anywhere. No clock is moved: all of these machines have this computer's.
"""

import re
import shutil
from pathlib import Path
from typing import Final

from tools.rehearsal.boxes import Field
from tools.rehearsal.life import SETTLED_S
from tools.rehearsal.pages import ROOT

# What `apt install linuxptp` brings of it, copied from this computer: the machines have no internet.
FILES: Final = ("usr/sbin/ptp4l", "usr/sbin/pmc", "lib/systemd/system/ptp4l@.service", "etc/linuxptp/ptp4l.conf")
# A wire that is none has no clock in hardware, and nobody's clock is to be set.
SETTINGS: Final = {
    "time_stamping": "software",
    "free_running": "1",
    "logSyncInterval": "-2",
    "logAnnounceInterval": "0",
}
LEADER, FOLLOWER = "cam0", "cam1"
PAGE: Final = ROOT / "deploy/chrony/PTP.md"
CLOCK: Final = '\n[clock]\nsource = "ptp"\n'
MEASURED: Final = "pmc -u -b 0 'GET CURRENT_DATA_SET' | grep -c 'meanPathDelay *[1-9]'"
# Under the unit's own sandbox and as its user, before its program: what `check` says goes to the unit's journal.
ASKING: Final = "[Service]\nExecStartPre=-/opt/skyfix/current/bin/edge-node check --config /etc/skyfix/edge.toml\n"


def _drop_in() -> str:
    """The page's lines that let edge-node ask ptp4l."""
    block = re.search(r"^sudo install -d .*?ptp4l@eth0$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    assert block is not None, f"{PAGE} no longer says how edge-node may ask"
    return block[0]


def lay(there: Field) -> None:
    """On both boxes: the daemon, the page's lines, and `[clock] source = "ptp"`."""
    for camera, priority in ((LEADER, "10"), (FOLLOWER, "200")):
        box = there.boxes[camera]
        for name in FILES:
            (box.root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(Path("/") / name, box.root / name)
        conf = box.root / "etc/linuxptp/ptp4l.conf"
        text = conf.read_text()
        for key, value in {**SETTINGS, "priority1": priority}.items():
            text = re.sub(rf"^{key}\s.*$", f"{key} {value}", text, flags=re.MULTILINE)
        conf.write_text(text)
        box.run(f'sudo() {{ "$@"; }}\nsystemctl daemon-reload; systemctl enable --now ptp4l@eth0\n{_drop_in()}')
        file = box.root / "etc/skyfix/edge.toml"
        file.write_text(file.read_text() + CLOCK)


def followed(there: Field) -> None:
    """Each box's own program, under its unit, says what it knows of the other's clock."""
    told = {}
    there.boxes[FOLLOWER].becomes(MEASURED, "1", SETTLED_S)
    for camera, said in ((FOLLOWER, "PTP within"), (LEADER, "this is the PTP grandmaster")):
        box = there.boxes[camera]
        folder = box.root / "etc/systemd/system/edge-node.service.d"
        folder.mkdir(exist_ok=True)
        (folder / "asking.conf").write_text(ASKING)
        box.run("systemctl daemon-reload; systemctl restart --no-block edge-node")
        asked = f"journalctl --output=cat --unit=edge-node | grep -m1 -o '{said}.*'"
        if not box.becomes(f"{asked} | cut -c-{len(said)}", said, SETTLED_S):
            told[camera] = f"NOT TOLD: {box.journal('edge-node', 30)} {box.journal('ptp4l@eth0')}"
        else:
            told[camera] = box.ask(asked)
    there.life.note("PTP is asked under the unit, and told", "NOT TOLD" not in str(told), told)

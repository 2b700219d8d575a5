"""What the pages tell a person to type on a machine, and which of it a life types word for word (`typed.py`)."""

import re
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
# By page, words that only one of its lines has. A line that differs in its comment only is the same line.
TYPED: Final = {
    "README.md": ("tar xf", "install.sh base", "install.sh edge"),
    "deploy/README.md": ("tar xf", "install.sh base", "install.sh edge", "rollback", "uninstall"),
    "deploy/certs/README.md": ("init hill", "issue cam0", "issue mast", "issue base", "issue map", "certs list"),
    "deploy/chrony/README.md": ("--time ntp", "--time pps", "install.sh edge", "edge-node check", "base-station check"),
    "deploy/ntrip/README.md": ("install -m 0600", "enable --now skyfix-ntrip"),
}
UNTYPED: Final = {
    "make bundle": "the machine has no internet; the bundle that is unpacked is made by what this runs",
    "sudo apt install rtklib": "the machine has no internet; a stand-in takes str2str's words",
    "sudo editor /etc/skyfix/ntrip.env": "a person's part",
}
NOT_OF_A_MACHINE: Final = {"README.md": "skyfix-0"}  # of that page only lines with these words are typed on a machine


def lines(page: str) -> list[str]:
    """The lines of a page's `sh` blocks that are for a machine, as they stand there."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)
    found = [line for block in blocks for line in block.splitlines() if line]
    return [line for line in found if NOT_OF_A_MACHINE.get(page, "") in line]


def line(page: str, words: str) -> str:
    """The one line of a page with these words. Raises ValueError if there is none, or another."""
    (found,) = (each for each in lines(page) if words in bare(each))
    return found


def bare(text: str) -> str:
    """A line without its comment."""
    return re.sub(r"\s+# .*$", "", text)

"""Which version is gone back to, and which is kept for it, when versions come up, stay, die late, or do not come up.

systemd is a stand-in, a program that tells what a file says: how versions really run is seen in tests/machine.
"""

import json
import os
import sys
import time
from pathlib import Path

import pytest

from deploy.installer import changeover, machine, services
from deploy.installer.changeover import Machine, change, roll_back
from deploy.installer.places import Places
from deploy.installer.telling import RefusedError
from deploy.installer.versions import Versions

UNIT = "edge-node"
UP = {"ActiveState": "active", "SubState": "running"}
SYSTEMCTL = """\
#!{python}
import json, sys
state = json.load(open("{file}"))
words = [word for word in sys.argv[1:] if not word.startswith("-")]
if words[0] == "show":
    here = state if words[1] == "edge-node.service" else dict()
    for name in (word.partition("=")[2] for word in sys.argv if word.startswith("--property=")):
        print(name + "=" + str(here.get(name, "")))
elif words[0] == "is-enabled":
    print("enabled" if words[1] == "edge-node.service" else "disabled")
"""


JOURNALCTL = """\
#!{python}
import json, sys, time
within_s = next(int(word[9:-2]) for word in sys.argv if word.startswith("--since=-")) / 1000
for when in json.load(open("{file}"))["failed_at"]:
    if time.time() - when < within_s:
        print("it failed")
"""


class Computer:
    """A machine with one box's service. dies: versions whose service does not come up."""

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.versions, self.dies = Versions(root / "opt/skyfix"), set[str]()
        self._state = root / "state.json"
        self._failed_at: list[float] = []
        self._places = Places(root)
        (root / "bin").mkdir()
        for name, text in (("systemctl", SYSTEMCTL), ("journalctl", JOURNALCTL)):
            (root / "bin" / name).write_text(text.format(python=sys.executable, file=self._state))
            (root / "bin" / name).chmod(0o755)
        monkeypatch.setenv("PATH", f"{root / 'bin'}{os.pathsep}{os.environ['PATH']}")
        monkeypatch.setattr(services, "booted", lambda: True)
        monkeypatch.setattr(services, "runs_from", lambda *_: self.versions.current if self._reads() else None)
        monkeypatch.setattr(services, "journal", lambda *_: "")
        monkeypatch.setattr(machine, "lay_units", lambda *_: None)
        monkeypatch.setattr(changeover.services, "come_up", self._come_up)
        self.is_now()

    def _come_up(self, units: list[str], _watched_s: float) -> dict[str, str]:
        current = self.versions.current
        assert current is not None
        if current.name in self.dies:
            self.is_now(ActiveState="failed", SubState="failed", failures=3)
            return dict.fromkeys(units, "failed (exit-code)")
        self.is_now(**UP)
        return {}

    def came_up_s_ago(self, ago_s: float) -> None:
        """The current version did."""
        assert self.versions.current is not None
        (self.versions.current / ".came-up").write_text(f"{time.time() - ago_s:.3f}\n")

    def is_now(self, failures: int = 0, **properties: object) -> None:
        """What systemd says of the service, and how often it has failed since."""
        self._failed_at += [time.time()] * failures
        told = {"failed_at": self._failed_at, "NRestarts": failures} | properties
        self._state.write_text(json.dumps(told))

    def _reads(self) -> bool:
        return bool(json.loads(self._state.read_text()).get("ActiveState") == "active")

    def lays(self, name: str, *, dies: bool = False) -> dict[str, str]:
        """Install a version."""
        folder = self.versions.prefix / name
        (folder / "bin").mkdir(parents=True, exist_ok=True)
        (folder / "bin/python").touch()
        (folder / ".roles").write_text("edge")
        if dies:
            self.dies.add(name)
        try:
            return change(Machine(self.versions, self._places), folder, [UNIT], lambda: True)
        finally:
            self.versions.prune()

    def rolls_back(self) -> None:
        roll_back(Machine(self.versions, self._places))

    @property
    def now(self) -> tuple[str | None, str | None]:
        """Current and previous."""
        both = (self.versions.current, self.versions.previous)
        return both[0] and both[0].name, both[1] and both[1].name


@pytest.fixture
def computer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Computer:
    made = Computer(tmp_path, monkeypatch)
    made.lays("1")
    made.is_now(**UP)
    return made


def test_one_that_stayed_is_kept_to_go_back_to(computer: Computer) -> None:
    computer.lays("2")
    assert computer.now == ("2", "1")
    computer.rolls_back()
    assert computer.now == ("1", "2")


@pytest.mark.parametrize(
    "dying",
    [
        {**UP, "failures": 1},
        {**UP, "failures": 5},
        {"ActiveState": "activating", "SubState": "auto-restart", "failures": 1},
        {"ActiveState": "activating", "SubState": "start", "failures": 3},
    ],
    ids=["once, at once", "again and again", "just now", "comes up again"],
)
def test_one_that_died_after_it_was_watched_is_not(computer: Computer, dying: dict[str, object]) -> None:
    computer.lays("2")
    computer.came_up_s_ago(100.0)
    computer.is_now(**dying)  # type: ignore[arg-type]
    computer.lays("3")
    assert computer.now == ("3", "1")
    assert [folder.name for folder in computer.versions.laid()] == ["1", "3"]


def test_what_follows_it_and_does_not_come_up_leads_back_to_the_one_that_stayed(computer: Computer) -> None:
    computer.lays("2")
    computer.came_up_s_ago(100.0)
    computer.is_now(**UP, failures=2)
    with pytest.raises(RefusedError, match="3 was not kept; 1 runs as before"):
        computer.lays("3", dies=True)
    assert computer.now == ("1", None)


def test_rolled_back_from_it_nothing_leads_to_it_again(computer: Computer) -> None:
    computer.lays("2")
    computer.came_up_s_ago(100.0)
    computer.is_now(**UP, failures=2)
    computer.rolls_back()
    assert computer.now == ("1", None)
    with pytest.raises(RefusedError, match="no version before"):
        computer.rolls_back()


@pytest.mark.parametrize(
    "once",
    [{"failures": 1}, {"failures": 0}, {"failures": 0, "NRestarts": 7}],
    ids=["a cable was pulled", "long ago", "ended as it was told to"],
)
def test_one_that_ran_for_days_and_died_now_and_then_stays_the_way_back(
    computer: Computer, once: dict[str, int]
) -> None:
    computer.lays("2")
    computer.came_up_s_ago(7 * 86400.0)
    computer.is_now(**UP, **once)  # type: ignore[arg-type]
    computer.lays("3")
    assert computer.now == ("3", "2")


def test_a_new_list_of_certificates_is_no_death(computer: Computer) -> None:
    """The listener is ended, and systemd starts it again, within minutes of the version's coming up."""
    computer.lays("2")
    computer.is_now(**UP, NRestarts=3)
    computer.lays("3")
    assert computer.now == ("3", "2")


def test_what_a_version_that_was_not_kept_died_of_is_not_charged_to_the_one_before(computer: Computer) -> None:
    computer.lays("2")
    with pytest.raises(RefusedError, match="3 was not kept; 2 runs as before"):
        computer.lays("3", dies=True)
    computer.lays("4")
    assert computer.now == ("4", "2")


def test_one_that_waits_for_a_person_is_not_blamed(computer: Computer) -> None:
    """Exit code 2: the configuration was edited into something wrong since."""
    computer.lays("2")
    computer.is_now(ActiveState="failed", SubState="failed", failures=1)
    computer.lays("3", dies=True)
    assert computer.now == ("3", "2")


def test_one_that_does_not_come_up_is_not_kept_at_all(computer: Computer) -> None:
    with pytest.raises(RefusedError, match="2 was not kept; 1 runs as before"):
        computer.lays("2", dies=True)
    assert computer.now == ("1", None)
    assert [folder.name for folder in computer.versions.laid()] == ["1"]

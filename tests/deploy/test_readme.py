"""Every line of the documents that calls the installer is one that it understands."""

import re
import shlex

import pytest

from deploy.installer.telling import RefusedError
from deploy.installer.words import parse
from tests.places import DEPLOY, ROOT

PAGES = [ROOT / "README.md", *DEPLOY.rglob("*.md")]
LINES = sorted(
    {
        found[1]
        for page in PAGES
        for found in re.finditer(r"^(?:sudo )?\S*install\.sh (.+)$", page.read_text(), re.MULTILINE)
    }
)


def test_there_are_such_lines() -> None:
    assert len(LINES) >= 4


@pytest.mark.parametrize("line", LINES)
def test_it_is_understood(line: str) -> None:
    assert parse(shlex.split(line, comments=True)).act in ("base", "edge", "router", "rollback", "uninstall")


@pytest.mark.parametrize("words", ["edge --base 192.168;rm", "base --site a/b", "edge --camera ''"])
def test_what_can_be_no_name_or_address_is_refused(words: str) -> None:
    with pytest.raises(RefusedError):
        parse(shlex.split(words))

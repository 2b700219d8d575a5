"""Every line of the documents that calls the installer is one that it understands."""

import re
import shlex

import pytest

from deploy.installer.telling import RefusedError
from deploy.installer.words import parse
from tests.places import DEPLOY, ROOT
from tools.rehearsal.pages import TYPED, UNTYPED, bare, line, lines

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


@pytest.mark.parametrize("page", TYPED)
def test_every_line_for_a_machine_is_typed_in_one_or_is_named_with_the_reason(page: str) -> None:
    """What types them is tests/machine/test_installed.py."""
    typed = {bare(line(page, words)) for words in TYPED[page]}
    assert {bare(each) for each in lines(page)} - typed - UNTYPED.keys() == set()


def test_what_two_pages_say_of_the_installation_is_the_same() -> None:
    for words in TYPED["README.md"]:
        assert bare(line("README.md", words)) == bare(line("deploy/README.md", words))

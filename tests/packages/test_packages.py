"""Packages live in a booted machine by apt's own means, offline, and are what Debian's own checker asks for.

One life is lived through (tools/rehearsal/packages.py); each test looks at one thing in it.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.packages.conftest import ROLES, Verdicts
from tools.rehearsal import debian
from tools.rehearsal.life import Life, lived
from tools.rehearsal.machine import CannotBoot
from tools.rehearsal.packages import ASKED, packages


@pytest.fixture(scope="module")
def life(debs: Path, verdicts: Verdicts, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Life]:
    """The life; skipped, with the reason, where no machine can be booted."""
    if reason := debian.missing():
        pytest.skip(reason)
    try:
        with lived(debian.make(), debs, tmp_path_factory.mktemp("life"), packages) as done:
            yield done
    except CannotBoot as reason:
        pytest.skip(str(reason))


@pytest.mark.program("systemd-nspawn", "mmdebstrap", "setpriv", "nsenter", "dpkg-deb")
@pytest.mark.parametrize("name", ASKED)
def test_it(life: Life, name: str) -> None:
    finding = life.found(name)
    assert finding.came_true, finding.found


@pytest.mark.program("lintian", "dpkg-deb")
@pytest.mark.parametrize("role", ROLES)
def test_lintian_finds_nothing_but_what_is_overridden_with_a_reason(verdicts: Verdicts, role: str) -> None:
    done = verdicts[role].result()
    assert (done.stdout.strip(), done.returncode) == ("", 0), done.stderr


def test_every_override_has_its_reason() -> None:
    for file in (Path(__file__).parents[2] / "deploy/debian").glob("*.overrides"):
        lines = file.read_text().splitlines()
        assert lines[0].startswith("# ")
        assert all(line.startswith(("# ", "@PACKAGE@: ")) for line in lines)

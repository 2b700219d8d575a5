"""Packages live in a booted machine by apt's own means, offline, and are what Debian's own checker asks for.

One life is lived through (tools/rehearsal/packages.py); each test looks at one thing in it.
"""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.rehearsal import debian
from tools.rehearsal.life import Life, lived
from tools.rehearsal.machine import CannotBoot
from tools.rehearsal.packages import ASKED, packages

# They are built without compression for the test's sake.
NOT_ASKED = "uses-no-compression-for-control-tarball,uses-no-compression-for-data-tarball"


@pytest.fixture(scope="module")
def life(debs: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Life]:
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
@pytest.mark.parametrize("role", ["common", "box", "base", "router"])
def test_lintian_finds_nothing_but_what_is_overridden_with_a_reason(debs: Path, role: str) -> None:
    (file,) = (debs / "now").glob(f"skyfix-{role}_*.deb")
    words = ["lintian", "--allow-root", "--suppress-tags", NOT_ASKED, "--tag-display-limit", "0", str(file)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("", 0), done.stderr


def test_every_override_has_its_reason() -> None:
    for file in (Path(__file__).parents[2] / "deploy/debian").glob("*.overrides"):
        lines = file.read_text().splitlines()
        assert lines[0].startswith("# ")
        assert all(line.startswith(("# ", "@PACKAGE@: ")) for line in lines)

"""What is installed is what is tested: booted machines, no internet, the bundle, programs under their units.

One life is lived through (tools/rehearsal/whole.py): a site of four machines, and what becomes of its base, by what the
pages tell a person to type, word for word. Each test looks at one thing in it.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.rehearsal import debian
from tools.rehearsal.life import Life, lived
from tools.rehearsal.machine import CannotBoot
from tools.rehearsal.whole import ASKED, whole

pytestmark = pytest.mark.program(
    "systemd-nspawn", "mmdebstrap", "setpriv", "nsenter", "ip", "ssh-keygen", "ptp4l", "pmc"
)


@pytest.fixture(scope="module")
def life(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Life]:
    """The life; skipped, with the reason, where no machine can be booted."""
    try:
        with lived(debian.make(), built, tmp_path_factory.mktemp("bundles"), whole) as done:
            yield done
    except CannotBoot as reason:
        pytest.skip(str(reason))


@pytest.mark.parametrize("name", ASKED)
def test_it(life: Life, name: str) -> None:
    finding = life.found(name)
    assert finding.came_true, finding.found

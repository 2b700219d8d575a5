"""What the pages tell a person to type does what they say, in a booted machine without a network: word for word.

The life of tools/rehearsal/typed.py, 3 to 4 minutes on two cores; each test looks at one thing in it.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.rehearsal import debian
from tools.rehearsal.life import Life, lived
from tools.rehearsal.machine import CannotBoot
from tools.rehearsal.typed import ASKED, typed

pytestmark = pytest.mark.program("systemd-nspawn", "mmdebstrap", "setpriv", "nsenter", "ssh-keygen")


@pytest.fixture(scope="module")
def life(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Life]:
    """The life; skipped, with the reason, where no machine can be booted."""
    try:
        with lived(debian.make(), built, tmp_path_factory.mktemp("bundles"), typed) as done:
            yield done
    except CannotBoot as reason:
        pytest.skip(str(reason))


@pytest.mark.parametrize("name", ASKED)
def test_it(life: Life, name: str) -> None:
    finding = life.found(name)
    assert finding.came_true, finding.found

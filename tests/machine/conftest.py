"""What the tests of installed machines share: the bundle, built once, and the bare Debian."""

from pathlib import Path

import pytest

from tools import bundle
from tools.rehearsal import debian


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle's folder; skipped, with the reason, where no machine can be booted."""
    if reason := debian.missing():
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("built")
    bundle.lay_out(folder, [bundle.this_machine()], [debian.PYTHON])
    return folder

"""The Debian packages of this checkout and of a later version, built once: minutes, so `make test` is without them."""

from pathlib import Path

import pytest

from tools.bundle import this_machine
from tools.rehearsal.packages import built_debs


@pytest.fixture(scope="session")
def debs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `now` and `later`."""
    return built_debs(tmp_path_factory.mktemp("debs"), this_machine())

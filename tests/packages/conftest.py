"""The Debian packages of this checkout and of a later version, built once: minutes, so `make test` is without them."""

import subprocess
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.foreign import missing
from tools.bundle import this_machine
from tools.rehearsal.packages import built_debs

ROLES = ("common", "box", "base", "router")
# They are built without compression for the test's sake.
NOT_ASKED = "uses-no-compression-for-control-tarball,uses-no-compression-for-data-tarball"
Verdicts = dict[str, "Future[subprocess.CompletedProcess[str]]"]


@pytest.fixture(scope="session")
def debs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `now` and `later`."""
    return built_debs(tmp_path_factory.mktemp("debs"), this_machine())


@pytest.fixture(scope="session")
def verdicts(debs: Path) -> Iterator[Verdicts]:
    """What Debian's own checker says of each package; it works for minutes, beside a life that mostly waits."""

    def judge(role: str) -> "subprocess.CompletedProcess[str]":
        (file,) = (debs / "now").glob(f"skyfix-{role}_*.deb")
        words = ["lintian", "--allow-root", "--suppress-tags", NOT_ASKED, "--tag-display-limit", "0", str(file)]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    with ThreadPoolExecutor(1) as one_by_one:
        yield {} if missing("lintian") else {role: one_by_one.submit(judge, role) for role in ROLES}

"""The Containerfile makes a container that starts: of the bundle and the bare Debian, without a registry.

buildah runs its steps in a chroot, so that this works inside a container too. No machine is booted.
"""

import json
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.places import DEPLOY
from tests.programs import options, parsers
from tools.rehearsal import debian

FILE = DEPLOY / "Containerfile"
LISTENS_WITHIN_S = 60.0  # Python from a cold disk, on a busy computer


def test_what_it_starts_is_a_command_that_exists() -> None:
    entry = json.loads(re.findall(r"^ENTRYPOINT (.+)$", FILE.read_text(), re.MULTILINE)[0])[2]
    for word in re.findall(r"word=(\w+)", entry):
        assert ("base-station", word) in parsers()
        assert "--config" in options(("base-station", word))


@pytest.fixture
def storage(tmp_path: Path) -> Iterator[list[str]]:
    """buildah with images of its own, the bare Debian among them."""
    words = ["buildah", "--root", str(tmp_path / "images"), "--runroot", str(tmp_path / "run"), "--storage-driver=vfs"]

    def do(*more: str) -> str:
        return subprocess.run([*words, *more], check=True, capture_output=True, text=True).stdout.strip()

    bare = do("from", "scratch")
    do("add", "--quiet", bare, str(debian.make()), "/")
    do("commit", "--quiet", "--rm", bare, "localhost/bare")
    yield words
    do("rm", "--all")
    do("rmi", "--all", "--force")


@pytest.mark.program("buildah", "unshare", "mmdebstrap")
def test_a_router_is_built_and_listens(built: Path, storage: list[str]) -> None:
    build = [*storage, "build", "--isolation=chroot", "--pull-never", "--build-arg=BASE=localhost/bare"]
    build += ["--build-arg=ROLE=router", "--tag=localhost/router", f"--file={FILE}", str(built)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    begin = [*storage, "from", "--pull-never", "localhost/router"]
    container = subprocess.run(begin, check=True, capture_output=True, text=True).stdout.strip()
    look = [*storage, "inspect", "--format", "{{index .OCIv1.Config.Entrypoint 2}}", container]
    entry = subprocess.run(look, check=True, capture_output=True, text=True).stdout.strip()
    run = [*storage, "run", "--isolation=chroot", container, "--", "/bin/sh", "-c", entry]
    with subprocess.Popen(["unshare", "--net", "--pid", "--fork", "--kill-child", "--mount-proc", *run]) as running:
        try:
            assert listens(running.pid)
        finally:
            running.kill()


def listens(pid: int) -> bool:
    """Whether somebody listens on Zenoh's port in the namespace of what a process started."""
    deadline_s = time.monotonic() + LISTENS_WITHIN_S
    port = f":{7447:04X} "
    while time.monotonic() < deadline_s:
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            if port in Path(f"/proc/{child}/net/tcp").read_text():
                return True
        time.sleep(0.2)
    return False

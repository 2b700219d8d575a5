"""The bundle takes exactly what the lock file names."""

import hashlib
from pathlib import Path

import pytest

from deploy.installer.places import ROLES
from tests.places import ROOT
from tools.bundle import EXTRAS, pins, refuse_strangers

CONTENT = b"a wheel"
LOCK = f"""# comment
some-thing.x==1.2.3 \\
    --hash=sha256:{hashlib.sha256(CONTENT).hexdigest()}
    # via skyfix
other==4 ; python_version < "3.12" \\
    --hash=sha256:{"0" * 64}
"""


def test_pins_are_versions_without_hashes() -> None:
    assert pins(LOCK) == "some-thing.x==1.2.3\nother==4\n"


def test_every_package_of_the_lock_file_is_pinned_with_hashes() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    assert len(pins(lock).splitlines()) > 50
    for block in lock.split("\n# The following")[0].replace("\\\n", "").splitlines():
        if block and not block.lstrip().startswith("#"):
            assert "--hash=sha256:" in block, block
    assert "--index-url" not in lock
    assert "://" not in lock


def test_a_wheel_that_is_not_the_lock_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "some_thing.x-1.2.3-py3-none-any.whl").write_bytes(CONTENT)
    (tmp_path / "skyfix-1-py3-none-any.whl").write_bytes(b"ours")
    refuse_strangers(tmp_path, LOCK)
    (tmp_path / "other-4-py3-none-any.whl").write_bytes(b"somebody else's")
    with pytest.raises(SystemExit, match="other-4"):
        refuse_strangers(tmp_path, LOCK)


def test_the_bundle_has_every_extra_that_the_installer_asks_for() -> None:
    """A base without `page` has no operator's page, one without `certs` no certificates."""
    asked = {extra for role in ROLES.values() for extra in role.extras}
    assert {"box", "base", "page", "certs"} == asked == set(EXTRAS.split(","))

"""The bundle takes exactly what the lock file names."""

import hashlib
from pathlib import Path

import pytest

from tools.bundle import pins, refuse_strangers

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


def test_a_wheel_that_is_not_the_lock_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "some_thing.x-1.2.3-py3-none-any.whl").write_bytes(CONTENT)
    (tmp_path / "skyfix-1-py3-none-any.whl").write_bytes(b"ours")
    refuse_strangers(tmp_path, LOCK)
    (tmp_path / "other-4-py3-none-any.whl").write_bytes(b"somebody else's")
    with pytest.raises(SystemExit, match="other-4"):
        refuse_strangers(tmp_path, LOCK)

"""A bundle that is damaged, unsigned, or signed by somebody else is not taken."""

import hashlib
import subprocess
import tarfile
from pathlib import Path

import pytest

from deploy.installer.source import Source, check_signature, open_source, remember_signers, unpack
from deploy.installer.telling import RefusedError
from tools.bundle import sign


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    folder = tmp_path / "bundle"
    (folder / "wheels").mkdir(parents=True)
    (folder / "wheels/skyfix-1.2.3-py3-none-any.whl").write_bytes(b"wheel")
    digest = hashlib.sha256(b"wheel").hexdigest()
    (folder / "SHA256SUMS").write_text(f"{digest}  wheels/skyfix-1.2.3-py3-none-any.whl\n")
    return folder


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "etc").mkdir()
    return tmp_path / "etc"


def key(folder: Path, name: str) -> Path:
    words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "", "-f", str(folder / name)]
    subprocess.run(words, check=True)
    return folder / name


def test_a_whole_bundle_is_known_by_its_version(tree: Path) -> None:
    found = open_source(tree)
    assert (found.version, found.is_bundle) == ("1.2.3", True)


def test_a_file_with_other_bytes_is_named(tree: Path) -> None:
    (tree / "wheels/skyfix-1.2.3-py3-none-any.whl").write_bytes(b"whee!")
    with pytest.raises(RefusedError, match=r"damaged: wheels/skyfix.*copy it again"):
        open_source(tree)


def test_a_file_that_is_gone_is_named(tree: Path) -> None:
    (tree / "wheels/skyfix-1.2.3-py3-none-any.whl").unlink()
    with pytest.raises(RefusedError, match="damaged: wheels/skyfix"):
        open_source(tree)


def test_a_folder_that_is_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="no version found"):
        open_source(tmp_path)


def test_a_tar_is_unpacked_and_a_cut_one_refused(tree: Path, tmp_path: Path) -> None:
    archive = tmp_path / "a bundle.tar"
    with tarfile.open(archive, "w") as tar:
        tar.add(tree, "skyfix-1.2.3-bundle")
    (tmp_path / "out").mkdir()
    assert open_source(unpack(archive, tmp_path / "out")).version == "1.2.3"
    archive.write_bytes(archive.read_bytes()[:700])
    with pytest.raises(RefusedError, match="cannot be unpacked"):
        unpack(archive, tmp_path / "out")


@pytest.mark.program("ssh-keygen")
def test_signers_are_learnt_once_and_held_to(tree: Path, config: Path, tmp_path: Path) -> None:
    sign(tree, key(tmp_path, "ours"))
    first = open_source(tree)
    check_signature(first, config, None, unsigned=False)  # nobody is known yet
    remember_signers(first, config)
    check_signature(open_source(tree), config, None, unsigned=False)
    sign(tree, key(tmp_path, "theirs"))
    with pytest.raises(RefusedError, match="signature is nobody's"):
        check_signature(first, config, None, unsigned=False)
    remember_signers(first, config)
    with pytest.raises(RefusedError, match="signature is nobody's"):
        check_signature(first, config, None, unsigned=False)
    check_signature(first, config, None, unsigned=True)


@pytest.mark.program("ssh-keygen")
def test_an_unsigned_bundle_is_refused_where_signers_are_known(tree: Path, config: Path, tmp_path: Path) -> None:
    ours = key(tmp_path, "ours")
    signers = config / "bundle.signers"
    signers.write_text("skyfix " + ours.with_suffix(".pub").read_text())
    with pytest.raises(RefusedError, match="not signed"):
        check_signature(open_source(tree), config, None, unsigned=False)


def test_a_file_of_signers_that_is_not_there_is_told(tree: Path, config: Path) -> None:
    with pytest.raises(RefusedError, match="not there"):
        check_signature(Source(tree, True, "1"), config, config / "nobody", unsigned=False)

"""Where a version comes from: a bundle, its folder or its tar file, or a source tree with the internet.

A bundle has `wheels`, and SHA256SUMS of every file of it; SHA256SUMS.sig is that list's signature. Who may sign is
learnt from the first bundle that brings `signers`, and kept in /etc/skyfix: from then on nothing else is taken.
"""

import hashlib
import re
import shutil
import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .telling import RefusedError, say

SUMS: Final = "SHA256SUMS"
SIGNERS: Final = "bundle.signers"
SIGNED_AS: Final = "skyfix-bundle"  # the namespace of `ssh-keygen -Y`: a signature for another purpose is none here


@dataclass(frozen=True)
class Source:
    """A tree with the programs, the units and the templates. is_bundle: with wheels, for a machine without internet."""

    tree: Path
    is_bundle: bool
    version: str

    @property
    def wheels(self) -> Path:
        """The bundle's wheels."""
        return self.tree / "wheels"

    @property
    def digest(self) -> str:
        """What is in it, in one word; empty for a source tree, which is never taken for the same again."""
        return hashlib.sha256((self.tree / SUMS).read_bytes()).hexdigest() if self.is_bundle else ""


def unpack(archive: Path, folder: Path) -> Path:
    """A bundle's tar file, into a folder; its tree. Raises RefusedError."""
    try:
        with tarfile.open(archive) as tar:
            tar.extractall(folder, filter="data")
    except (OSError, tarfile.TarError) as error:
        raise RefusedError(
            f"{archive} cannot be unpacked ({error})", "give the path of skyfix-<version>-bundle.tar"
        ) from None
    return next((one.parent for one in folder.glob(f"*/{SUMS}")), folder)


def open_source(tree: Path) -> Source:
    """What lies there. Raises RefusedError if it is damaged, or neither a bundle nor a source tree."""
    if (tree / SUMS).exists():
        _check_sums(tree)
        wheel = next(tree.glob("wheels/skyfix-*.whl"), None)
        if wheel is not None:
            return Source(tree, True, wheel.name.split("-")[1])
    package = tree / "edge/__init__.py"
    found = re.search(r'^__version__ = "(.+)"', package.read_text(), re.MULTILINE) if package.exists() else None
    if found is None:
        raise RefusedError(f"no version found in {tree}", "use the bundle, unpacked, or a complete source tree")
    return Source(tree, False, found[1])


def _check_sums(tree: Path) -> None:
    """Raises RefusedError naming the first file that is not what it was when the bundle was made."""
    for line in (tree / SUMS).read_text().splitlines():
        wanted, _, name = line.partition("  ")
        file = tree / name
        if not file.is_file() or _hash(file) != wanted:
            raise RefusedError(f"the bundle is damaged: {name} is not what {SUMS} says", "copy it again")


def _hash(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def check_signature(source: Source, config: Path, given: Path | None, *, unsigned: bool) -> None:
    """Who made it is who may, where the machine knows who may. Raises RefusedError."""
    known = given or config / SIGNERS
    if not source.is_bundle or unsigned:
        return
    if not known.exists():
        if given is not None:
            raise RefusedError(f"{given} is not there", "give the file of allowed signers", 2)
        return
    if shutil.which("ssh-keygen") is None:
        raise RefusedError("the bundle's signature cannot be checked", "apt install openssh-client, or give --unsigned")
    signature = source.tree / f"{SUMS}.sig"
    if not signature.exists():
        raise RefusedError(
            f"the bundle is not signed, and {known} says who must", "ask for a signed one, or give --unsigned"
        )
    words = ["ssh-keygen", "-Y", "verify", "-f", str(known), "-I", "skyfix", "-n", SIGNED_AS, "-s", str(signature)]
    with (source.tree / SUMS).open("rb") as sums:
        done = subprocess.run(words, stdin=sums, capture_output=True, text=True, check=False)
    if done.returncode:
        told = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise RefusedError(f"the bundle's signature is nobody's in {known} ({' '.join(told)})", "ask whoever sent it")
    say(f"signed by one of {known}")


def remember_signers(source: Source, config: Path) -> None:
    """The first bundle that says who signs is believed; nothing is changed later."""
    offered, known = source.tree / "signers", config / SIGNERS
    if source.is_bundle and offered.exists() and not known.exists():
        shutil.copyfile(offered, known)
        say(f"from now on only bundles signed as {known} says are taken")

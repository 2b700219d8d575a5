"""One Debian package: control file, scripts, documents and checksums round a tree of files."""

import gzip
import shutil
import subprocess
from dataclasses import dataclass
from email.utils import formatdate
from pathlib import Path
from typing import Final

from edge import __version__
from tools.bundle import ROOT

SCRIPTS: Final = ROOT / "deploy/debian"
MAINTAINER: Final = "Skyfix <skyfix@localhost>"
COMPRESSED: Final = "xz"  # what every Debian's tools read; lintian of Debian 12 knows no zstd
NEWS: Final = """\
{name} ({version}) unstable; urgency=medium

  * What changed is told in skyfix-common's CHANGELOG.md.gz.

 -- {maintainer}  {date}
"""
LONG: Final = """\
 A few ordinary cameras on tripods find a flying object that nobody cooperates
 with, and say in WGS 84 where it is: live, with a true uncertainty, as MAVLink.
 .
 {what}
"""
COPYRIGHT: Final = """\
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: skyfix
Comment: The licences of the libraries below /usr/lib/skyfix-* are in each one's
 dist-info folder there.

Files: *
Copyright: 2025 the Skyfix authors
License: Apache-2.0
 On Debian systems the full text of the Apache License, version 2.0, is in
 /usr/share/common-licenses/Apache-2.0.
"""


@dataclass(frozen=True)
class Package:
    """What its control file says. short, what: the first and the last line of its description."""

    name: str
    architecture: str
    depends: str
    short: str
    what: str

    def control(self, size_kb: int) -> str:
        """The control file."""
        return (
            f"Package: {self.name}\nVersion: {__version__}\nArchitecture: {self.architecture}\n"
            f"Maintainer: {MAINTAINER}\nInstalled-Size: {size_kb}\nDepends: {self.depends}\n"
            f"Section: science\nPriority: optional\nDescription: {self.short}\n{LONG.format(what=self.what)}"
        )


def documents(root: Path, name: str, kind: str) -> None:
    """Copyright, changelog, and what lintian is told not to mind, with the reason."""
    folder = root / "usr/share/doc" / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "copyright").write_text(COPYRIGHT)
    news = NEWS.format(name=name, version=__version__, maintainer=MAINTAINER, date=formatdate(_committed_s()))
    _zip(folder / "changelog.gz", news.encode())
    if kind == "common":
        _zip(folder / "CHANGELOG.md.gz", (ROOT / "CHANGELOG.md").read_bytes())
    target = root / "usr/share/lintian/overrides" / name
    target.parent.mkdir(parents=True)
    target.write_text((SCRIPTS / f"{kind}.overrides").read_text().replace("@PACKAGE@", name))


def _committed_s() -> int:
    """When the checkout's last commit was made: the same checkout gives the same bytes."""
    words = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    return int(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def _zip(target: Path, content: bytes) -> None:
    with gzip.GzipFile(target, "wb", 9, mtime=0) as file:
        file.write(content)


def scripts(root: Path, kind: str, words: dict[str, str]) -> None:
    """What dpkg runs, of a kind of package, with these words in their places."""
    folder = root / "DEBIAN"
    folder.mkdir()
    for file in sorted(SCRIPTS.glob(f"{kind}.*")):
        name = file.suffix.removeprefix(".")
        if name == "overrides":
            continue
        text = file.read_text()
        for word, value in words.items():
            text = text.replace(f"@{word}@", value)
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)


def build(root: Path, to: Path, package: Package, compressed: str = COMPRESSED) -> Path:
    """The .deb, in a folder. compressed: as dpkg-deb's -Z; "none" is quick."""
    own = root / "DEBIAN"
    files = sorted(path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    files = [path for path in files if not path.is_relative_to(own)]
    (own / "control").write_text(package.control(sum(path.stat().st_size for path in files) // 1024))
    names = "\0".join(str(path.relative_to(root)) for path in files)
    summed = ["xargs", "--null", "md5sum", "--"]
    sums = subprocess.run(summed, cwd=root, check=True, input=names, capture_output=True, text=True).stdout
    (own / "md5sums").write_text(sums)
    for path in (root, *root.rglob("*")):
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o755)
    to.mkdir(exist_ok=True)
    archive = to / f"{package.name}_{__version__}_{package.architecture}.deb"
    words = ["dpkg-deb", "--root-owner-group", f"-Z{compressed}", "--build", str(root), str(archive)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return archive


def copy(source: str, target: Path) -> None:
    """A file of the checkout."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / source, target)

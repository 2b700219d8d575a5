"""Build the offline bundle: everything `deploy/install.sh --offline` needs on a machine that has no internet.

    python -m tools.bundle                      dist/skyfix-<version>-bundle.tar, for x86-64 and arm64
    python -m tools.bundle --machine x86_64     for one of them
    python -m tools.bundle --python 3.13        for another Python than Debian 12's
    python -m tools.bundle --sign KEY           signed with an SSH key; machines that took one take only its like

Wheels of exactly the versions and hashes in requirements.lock, the installer, units, configuration templates, and a
checksum of each file. The same tree gives the same bytes.
"""

import argparse
import hashlib
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final

from deploy.installer.source import SIGNED_AS, SUMS
from edge import __version__

ROOT: Final = Path(__file__).parents[1]
# The oldest C library of the wheels; Debian 12 and Raspberry Pi OS have 2.36.
PLATFORMS: Final = {
    machine: [f"manylinux_2_{minor}_{machine}" for minor in (17, 27, 28, 31, 34)] + [f"manylinux2014_{machine}"]
    for machine in ("x86_64", "aarch64")
}
SOURCES: Final = ("edge", "calib", "pyproject.toml", "README.md", "LICENSE")
EXTRAS: Final = "box,base,page,certs"  # what the installer asks for, of a box or of a base
CARRIED: Final = ("deploy", "systemd", "README.md", "LICENSE", "CHANGELOG.md")
LEFT_OUT: Final = shutil.ignore_patterns("__pycache__", "*.pyc")


def build_wheel(folder: Path) -> Path:
    """Our own wheel, from a copy: a build folder left over from yesterday would put yesterday's files into it."""
    with tempfile.TemporaryDirectory() as temporary:
        for name in SOURCES:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, Path(temporary) / name, ignore=LEFT_OUT)
            else:
                shutil.copy2(source, temporary)
        _pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), temporary)
    return next(folder.glob("skyfix-*.whl"))


def download(folder: Path, wheel: Path, machine: str, python: str) -> None:
    """Every wheel that box and base need on one kind of machine, and pip itself for a Python without it."""
    platforms = [word for name in PLATFORMS[machine] for word in ("--platform", name)]
    lock = (ROOT / "requirements.lock").read_text()
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as constraints:
        constraints.write(pins(lock))
        constraints.flush()
        _pip(
            *("download", "--dest", str(folder), "--only-binary=:all:", "--python-version", python, *platforms),
            *("--constraint", constraints.name, f"{wheel}[{EXTRAS}]", "pip"),
        )
    refuse_strangers(folder, lock)


def pins(lock: str) -> str:
    """The versions of a lock file without the hashes: pip takes no constraint with hashes beside a wheel of our own."""
    return "".join(f"{pin}\n" for pin in re.findall(r"^[\w.-]+==[^\s\\]+", lock, re.MULTILINE))


def refuse_strangers(folder: Path, lock: str) -> None:
    """Raises SystemExit naming a wheel that is not one of the lock file's. Ours, and pip, are not in it."""
    known = set(re.findall(r"--hash=sha256:([0-9a-f]{64})", lock))
    for wheel in sorted(folder.glob("*.whl")):
        ours = wheel.name.startswith(("skyfix-", "pip-"))
        if not ours and hashlib.sha256(wheel.read_bytes()).hexdigest() not in known:
            raise SystemExit(
                f"{wheel.name}: its hash is not in requirements.lock; run `make lock` and look at the change"
            )


def this_machine() -> str:
    """The kind of this computer, as a bundle names it."""
    return {"arm64": "aarch64"}.get(platform.machine(), platform.machine())


def _pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, check=True, cwd=ROOT)


def lay_out(folder: Path, machines: list[str], pythons: list[str]) -> None:
    """The bundle's tree."""
    wheels = folder / "wheels"
    wheels.mkdir()
    wheel = build_wheel(wheels)
    for machine in machines:
        for python in pythons:
            download(wheels, wheel, machine, python)
    for name in CARRIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=LEFT_OUT)
        else:
            shutil.copy2(source, folder / name)
    shutil.copy2(ROOT / "deploy" / "install.sh", folder / "install.sh")
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    (folder / SUMS).write_text("".join(_sum(path, folder) for path in files))


def sign(folder: Path, key: Path) -> None:
    """Sign the list of checksums, and say with which key: `ssh-keygen -Y`, as the installer verifies it."""
    public = key.with_name(f"{key.name}.pub").read_text().split()
    signers = folder / "signers"
    signers.write_text(f'skyfix namespaces="{SIGNED_AS}" {" ".join(public[:2])}\n')
    with (folder / SUMS).open("a") as sums:
        sums.write(_sum(signers, folder))
    words = ["ssh-keygen", "-q", "-Y", "sign", "-f", str(key), "-n", SIGNED_AS, str(folder / SUMS)]
    subprocess.run(words, check=True)


def _sum(file: Path, folder: Path) -> str:
    return f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.relative_to(folder)}\n"


def pack(folder: Path, archive: Path) -> None:
    """One tar file: sorted, without owners and times, so that the same tree gives the same bytes."""

    def anonymous(entry: tarfile.TarInfo) -> tarfile.TarInfo:
        entry.uid = entry.gid = entry.mtime = 0
        entry.uname = entry.gname = "root"
        entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
        return entry

    archive.parent.mkdir(exist_ok=True)
    with tarfile.open(archive, "w") as tar:
        for path in sorted(folder.rglob("*")):
            name = f"{archive.stem}/{path.relative_to(folder)}"
            tar.add(path, name, recursive=False, filter=anonymous)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Build the offline bundle for deploy/install.sh.")
    parser.add_argument("--machine", action="append", choices=sorted(PLATFORMS), help="default: all")
    parser.add_argument("--python", action="append", metavar="3.X", help="default: 3.11, Debian 12's; repeatable")
    parser.add_argument("--to", type=Path, default=ROOT / "dist", help="folder (default: dist)")
    parser.add_argument("--sign", type=Path, metavar="KEY", help="an SSH private key; KEY.pub beside it")
    options = parser.parse_args()
    archive = options.to / f"skyfix-{__version__}-bundle.tar"
    with tempfile.TemporaryDirectory() as temporary:
        lay_out(Path(temporary), options.machine or sorted(PLATFORMS), options.python or ["3.11"])
        if options.sign is not None:
            sign(Path(temporary), options.sign)
        pack(Path(temporary), archive)
    print(f"{archive}: {archive.stat().st_size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Build the Debian packages: see tools/debs/__init__.py."""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from deploy.installer.places import Role
from edge import __version__
from tools import bundle
from tools.bundle import ROOT, this_machine
from tools.debs import tree
from tools.debs.package import COMPRESSED, SCRIPTS, Package, build, copy, documents, scripts

ARCHITECTURES: Final = {"x86_64": "amd64", "aarch64": "arm64"}
WHAT: Final = {"edge": "camera box", "base": "base station", "router": "site router"}
QUESTIONS: Final = {"edge": "site camera base", "base": "site", "router": "site"}
COMMON: Final = Package(
    "skyfix-common",
    "all",
    "python3 (>= 3.11), init-system-helpers (>= 1.54), systemd (>= 250)",
    "user, device names and templates of Skyfix",
    "This package has what its roles share.",
)
LEANS_ON: Final = (
    f"skyfix-common (= {__version__}), python3 (>= 3.11), python3 (<< 3.12), debconf (>= 0.5) | debconf-2.0, "
    "init-system-helpers (>= 1.54), libc6 (>= 2.34), libstdc++6, libgcc-s1, zlib1g"
)


def common(root: Path) -> None:
    """What every role shares: templates, schemas, the user, udev, the watch over the list of certificates."""
    left = shutil.ignore_patterns("__pycache__", "debian", "pictures", "install.sh", "sysusers", "udev", "sysctl")
    shutil.copytree(ROOT / "deploy", root / "usr/share/skyfix/deploy", ignore=left)
    copy("deploy/udev/70-skyfix.rules", root / "usr/lib/udev/rules.d/70-skyfix.rules")
    copy("deploy/sysctl/60-skyfix.conf", root / "usr/lib/sysctl.d/60-skyfix.conf")
    copy("deploy/sysusers/skyfix.conf", root / "usr/lib/sysusers.d/skyfix.conf")
    copy("README.md", root / "usr/share/doc/skyfix-common/README.md")
    for unit in ("skyfix-access.path", "skyfix-access.service", "skyfix-ntrip.service"):
        _unit(root, unit, "/usr/share/skyfix")


def _unit(root: Path, name: str, home: str) -> None:
    text = (ROOT / "systemd" / name).read_text()
    text = text.replace("/opt/skyfix/current/bin", f"{home}/bin")
    text = text.replace("/opt/skyfix/current/README.md", "/usr/share/doc/skyfix-common/README.md")
    text = text.replace("/opt/skyfix/current", "/usr/share/skyfix")
    assert "/opt/" not in text, name
    file = root / "lib/systemd/system" / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def _common(temporary: Path, to: Path, compressed: str) -> Path:
    root = temporary / COMMON.name
    common(root)
    documents(root, COMMON.name, "common")
    scripts(root, "common", {})
    return build(root, to, COMMON, compressed)


def _role(temporary: Path, to: Path, role: Role, wheel: Path, machine: str, *, compressed: str) -> Path:
    name, what = tree.PACKAGES[role.name], WHAT[role.name]
    root = temporary / name
    tree.lay(root, role, wheel, wheel.parent, machine)
    _unit(root, f"{role.unit}.service", tree.home(role))
    if role.program:
        link = root / "usr/bin" / role.program
        link.parent.mkdir(parents=True)
        link.symlink_to(os.path.relpath(f"{tree.home(role)}/bin/{role.program}", "/usr/bin"))
    documents(root, name, "role")
    words = {"PACKAGE": name, "ROLE": role.name, "UNIT": role.unit, "QUESTIONS": QUESTIONS[role.name]}
    scripts(root, "role", words)
    shutil.copyfile(SCRIPTS / f"{name.removeprefix('skyfix-')}.templates", root / "DEBIAN/templates")
    package = Package(name, ARCHITECTURES[machine], LEANS_ON, f"{what} of Skyfix", f"This is the {what}.")
    return build(root, to, package, compressed)


def all_of(to: Path, machine: str, compressed: str = COMPRESSED) -> Iterator[Path]:
    """Each package, built."""
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder)
        (temporary / "wheels").mkdir()
        wheel = bundle.build_wheel(temporary / "wheels")
        yield _common(temporary, to, compressed)
        for role in tree.roles():
            yield _role(temporary, to, role, wheel, machine, compressed=compressed)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.debs", description="Build Debian packages.")
    parser.add_argument("--machine", choices=sorted(ARCHITECTURES), default=this_machine())
    parser.add_argument("--to", type=Path, default=ROOT / "dist", help="folder (default: dist)")
    options = parser.parse_args()
    for package in all_of(options.to, options.machine):
        print(f"{package}: {package.stat().st_size / 1e6:.0f} MB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

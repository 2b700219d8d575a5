"""Bundles of other versions, good ones and broken ones, out of one that was built: our wheel renumbered and patched."""

import hashlib
import os
import re
import shutil
import tempfile
import zipfile
from pathlib import Path
from typing import Final

from deploy.installer.source import SUMS

# Put at the beginning of both programs' main.
FAULTS: Final = {
    "good": "",
    "exit2": 'import sys\n    print("/etc/skyfix: unknown key camera.source.realtime", file=sys.stderr)\n    return 2',
    "crash": 'raise RuntimeError("a version that is broken")',
    "late": "import os, threading\n    threading.Timer({after_s}, lambda: os._exit(1)).start()",
    "hang": "import time\n    time.sleep(1000.0)",
    "unloadable": "",  # patched elsewhere: a module that does not load
}
MAINS: Final = {
    "edge/app.py": r'(def main\(.*?\n    """.*?""")',
    "calib/station/app.py": r'(def main\(.*?\n    """.*?""")',
}


def variant(bundle: Path, to: Path, version: str, fault: str = "good", after_s: float = 25.0) -> Path:
    """A bundle's folder under another version; every wheel but ours is the same file."""
    shutil.copytree(bundle, to, copy_function=os.link)
    old = next((to / "wheels").glob("skyfix-*.whl"))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        with zipfile.ZipFile(old) as wheel:
            wheel.extractall(tree)
        old.unlink()
        _renumber(tree, version)
        if fault == "unloadable":
            (tree / "calib/solving/solve.py").write_text("import nothing_of_that_name_in_edge\n")
            (tree / "edge/node.py").write_text("from edge import nothing\n")
        elif FAULTS[fault]:
            for name, place in MAINS.items():
                text = (tree / name).read_text()
                code = FAULTS[fault].format(after_s=after_s)
                found = re.search(place, text, re.DOTALL)
                assert found is not None, f"{name} has no main that can be broken"
                patched = text[: found.end()] + f"\n    {code}" + text[found.end() :]
                (tree / name).write_text(patched)
        _zip(tree, to / f"wheels/skyfix-{version}-py3-none-any.whl")
    _sum_up(to)
    return to


def resummed(bundle: Path, to: Path, name: str, more: str) -> None:
    """A copy of a bundle with more in one of its files, and the sums made anew, as whoever changes it would."""
    shutil.copytree(bundle, to, copy_function=os.link)
    text = (to / name).read_text() + more
    (to / name).unlink()  # a link to the other's
    (to / name).write_text(text)
    sums = [line for line in (to / SUMS).read_text().splitlines() if not line.endswith(f"  {name}")]
    sums.append(f"{hashlib.sha256(text.encode()).hexdigest()}  {name}")
    (to / SUMS).unlink()
    (to / SUMS).write_text("".join(f"{line}\n" for line in sums))


def _renumber(tree: Path, version: str) -> None:
    package = tree / "edge/__init__.py"
    old = re.search(r'__version__ = "(.+)"', package.read_text())
    assert old is not None
    package.write_text(package.read_text().replace(old[1], version))
    info = next(tree.glob("skyfix-*.dist-info"))
    metadata = info / "METADATA"
    metadata.write_text(metadata.read_text().replace(f"Version: {old[1]}", f"Version: {version}", 1))
    renamed = info.with_name(f"skyfix-{version}.dist-info")
    info.rename(renamed)
    record = (renamed / "RECORD").read_text().replace(info.name, renamed.name)
    (renamed / "RECORD").write_text(re.sub(r",sha256=[^,\n]*,\d*$", ",,", record, flags=re.MULTILINE))


def _zip(tree: Path, wheel: Path) -> None:
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(tree.rglob("*")):
            if path.is_file():
                file.write(path, path.relative_to(tree))


def _sum_up(folder: Path) -> None:
    pairs = (line.split("  ", 1) for line in (folder / SUMS).read_text().splitlines())
    known = {name: digest for digest, name in pairs}
    ours = next((folder / "wheels").glob("skyfix-*.whl"))
    lines = {name: digest for name, digest in known.items() if not name.startswith("wheels/skyfix-")}
    lines[str(ours.relative_to(folder))] = hashlib.sha256(ours.read_bytes()).hexdigest()
    (folder / SUMS).unlink()  # a link to the other's
    (folder / SUMS).write_text("".join(f"{digest}  {name}\n" for name, digest in sorted(lines.items())))

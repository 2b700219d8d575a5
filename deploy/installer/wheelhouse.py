"""Which of a bundle's wheels a role needs on this machine.

Asked before anything is laid: what is missing is then told by name. pip's own reading of wheels and requirements is
used, out of the pip that is in the bundle.
"""

import email
import importlib
import platform
import sys
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from .telling import RefusedError


def _packaging(wheels: Path, module: str) -> Any:
    pip = next(iter(sorted(wheels.glob("pip-*.whl"))), None)
    if pip is None:
        raise RefusedError("the bundle has no pip", "build it again: make bundle")
    if str(pip) not in sys.path:
        sys.path.insert(0, str(pip))
    return importlib.import_module(f"pip._vendor.packaging.{module}")


@dataclass(frozen=True)
class Wheel:
    """One wheel that fits this machine."""

    path: Path

    @cached_property
    def metadata(self) -> Any:
        """Its METADATA."""
        with zipfile.ZipFile(self.path) as wheel:
            name = next(each for each in wheel.namelist() if each.endswith(".dist-info/METADATA"))
            return email.message_from_bytes(wheel.read(name))


def fitting(wheels: Path) -> dict[str, Wheel]:
    """The wheels for this Python on this machine, by normal name."""
    utils, tags = _packaging(wheels, "utils"), _packaging(wheels, "tags")
    ours = set(tags.sys_tags())
    found = {}
    for path in sorted(wheels.glob("*.whl")):
        name, _, _, fits = utils.parse_wheel_filename(path.name)
        if fits & ours:
            found[str(name)] = Wheel(path)
    return found


def needed(wheels: Path, extras: Iterable[str]) -> list[Wheel]:
    """Skyfix with these extras and all that they need. Raises RefusedError naming what the bundle lacks."""
    there = fitting(wheels)
    requirements, utils = _packaging(wheels, "requirements"), _packaging(wheels, "utils")
    wanted: list[tuple[str, frozenset[str]]] = [("skyfix", frozenset(extras))]
    seen: dict[str, frozenset[str]] = {}
    while wanted:
        name, asked = wanted.pop()
        if name in seen and asked <= seen[name]:
            continue
        if name not in there:
            raise RefusedError(*_lacking(wheels, name))
        seen[name] = asked | seen.get(name, frozenset())
        for line in there[name].metadata.get_all("Requires-Dist", []):
            requirement = requirements.Requirement(line)
            if _applies(requirement, seen[name]):
                wanted.append((str(utils.canonicalize_name(requirement.name)), frozenset(requirement.extras)))
    return [there[name] for name in sorted(seen)]


def _applies(requirement: Any, extras: frozenset[str]) -> bool:
    return requirement.marker is None or any(
        requirement.marker.evaluate({"extra": extra}) for extra in (extras or frozenset({""}))
    )


def _lacking(wheels: Path, name: str) -> tuple[str, str]:
    here = f"Python {sys.version_info.major}.{sys.version_info.minor} on {platform.machine()}"
    has = sorted(_kinds(wheels, name))
    reason = f"the bundle has no {name} for {here}" + (f", only for {', '.join(has)}" if has else "")
    if has:
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        return reason, f"build one that has: python -m tools.bundle --python {python}"
    return reason, "build it again: make bundle"


def _kinds(wheels: Path, name: str) -> Iterator[str]:
    for path in wheels.glob(f"{name.replace('-', '_')}-*.whl"):
        yield "-".join(path.stem.split("-")[2:])

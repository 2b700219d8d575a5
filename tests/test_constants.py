"""A public constant is defined once: a name that means 0.05 here and 0.1 there is read wrongly by whoever knows one."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.places import ROOT

GENERATED = {ROOT / "calib" / "station" / "outputs" / "mavlink" / "dialect.py"}


def constants(path: Path) -> Iterator[str]:
    """The public constants that a file defines at its top."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        names = [target.id for target in targets if isinstance(target, ast.Name)]
        yield from (name for name in names if name.isupper() and not name.startswith("_"))


def test_a_constant_has_one_home() -> None:
    homes: defaultdict[str, list[str]] = defaultdict(list)
    for room in ("edge", "calib"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for name in () if path in GENERATED else constants(path):
                homes[name].append(str(path.relative_to(ROOT)))
    assert len(homes) > 500
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}

"""The house as a whole: who may import whom, no circles, one class name for one thing."""

import ast
from collections import Counter
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.places import ROOT

PRODUCT = ("edge", "calib")
ALL = (*PRODUCT, "tools", "tests")


def files(*rooms: str) -> Iterator[Path]:
    for room in rooms:
        yield from sorted((ROOT / room).rglob("*.py"))


def name_of(path: Path) -> str:
    """`calib.network` of calib/network.py, `edge.lens` of edge/lens/__init__.py."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, known: set[str]) -> set[str]:
    """The modules of `known` that a file imports, wherever in the file, also for types alone."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # `from calib.station import config` names a module, `from calib.network import Camera` does not.
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (whole & known) or {node.module}
    return found & known


def graph(*rooms: str) -> dict[str, set[str]]:
    paths = {name_of(path): path for path in files(*rooms)}
    return {name: imports(path, set(paths)) - {name} for name, path in paths.items()}


def arrows(importing: str, imported: str) -> list[str]:
    """What in one room imports something of another."""
    found = graph(*ALL)
    return [
        f"{name} imports {other}"
        for name, others in found.items()
        for other in sorted(others)
        if name.split(".")[0] == importing and (other + ".").startswith(imported + ".")
    ]


def test_no_test_imports_a_benchmark() -> None:
    assert arrows("tests", "tools.bench") == [], "what tests need is in tools/doubles, or in the product"


def test_the_product_knows_neither_tools_nor_tests_and_a_box_nothing_of_the_base() -> None:
    assert [arrow for room in PRODUCT for other in ("tools", "tests") for arrow in arrows(room, other)] == []
    assert arrows("edge", "calib") == []


def test_doubles_lean_on_no_bench_and_no_demonstration() -> None:
    leaning = arrows("tools", "tools.bench") + arrows("tools", "tools.demonstration")
    assert [arrow for arrow in leaning if arrow.startswith("tools.doubles")] == []


def test_no_module_imports_itself_by_way_of_others() -> None:
    try:
        TopologicalSorter(graph("edge", "calib", "tools")).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from error


def test_one_class_name_is_one_thing() -> None:
    counts = Counter(
        node.name
        for path in files(*PRODUCT)
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    # The dialect is written by pymavlink's generator, which begins each class with MAVLink.
    assert {name for name, count in counts.items() if count > 1 and not name.startswith("MAVLink")} == set()

"""Arrows between the product's modules run down, and nowhere in a circle; what only type checkers see counts too."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import calib

HOUSE = Path(calib.__path__[0]).parent
FILES = {
    ".".join(file.relative_to(HOUSE).with_suffix("").parts).removesuffix(".__init__"): file
    for room in ("edge", "calib")
    for file in (HOUSE / room).rglob("*.py")
}
# What a room of the station must know nothing of: what stands above it or beside it.
ABOVE = {
    "calib.station.config": ("core", "outputs", "archive", "page", "status", "survey", "report", "commands", "runner"),
    "calib.station.core": ("outputs", "archive", "page", "status", "report", "commands", "runner", "display", "boxes"),
    "calib.station.status": ("outputs", "archive", "page", "report", "commands", "runner", "display", "boxes"),
    "calib.station.outputs": ("archive", "page", "report", "commands", "runner", "display", "boxes"),
    "calib.station.archive": ("outputs", "page", "status", "report", "commands", "runner", "display", "boxes"),
    "calib.station.page": ("outputs", "report", "commands", "runner", "display", "boxes"),
    "calib.station.runner": ("commands",),
}


def imported(name: str) -> set[str]:
    """The product's modules that a module imports, by its text."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inside & FILES.keys() or {node.module}
    return (found & FILES.keys()) - {name}


def test_no_module_imports_itself_by_a_way_round() -> None:
    assert len(FILES) > 200
    try:
        TopologicalSorter({name: imported(name) for name in FILES}).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("room", ABOVE)
def test_a_room_of_the_station_knows_nothing_of_what_stands_above_it(room: str) -> None:
    above = tuple(f"calib.station.{name}" for name in ABOVE[room])
    for name in FILES:
        if name == room or name.startswith(f"{room}."):
            assert not [other for other in imported(name) if other.startswith(above)], name

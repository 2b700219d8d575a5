"""What ARCHITECTURE and CONTRACTS say of the house is so: who imports what, and every place that they name."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.places import DEPLOY, ROOT

PAGES = [DEPLOY / "ARCHITECTURE.md", DEPLOY / "CONTRACTS.md"]
ROOMS = ("calib", "edge", "tools", "tests", "deploy", "systemd")
# Where a path in ARCHITECTURE may begin: what is named in a sentence about the station stands below calib/station.
BEGINNINGS = (ROOT, ROOT / "calib" / "station", ROOT / "calib" / "solving", ROOT / "calib", ROOT / "edge")


def imported(path: Path) -> set[str]:
    """The modules a file names in its imports, also those for types alone."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}


def of_the_house(room: Path) -> set[str]:
    """What of ours the files of a room import."""
    names = {name for path in room.rglob("*.py") for name in imported(path)}
    assert names, room
    return {name for name in names if name.split(".")[0] in ROOMS}


@pytest.mark.parametrize(
    ("room", "allowed"),
    [
        ("edge/common", ("edge.common",)),
        ("edge", ("edge",)),
        ("calib", ("calib", "edge")),
        (
            "calib/guarding",
            ("calib.guarding", "calib.geometry", "calib.network", "calib.observations", "calib.sighting", "edge"),
        ),
    ],
)
def test_a_room_imports_only_what_it_may(room: str, allowed: tuple[str, ...]) -> None:
    assert {name for name in of_the_house(ROOT / room) if not name.startswith(allowed)} == set()


def test_what_the_station_decides_loads_nothing_that_opens_a_socket_or_a_session() -> None:
    core = ROOT / "calib" / "station" / "core"
    modules = [f"calib.station.core.{path.stem}" for path in core.glob("*.py") if path.stem != "__init__"]
    code = f"import sys, {', '.join(modules)}; print('\\n'.join(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    world = {"zenoh", "serial", "pymavlink", "mcap", "nicegui", "onnxruntime"}
    assert world & set(done.stdout.split()) == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_every_place_that_is_named_is_there() -> None:
    text = PAGES[0].read_text()
    places = re.findall(r"`((?:[a-z_]+/)*[a-z_]+\.py|(?:[a-z_]+/)+)`", text)
    assert len(places) > 30
    missing = [place for place in places if not any((start / place).exists() for start in BEGINNINGS)]
    assert missing == []

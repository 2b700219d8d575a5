"""The guide says what is: its tables are generated, its quotations are the program's own words.

Its commands are run by test_wheel.py.
"""

import re
import shlex
import subprocess
import sys

import msgspec
import pytest
from msgspec import inspect

from calib.station.commands.router import RouterConfig
from calib.station.config import BaseConfig
from edge.common import settings
from edge.config import BoxConfig
from tests.places import ROOT
from tests.tools.guidebook import TEXT, blocks
from tools.guide import GUIDE, PARTS, filled, keys, tables

PROGRAMS = {"edge-node": "edge.app", "base-station": "calib.station.app"}
# What varies in a quoted sentence: a number with its unit, a camera's name, a size.
VARIES = re.compile(r"\d+ x \d+|\d[\d.]*|cam\d|\(Address already in use\)|on this machine only", re.IGNORECASE)


def test_the_generated_tables_are_up_to_date() -> None:
    assert filled(TEXT) == TEXT, "run `python -m tools.guide`"


@pytest.mark.parametrize("kind", [BoxConfig, BaseConfig, RouterConfig])
def test_every_key_says_what_it_is_and_every_number_its_bounds(kind: type[msgspec.Struct]) -> None:
    for path, section in tables(kind):
        assert settings.description(section), path
        for field in keys(section):
            assert settings.description(field.type), f"[{path}] {field.encode_name} has no description"
            for number in numbers(field.type):
                low, high = (number.ge, number.gt), (number.le, number.lt)
                assert low != (None, None), f"[{path}] {field.encode_name} has no lower bound"
                assert high != (None, None), f"[{path}] {field.encode_name} has no upper bound"


def numbers(kind: inspect.Type) -> list[inspect.IntType | inspect.FloatType]:
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        return [kind]
    parts = [getattr(kind, name) for name in ("type", "item_type") if hasattr(kind, name)]
    parts += [*getattr(kind, "types", ()), *getattr(kind, "item_types", ())]
    return [number for part in parts for number in numbers(part)]


def test_a_guide_without_a_place_for_a_table_is_an_error() -> None:
    for name in PARTS:
        with pytest.raises(ValueError, match=name):
            filled(TEXT.replace(f"<!-- {name} -->", ""))


@pytest.mark.parametrize("line", [line for block in blocks("console") for line in block.splitlines()])
def test_the_commands_that_need_hardware_are_understood(line: str) -> None:
    words = shlex.split(line.removeprefix("sudo "))
    if words[0] not in PROGRAMS:
        assert (ROOT / words[0]).exists()
        assert words[1] in (ROOT / words[0]).read_text()
        return
    actions = [word for word in words[1:] if re.fullmatch(r"[a-z]+", word)]
    known = {"survey": 2}.get(actions[0], 1)
    command = [sys.executable, "-m", PROGRAMS[words[0]], *actions[:known], "--help"]
    told = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    if actions[0] == "survey":
        told += subprocess.run([*command[:4], "--help"], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    for option in [word for word in words if word.startswith("-")]:
        assert option in told, option


def quotations() -> list[str]:
    table = TEXT[TEXT.index("## Trouble") : TEXT.index("## Security")]
    return re.findall(r'^\| "(.+?)" \|', table, re.MULTILINE)


def test_there_is_help_with_the_usual_trouble() -> None:
    assert len(quotations()) >= 20


@pytest.mark.parametrize("quoted", quotations())
def test_what_is_quoted_is_what_the_program_says(quoted: str) -> None:
    sources = [file.read_text() for room in ("edge", "calib") for file in (ROOT / room).rglob("*.py")]
    sources += [file.read_text() for file in (ROOT / "calib").rglob("*.js")]
    said = re.sub(r'"\s*\n\s*f?"', "", "\n".join(sources)).lower()
    parts = [part.strip(" ,.:") for part in VARIES.split(quoted.lower()) if part]
    wordy = [part for part in parts if len(part) > 3]
    assert wordy
    for part in wordy:
        assert part in said, part


def test_links_lead_somewhere() -> None:
    headings = {re.sub(r"[^a-z -]", "", h.lower()).replace(" ", "-") for h in re.findall(r"^## (.+)$", TEXT, re.M)}
    for target in re.findall(r"\]\(([^)]+)\)", TEXT):
        if target.startswith("#"):
            assert target[1:] in headings
        else:
            assert (GUIDE.parent / target).exists(), target

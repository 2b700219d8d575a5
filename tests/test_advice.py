"""What the product tells its user to type or to write exists: held against the real parsers and configurations.

Every string in the two programs, and all that is written for users, is searched for commands, options and keys. So a
renamed action, or a key that moved, is a red test here and not a dead end on a hill.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from calib.station.archive.sitefile import SiteFile
from calib.station.config import BaseConfig
from calib.station.survey.store import Survey
from edge.config import BoxConfig
from edge.detector.mask_file import MaskConfig
from tests.places import ROOT
from tests.programs import Words, actions, options, parsers

PROGRAMS = ("base-station", "edge-node")
GENERATED = ("calib/station/outputs/mavlink/dialect.py",)
# What may follow a program's name where it is spoken of and not called.
PROSE = frozenset({"running", "with", "process", "in", "is", "and", "or", "on", "for", "holds", "of", "the", "there"})
COMMAND = re.compile(r"\b(base-station|edge-node)((?: [a-z]+)*)([^`\n]*)")
ACTION = re.compile(r"(?:^(?=\w+ \w+$)|`)(survey|certs) ([a-z]+)([^`\n]*)")  # quoted, or where an error says it arose
OPTION = re.compile(r"(?<![\w(-])--[a-z][a-z-]*(?![\w:\r-])")
SECTION = re.compile(r"(?<!\w)\[\[?([a-z]+(?:\.[a-z]+)*)\]\]?(?!\()(?: ([a-z]\w*))?")
DOTTED = re.compile(r"(?<![\w./\[])([a-z]+)\.([a-z]\w*)(?![\w(./])")
FREE = ("output",)  # tables whose own tables are named by what is plugged in
FILES = frozenset({"toml", "py", "md", "json", "html", "csv", "mcap", "pem", "key", "service"})


@dataclass(frozen=True)
class Text:
    """A string that a user may come to read, and where it stands."""

    where: str
    words: str
    docstring: bool = False


def in_code() -> Iterator[Text]:
    """All strings of both programs, docstrings too; what is filled in is a dash."""
    for path in sorted(file for room in ("edge", "calib") for file in (ROOT / room).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name not in GENERATED:
            for node, docstring in _strings(ast.parse(path.read_text())):
                yield Text(f"{name}:{node.lineno}", _words(node), docstring)


def _strings(node: ast.AST, docstring: bool = False) -> Iterator[tuple[ast.Constant | ast.JoinedStr, bool]]:
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str)):
        yield node, docstring
        return
    for inner in ast.iter_child_nodes(node):
        yield from _strings(inner, isinstance(node, ast.Expr))


def _words(node: ast.Constant | ast.JoinedStr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "–" for part in node.values)


def written() -> Iterator[Text]:
    """What is written for users, line by line."""
    files = [ROOT / "README.md", *(ROOT / "deploy").rglob("*.md"), *(ROOT / "deploy").glob("*.toml")]
    for path in files:
        for number, line in enumerate(path.read_text().splitlines(), start=1):
            yield Text(f"{path.relative_to(ROOT)}:{number}", line)


def quoted(text: Text) -> Text:
    """Of a line for people only what they may type: the prose between is about the programs, not to them."""
    line = text.words.strip().removeprefix("sudo ")
    return text if line.startswith(PROGRAMS) else replace(text, words="\n".join(re.findall(r"`[^`]*`", line)))


def unknown_words(program: Words, said: str, rest: str) -> str:
    """What is wrong with a command that is spoken of: empty if nothing is."""
    words = program
    for word in said.split():
        if word in actions(words):
            words = (*words, word)
        elif (words == program and word not in PROSE) or (actions(words) and word not in PROSE):
            return f"{' '.join(words)} {word}"
        else:
            break
    known = options(words) | {option for more in _under(words) for option in options(more)}
    wrong = [option for option in OPTION.findall(rest) if option not in known]
    return f"{' '.join(words)} {wrong[0]}" if wrong else ""


def _under(words: Words) -> list[Words]:
    return [known for known in parsers() if known[: len(words)] == words]


def commands(text: Text) -> Iterator[str]:
    """The commands in a text that do not exist."""
    for program, said, rest in COMMAND.findall(text.words):
        if wrong := unknown_words((program,), said, rest):
            yield wrong
    for command, action, rest in ACTION.findall(text.words):
        if action in actions(("base-station", command)) | PROSE:
            wrong = unknown_words(("base-station", command), f" {action}", rest)
        else:
            wrong = f"{command} {action}"
        if wrong:
            yield wrong


def test_every_command_that_is_named_exists() -> None:
    texts = [*in_code(), *map(quoted, written())]
    assert len([text for text in texts if COMMAND.search(text.words)]) > 100
    found = [f"{text.where}: {wrong}" for text in texts for wrong in commands(text)]
    assert not found, "\n".join(found)


def test_every_option_that_a_message_names_exists() -> None:
    known = {option for words in parsers() for option in options(words)}
    found = [
        f"{text.where}: {option}" for text in in_code() for option in OPTION.findall(text.words) if option not in known
    ]
    assert not found, "\n".join(found)


@cache
def sections() -> dict[str, set[str]]:
    """The keys of every table of both configurations, of a survey and a site.toml, by the table's name."""
    found: dict[str, set[str]] = {}
    for kind in (BaseConfig, BoxConfig, MaskConfig, Survey, SiteFile):
        for path, table in _tables(kind, ""):
            found.setdefault(path, set()).update(field.encode_name for field in msgspec.structs.fields(table))
    return found


def _tables(kind: type[msgspec.Struct], path: str) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    yield path, kind
    for name, hint in get_type_hints(kind).items():
        for inner in _structs(hint):
            yield from _tables(inner, f"{path}.{name}".lstrip("."))


def _structs(hint: Any) -> list[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [found for part in get_args(hint) for found in _structs(part)]


def keys(text: Text) -> Iterator[str]:
    """The configuration keys in a text that do not exist."""
    anywhere = set.union(*sections().values())
    for table, key in SECTION.findall(text.words):
        if table.startswith(FREE):
            continue
        if table not in sections():
            yield f"[{table}]"
        elif key and ("_" in key or key in anywhere) and key not in sections()[table]:
            yield f"[{table}] {key}"
    for table, key in DOTTED.findall(text.words):
        if table in sections() and key not in FILES and key not in sections()[table]:
            yield f"{table}.{key}"


def test_every_key_that_a_message_names_exists() -> None:
    texts = [text for text in [*in_code(), *written()] if not text.docstring]
    found = [f"{text.where}: {wrong}" for text in texts for wrong in keys(text)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        ("give a measured shift with `survey shift`", ["survey shift"]),
        ("see `base-station survey show`, or base-station certify", ["base-station certify"]),
        ("`edge-node lens PHOTOS --board 9x6 --grid`", ["edge-node lens --grid"]),
        ("`base-station survey rover --above-lens 0.1`", []),
    ],
)
def test_a_command_that_is_not_there_is_found(words: str, wrong: list[str]) -> None:
    assert list(commands(Text("here", words))) == wrong


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        ("set [site] undulation to the geoid's", []),
        ("set [site] undulations_m", ["[site] undulations_m"]),
        ("set [recording] origin", ["[recording] origin"]),
        ("add [[mavlink.endpoints]]", ["[mavlink.endpoints]"]),
        ("give gnss.antenna_m in edge.toml", ["gnss.antenna_m"]),
        ("give `status.port`, see site.toml", []),
    ],
)
def test_a_key_that_is_not_there_is_found(words: str, wrong: list[str]) -> None:
    assert list(keys(Text("here", words))) == wrong

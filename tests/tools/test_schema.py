"""The schemas in deploy/schema are those of the structs, and the examples are what they allow."""

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from tests.places import DEPLOY
from tools.schema import FOLDER, out_of_date, schemas

EXAMPLES = [DEPLOY / "edge.example.toml", DEPLOY / "base.example.toml", DEPLOY / "router" / "router.example.toml"]


def test_the_files_are_up_to_date() -> None:
    assert out_of_date(FOLDER) == [], "run `python -m tools.schema`"


def test_a_changed_and_a_left_over_file_are_found(tmp_path: Path) -> None:
    for name, text in schemas().items():
        (tmp_path / name).write_text(text)
    (tmp_path / "Fix.json").write_text("{}")
    (tmp_path / "Gone.json").write_text("{}")
    (tmp_path / "Lens.json").unlink()
    assert out_of_date(tmp_path) == ["Fix.json", "Gone.json", "Lens.json"]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_an_example_names_its_schema_and_is_what_that_allows(example: Path) -> None:
    text = example.read_text()
    validator = named_schema(example, text)
    assert list(validator.iter_errors(tomllib.loads(text))) == []


@pytest.mark.parametrize(
    ("example", "change", "path"),
    [
        (EXAMPLES[0], ("readout_s = 0.02", "readout_s = 2"), ["camera", 0, "readout_s"]),
        (EXAMPLES[0], ("[gate]", "[gate]\nprofil = 'paper'"), ["gate"]),
        (EXAMPLES[1], ("undulation_m = 47.6", "undulation_m = 'high'"), ["site", "undulation_m"]),
    ],
)
def test_an_editor_marks_what_the_program_would_refuse(
    example: Path, change: tuple[str, str], path: list[str | int]
) -> None:
    text = example.read_text()
    errors = named_schema(example, text).iter_errors(tomllib.loads(text.replace(*change)))
    assert [list(error.absolute_path) for error in errors] == [path]


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.toml.json")), ids=lambda file: file.name)
def test_an_editor_is_told_what_a_key_means(file: Path) -> None:
    schema = json.loads(file.read_text())
    for table in (schema, *schema.get("$defs", {}).values()):
        for key, value in table["properties"].items():
            assert "description" in value or "$ref" in json.dumps(value), f"{file.name}: {key}"


def named_schema(example: Path, text: str) -> Draft202012Validator:
    first = text.splitlines()[0]
    assert first.startswith("#:schema ")
    return Draft202012Validator(json.loads((example.parent / first.removeprefix("#:schema ")).read_text()))

"""The schemas in deploy/schema are those of the structs."""

from pathlib import Path

from tools.schema import FOLDER, out_of_date, schemas


def test_the_files_are_up_to_date() -> None:
    assert out_of_date(FOLDER) == [], "run `python -m tools.schema`"


def test_a_changed_and_a_left_over_file_are_found(tmp_path: Path) -> None:
    for name, text in schemas().items():
        (tmp_path / name).write_text(text)
    (tmp_path / "Fix.json").write_text("{}")
    (tmp_path / "Gone.json").write_text("{}")
    (tmp_path / "Lens.json").unlink()
    assert out_of_date(tmp_path) == ["Fix.json", "Gone.json", "Lens.json"]

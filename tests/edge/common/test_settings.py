"""Every fault in a configuration is named: file, key, what is allowed, the nearest valid key."""

from pathlib import Path
from typing import ClassVar

import msgspec
import pytest

from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import BoxConfig, load, load_box, load_lens
from tests.places import DEPLOY

EXAMPLE = DEPLOY / "edge.example.toml"

GOOD = """
site = "field"
[[camera]]
id = "cam1"
source.path = "a.mp4"
lens = { model = "radtan", intrinsics = [900.0, 900.0, 319.5, 239.5], distortion = [0, 0, 0, 0], size_px = [640, 480] }
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "edge.toml"
    file.write_text(text)
    return file


def test_good_file_loads_and_defaults_are_filled_in(tmp_path: Path) -> None:
    config = load_box(write(tmp_path, GOOD))
    assert config.camera[0].lens.intrinsics[0] == 900.0
    assert config.gate_of(config.camera[0]).profile == "tracks"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("source.path", "source.pth"), ["camera[0].source.pth", 'did you mean "path"']),
        (('site = "field"', ""), ["key site is missing"]),
        (('site = "field"', 'site = "a b"'), ["key site", "text matching"]),
        (("[900.0, 900.0", "[nan, 900.0"), ["camera[0].lens.intrinsics[0] is nan"]),
        (("[900.0, 900.0", "[-900.0, 900.0"), ["camera cam1", "fx, fy > 0"]),
        (('"radtan"', '"pinhole"'), ["camera[0].lens.model", '"fisheye", "radtan"']),
        (('id = "cam1"', 'id = "cam1"\nreadout_s = 2'), ["camera[0].readout_s", ">= 0 and <= 1", "rolling shutter"]),
        (('id = "cam1"', 'id = "cam1"\nreadout_s = "x"'), ["camera[0].readout_s", "expected `float | null`"]),
        (('site = "field"', 'site = "field'), ["is not TOML"]),
        (("[[camera]]", "[gate]\nprofil = 'paper'\n[[camera]]"), ["gate.profil", 'did you mean "profile"']),
        (("[[camera]]", GOOD.split("[[camera]]")[1].join(["[[camera]]"] * 2)), ["camera cam1 is named twice"]),
    ],
)
def test_each_fault_is_named(tmp_path: Path, change: tuple[str, str], named: list[str]) -> None:
    file = write(tmp_path, GOOD.replace(*change, 1))
    with pytest.raises(ConfigError) as caught:
        load_box(file)
    for words in [str(file), *named]:
        assert words in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        load_box(tmp_path / "none.toml")


def test_a_lens_not_yet_measured_is_said_with_how_to_measure_it(tmp_path: Path) -> None:
    head, _ = GOOD.split("lens =")
    with pytest.raises(ConfigError, match="no such lens file") as caught:
        load_box(write(tmp_path, head + 'lens = "a.toml"\n'))
    assert f"edge-node lens PHOTOS... --board 9x6 -o {tmp_path / 'a.toml'}" in caught.value.action


def test_lens_file_is_looked_for_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(
        'model = "radtan"\nintrinsics = [9, 9, 3, 2]\ndistortion = [0, 0, 0, 0]\nsize_px = [7, 5]\n'
    )
    head, _ = GOOD.split("lens =")
    file = write(tmp_path, head + 'lens = "a.toml"\n')
    config = load_box(file)
    assert load_lens(config.camera[0], file).size_px == (7, 5)


def test_example_shows_every_key() -> None:
    text = EXAMPLE.read_text()
    for key in keys_of(BoxConfig):
        assert f"{key} =" in text or f"{key}]" in text or f".{key}]" in text, (
            f"deploy/edge.example.toml does not show {key}"
        )


def test_example_loads_and_so_does_what_it_comments_out() -> None:
    load(EXAMPLE, BoxConfig)


def keys_of(section: type[msgspec.Struct]) -> set[str]:
    found = set()
    for field in msgspec.structs.fields(section):
        found.add(field.encode_name)
        for kind in (field.type, *getattr(field.type, "__args__", ())):
            for option in (kind, *getattr(kind, "__args__", ())):
                if isinstance(option, type) and issubclass(option, msgspec.Struct):
                    found |= keys_of(option)
    return found


class Moved(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Had a key once."""

    MOVED: ClassVar[dict[str, tuple[str, str]]] = {"height": ("is in another file now", "give it there")}

    heights: float = 0.0


class Outer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of tables."""

    row: list[Moved]


def test_a_key_that_moved_is_said_with_where_it_went_and_not_guessed_at() -> None:
    with pytest.raises(ConfigError, match="is in another file now") as caught:
        build({"row": [{"height": 1.0}]}, Outer, where="a.toml")
    assert caught.value.action == "give it there"

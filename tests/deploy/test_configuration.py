"""What is given to the installer stands in the configuration, and both programs read it."""

import tomllib
from pathlib import Path

import pytest

from calib.station.config import load as load_base
from deploy.installer.configuration import filled
from edge.config import load_box
from tests.places import DEPLOY

LENS = """\
model = "radtan"
intrinsics = [1500.0, 1500.0, 959.5, 539.5]
distortion = [0.0, 0.0, 0.0, 0.0]
size_px = [1920, 1080]
rms_px = 0.3
"""
EDGE, BASE = (DEPLOY / f"{role}.example.toml" for role in ("edge", "base"))


def test_the_examples_are_of_one_site() -> None:
    edge, base = tomllib.loads(EDGE.read_text()), tomllib.loads(BASE.read_text())
    assert edge["site"] == base["site"]["name"]
    assert edge["camera"][0]["id"] in [camera["id"] for camera in base["camera"]]
    assert [place.replace("127.0.0.1", "0") for place in edge["link"]["connect"]] == [
        place.replace("127.0.0.1", "0") for place in base["link"]["listen"]
    ]


@pytest.mark.parametrize(("address", "dialled"), [("192.168.7.1", "192.168.7.1"), ("fd00::1", "[fd00::1]")])
def test_a_box_dials_the_base_that_was_given(tmp_path: Path, address: str, dialled: str) -> None:
    text = filled(EDGE.read_text(), "edge", {"site": "hill", "camera": "west", "base": address})
    read = tomllib.loads(text)
    assert (read["site"], read["camera"][0]["id"]) == ("hill", "west")
    assert read["link"]["connect"] == [f"tls/{dialled}:7447"]
    assert set(read["link"]["tls"]) == {"authority", "certificate", "key"}
    (tmp_path / "edge.toml").write_text(text)
    (tmp_path / "west.lens.toml").write_text(LENS)
    box = load_box(tmp_path / "edge.toml")
    assert (box.camera[0].id, box.camera[0].lens) == ("west", "west.lens.toml")


def test_a_base_is_of_the_site_that_was_given(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(filled(BASE.read_text(), "base", {"site": "hill"}))
    assert load_base(tmp_path / "base.toml").site.name == "hill"


@pytest.mark.parametrize("role", ["edge", "base", "router"])
def test_nothing_given_is_the_example(role: str) -> None:
    template = DEPLOY / ("router/router.example.toml" if role == "router" else f"{role}.example.toml")
    assert filled(template.read_text(), role, {}) == template.read_text()

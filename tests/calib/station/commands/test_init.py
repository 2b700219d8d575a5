"""What `init` writes is what both programs read, fits one another, and overwrites nothing."""

import shlex
from pathlib import Path

import pytest

from calib.station import config
from calib.station.app import main
from calib.station.config import MAX_CAMERAS, BaseConfig
from edge.common import settings
from edge.config import BoxConfig
from edge.link.access import load_access
from edge.link.heading import read_heading


def made(folder: Path, *words: str) -> tuple[BaseConfig, list[BoxConfig]]:
    """What was written, as both programs read it."""
    assert main(["init", "hill", "-o", str(folder), *words]) == 0
    boxes = [settings.load(file, BoxConfig) for file in sorted(folder.glob("*/edge.toml"))]
    return config.load(folder / "base.toml"), boxes


@pytest.mark.parametrize("words", [(), ("--base", "192.168.7.1"), ("--base", "base.local"), ("--base", "fd00::1")])
def test_both_programs_read_it_and_it_fits(words: tuple[str, ...], tmp_path: Path) -> None:
    base, boxes = made(tmp_path / "site", "--cameras", "4", *words)
    assert {box.site for box in boxes} == {base.site.name} == {"hill"}
    assert [camera.id for camera in base.camera] == [box.camera[0].id for box in boxes] == [f"cam{k}" for k in range(4)]
    scheme, _, place = base.link.listen[0].partition("/")
    for box in boxes:
        dialled_scheme, _, dialled = box.link.connect[0].partition("/")
        assert (dialled_scheme, dialled.rpartition(":")[2]) == (scheme, place.rpartition(":")[2])
        assert dialled.rpartition(":")[0].strip("[]") == (words[1] if words else place.rpartition(":")[0])
        assert (box.link.tls is None) == (base.link.tls is None) == (not words)


def test_as_many_cameras_as_a_mask_has_bits(tmp_path: Path) -> None:
    base, boxes = made(tmp_path / "site", "--cameras", str(MAX_CAMERAS))
    assert len(base.camera) == len(boxes) == MAX_CAMERAS


def test_the_certificates_it_asks_for_can_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "hill", "--base", "192.168.7.1"]) == 0
    asked = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("  base-station certs")]
    assert len(asked) == 5
    for line in asked:
        assert main(shlex.split(line)[1:]) == 0, line
    listed = load_access(tmp_path / "certs" / "access.json")
    assert listed.site == "hill"
    assert {subject.cameras for subject in listed.subjects if subject.role == "camera"} == {
        ("cam0",),
        ("cam1",),
        ("cam2",),
    }


def test_it_makes_them_itself_and_each_box_s_lie_beside_its_configuration(tmp_path: Path) -> None:
    folder = tmp_path / "hill"
    made(folder, "--cameras", "4", "--base", "192.168.7.1", "--certs")
    listed = load_access(folder / "certs" / "access.json")
    assert [subject.name for subject in listed.subjects] == ["base", "cam0", "cam1", "cam2", "cam3"]
    for subject in listed.subjects[1:]:
        carried = folder / subject.name / "certs"
        heading = read_heading(carried / "certificate.pem")
        assert heading is not None
        assert (heading.common_name, heading.cameras) == (subject.common_name, (subject.name,))
        assert (carried / "key.pem").stat().st_mode & 0o077 == 0
        assert (carried / "authority.pem").read_bytes() == (folder / "certs/authority.pem").read_bytes()
    assert main(["init", "hill", "--base", "192.168.7.1", "--certs", "-o", str(folder)]) == 2


def test_certificates_are_not_made_over_an_authority_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["certs", "--folder", str(tmp_path / "certs"), "init", "hill"]) == 0
    assert main(["init", "hill", "--base", "10.0.0.1", "--certs", "-o", str(tmp_path)]) == 2
    assert "authority.key: is there already" in capsys.readouterr().err
    assert not (tmp_path / "base.toml").exists()


def test_a_bench_has_no_certificates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", "hill", "--certs", "-o", str(tmp_path / "hill")]) == 2
    assert "give the base's address: --base" in capsys.readouterr().err


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cam2").mkdir()
    (tmp_path / "cam2" / "edge.toml").write_text("mine")
    assert main(["init", "hill", "-o", str(tmp_path)]) == 2
    assert f"{tmp_path / 'cam2' / 'edge.toml'}: is there already" in capsys.readouterr().err
    assert (tmp_path / "cam2" / "edge.toml").read_text() == "mine"
    assert not (tmp_path / "base.toml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["hi ll"], "is no name"),
        (["hill", "--cameras", "2"], "give 3 to 32"),
        (["hill", "--cameras", "33"], "give 3 to 32"),
        (["hill", "--base", "a/b"], "is no address"),
    ],
)
def test_what_cannot_be_a_site_is_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", *words, "-o", str(tmp_path / "site")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "site").exists()

"""One rule for where the survey is, one strict reader for each kind of file, one sigma for who states none."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from calib.station.archive import sitefile
from calib.station.commands.check import examine
from calib.station.config import UNSTATED_SIGMA_M, BaseConfig, CameraSection, SiteSection
from calib.station.survey import edit
from calib.station.survey.derive import derived
from calib.station.survey.in_force import frames_in_force, survey_file, with_survey
from calib.station.survey.store import Survey, SurveySite, TapeTable, load_survey, save_survey
from edge.common.errors import ConfigError

HERE = (47.0, 8.0, 500.0)
SIGMA_M = (0.01, 0.01, 0.02)
NAMES = ("cam0", "cam1", "cam2")
SITE_CAMERA = (
    '[[camera]]\nid = "{name}"\nsize_px = [1920, 1080]\nlens = "radtan"\nintrinsics = [1300, 1300, 960, 540]\n'
    "distortion = [0, 0, 0, 0]\n{key} = [47.012345678, 8.00{name[3]}12345678, 500.0]\n"
)


def config(survey: str | None = None, **positions: tuple[float, float, float]) -> BaseConfig:
    """Three cameras."""
    cameras = [CameraSection(id=name, position=positions.get(name)) for name in NAMES]
    return BaseConfig(site=SiteSection(name="hill", survey=survey), camera=cameras, state_folder="state")


def survey(path: Path, height_m: float = 500.0) -> None:
    """A survey of the three cameras."""
    made = Survey(site=SurveySite(name="hill"))
    for name in NAMES:
        made = edit.enter(made, name, (47.0, 8.0, height_m), SIGMA_M, "typed in")
    save_survey(made, path)


def site_file(path: Path, *, third: str = "position") -> None:
    """A track folder's site.toml."""
    keys = zip(NAMES, ("position", "position", third), strict=True)
    path.write_text('[site]\nname = "x"\n' + "".join(SITE_CAMERA.format(name=name, key=key) for name, key in keys))


def heights(sections: dict[str, CameraSection]) -> list[float | None]:
    return [None if section.position is None else section.position[2] for section in sections.values()]


def test_the_survey_beside_the_configuration_is_read_without_a_key(tmp_path: Path) -> None:
    assert survey_file(config(), tmp_path) is None
    assert heights(with_survey(config(), tmp_path)) == [None] * 3
    survey(tmp_path / "survey.toml")
    assert survey_file(config(), tmp_path) == tmp_path / "survey.toml"
    found = with_survey(config(), tmp_path)
    assert heights(found) == [500.0] * 3
    assert found["cam0"].position_sigma == SIGMA_M


def test_a_survey_that_is_named_goes_before(tmp_path: Path) -> None:
    survey(tmp_path / "survey.toml", 500.0)
    survey(tmp_path / "other.toml", 600.0)
    assert heights(with_survey(config("other.toml"), tmp_path)) == [600.0] * 3


def test_a_named_survey_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file") as caught:
        with_survey(config("gone.toml"), tmp_path)
    assert "base-station survey" in caught.value.action


def test_check_names_the_file_and_a_position_given_twice(tmp_path: Path) -> None:
    survey(tmp_path / "survey.toml")
    lines = [line for line in examine(config(cam1=HERE), tmp_path) if line.name == "survey"]
    assert [line.verdict for line in lines] == ["PASS", "WARN"]
    assert str(tmp_path / "survey.toml") in lines[0].reason
    assert lines[1].reason.startswith("cam1: the position in the configuration is used")


@pytest.mark.parametrize("kind", ["site.toml", "survey.toml"])
def test_a_misspelt_position_is_refused_with_a_hint(tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    if kind == "site.toml":
        site_file(path, third="positon")
    else:
        survey(path)
        path.write_text(path.read_text().replace("position = ", "positon = ", 1))
    with pytest.raises(ConfigError, match="positon") as caught:
        with_survey(config(kind), tmp_path)
    assert 'did you mean "position"?' in caught.value.action
    if kind == "site.toml":
        with pytest.raises(ConfigError, match="positon"):
            sitefile.load(path)


def test_a_position_without_a_sigma_gets_the_same_one_live_and_in_solve(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    site_file(path)
    live = with_survey(config("site.toml"), tmp_path)["cam0"]
    _, _, cameras = sitefile.load(path)
    assert cameras[0].position_covariance is not None
    assert live.position_sigma == pytest.approx(np.sqrt(np.diag(cameras[0].position_covariance)))
    assert live.position_sigma == UNSTATED_SIGMA_M == CameraSection(id="x").position_sigma


@pytest.mark.parametrize("text", ["not toml", "camera = 3", "\0", ""])
def test_what_is_no_survey_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "survey.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        with_survey(config(), tmp_path)
    assert str(tmp_path / "survey.toml") in caught.value.where


def test_each_position_in_force_is_in_the_frame_of_where_it_comes_from(tmp_path: Path) -> None:
    assert frames_in_force(config(), tmp_path) == {}
    survey(tmp_path / "survey.toml")
    assert not any(frame.known for frame in frames_in_force(config(), tmp_path).values())
    kept = load_survey(tmp_path / "survey.toml")
    save_survey(derived(replace(kept, site=replace(kept.site, raw_frame="EPSG:7931"))), tmp_path / "survey.toml")
    one_given = config(cam1=HERE)
    one_given = replace(one_given, site=replace(one_given.site, frame="ETRS89"))
    found = {name: frame.label for name, frame in frames_in_force(one_given, tmp_path).items()}
    assert found == {"cam0": "EPSG:7931", "cam1": "ETRS89", "cam2": "EPSG:7931"}


def test_check_says_what_an_unnamed_frame_adds(tmp_path: Path) -> None:
    survey(tmp_path / "survey.toml")
    (line,) = [line for line in examine(config(), tmp_path) if line.name == "frame"]
    assert (line.verdict, "1 m is added" in line.reason) == ("WARN", True)
    assert "survey frame --is" in line.action


def test_the_frame_of_a_site_file_is_not_known(tmp_path: Path) -> None:
    site_file(tmp_path / "site.toml")
    assert not any(frame.known for frame in frames_in_force(config("site.toml"), tmp_path).values())


def test_check_says_what_the_survey_itself_has_against_its_positions(tmp_path: Path) -> None:
    survey(tmp_path / "survey.toml")
    moved = edit.enter(load_survey(tmp_path / "survey.toml"), "cam1", (47.001, 8.0, 500.0), SIGMA_M, "typed in")
    taped = edit.add_tape(moved, TapeTable(first="cam0", second="cam1", distance_m=80.0))
    save_survey(taped, tmp_path / "survey.toml")
    found = [line for line in examine(config(), tmp_path) if line.name == "survey" and "tape" in line.reason]
    assert [line.verdict for line in found] == ["WARN"]

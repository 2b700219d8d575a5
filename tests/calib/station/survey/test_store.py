"""The survey's file: raw coordinates for good, positions that follow, and edits that show what is wrong."""

import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from calib.errors import CalibrationError
from calib.geodesy import enu_to_geodetic, geodetic_to_enu, mean_position
from calib.network import Camera, Network
from calib.station.config import BaseConfig, CameraSection, SiteSection
from calib.station.survey import assessment, edit
from calib.station.survey.derive import absolute_sigmas, derived
from calib.station.survey.in_force import with_survey
from calib.station.survey.store import (
    AntennaTable,
    OccupationTable,
    Survey,
    SurveySite,
    TapeTable,
    load_survey,
    save_survey,
)
from edge.common.errors import ConfigError
from edge.lens import LensModel
from edge.messages import Fix

HERE = (48.1, 11.5, 500.0)
START_NS = 1_790_000_000 * 10**9
EMPTY = Survey(site=SurveySite(name="field-1"))
LENS = LensModel("radtan", (1500.0, 1500.0, 960.0, 540.0), (0.0, 0.0, 0.0, 0.0), (1920, 1080))


def place(east: float, north: float, up: float = 0.0) -> tuple[float, float, float]:
    """Geodetic coordinates so far from HERE."""
    lat, lon, height = enu_to_geodetic(np.array([[east, north, up]]), HERE)[0].tolist()
    return lat, lon, height


def occupation(position: tuple[float, float, float], minute: float = 0.0, above_m: float = 0.2) -> OccupationTable:
    """An occupation of three minutes."""
    return OccupationTable(
        t_unix_ns=START_NS + round(minute * 60e9),
        duration_s=180.0,
        samples=180,
        position=position,
        scatter_m=(0.004, 0.004, 0.01),
        floor_m=(0.0057, 0.0057, 0.015),
        fixed_m=(0.002, 0.002, 0.002),
        antenna=AntennaTable(above_lens_m=above_m, measured_to="phase-centre"),
    )


def surveyed() -> Survey:
    """Four tripods, the first one occupied again at the end."""
    survey = EMPTY
    corners = {"cam1": (0.0, 0.0), "cam2": (60.0, 0.0), "cam3": (60.0, 50.0), "cam4": (0.0, 50.0)}
    for minute, (name, (east, north)) in enumerate(corners.items()):
        survey = edit.add_occupation(survey, name, occupation(place(east, north), 10.0 * minute))
    return edit.add_occupation(survey, "cam1", occupation(place(0.01, 0.0), 45.0))


def test_what_is_written_is_read_and_the_station_reads_it_too(tmp_path: Path) -> None:
    survey = edit.add_tape(surveyed(), TapeTable(first="cam1", second="cam2", distance_m=60.0))
    path = tmp_path / "survey.toml"
    save_survey(survey, path)
    assert load_survey(path) == survey
    sections = [CameraSection(id=f"cam{i}") for i in range(1, 5)]
    config = BaseConfig(site=SiteSection(name="field-1", survey="survey.toml"), camera=sections)
    for camera_id, section in with_survey(config, tmp_path).items():
        table = survey.of(camera_id)
        assert table is not None
        assert section.position == table.position
        assert section.position_sigma == table.position_sigma


def test_the_position_is_the_lenss_and_the_raw_one_stays() -> None:
    table = surveyed().of("cam2")
    assert table is not None
    assert table.position is not None
    assert table.position[2] == pytest.approx(table.occupation[0].position[2] - 0.2, abs=1e-5)
    assert geodetic_to_enu(np.array([table.position]), place(60.0, 0.0, -0.2))[0] == pytest.approx([0, 0, 0], abs=1e-4)


def test_a_second_occupation_elsewhere_is_not_stored() -> None:
    with pytest.raises(CalibrationError, match="false fix"):
        edit.add_occupation(surveyed(), "cam2", occupation(place(60.3, 0.0), 50.0))


def test_the_odd_occupation_out_is_dropped() -> None:
    survey = edit.drop_occupation(surveyed(), "cam1", 1)
    table = survey.of("cam1")
    assert table is not None
    assert len(table.occupation) == 1
    assert edit.drop_occupation(survey, "cam1", 1).of("cam1") is None
    with pytest.raises(ConfigError, match="no number 7"):
        edit.drop_occupation(survey, "cam1", 7)
    with pytest.raises(ConfigError, match="surveyed are: cam1, cam2"):
        edit.drop_camera(survey, "cam9")


def test_loop_closure_is_found_only_when_the_rover_is_back() -> None:
    closure = assessment.closure_of(surveyed())
    assert closure is not None
    assert closure[0] == "cam1"
    assert closure[1].apart.horizontal_m == pytest.approx(0.01, abs=1e-5)
    assert assessment.closure_of(edit.drop_occupation(surveyed(), "cam1", 2)) is None
    assert assessment.closure_of(EMPTY) is None


def test_tapes() -> None:
    survey = edit.add_tape(surveyed(), TapeTable(first="cam1", second="cam2", distance_m=60.0))
    survey = edit.add_tape(survey, TapeTable(first="cam2", second="cam3", distance_m=49.0))
    assert [check.passed for check in assessment.tape_checks(survey)] == [True, False]
    assert "misread" in assessment.describe(survey)
    with pytest.raises(ConfigError):
        edit.add_tape(survey, TapeTable(first="cam1", second="cam9", distance_m=60.0))
    assert edit.drop_camera(survey, "cam2").tape == ()


def sigma_m(survey: Survey, camera: str) -> float:
    """The smallest of a tripod's sigmas."""
    table = survey.of(camera)
    assert table is not None
    assert table.position_sigma is not None
    return min(table.position_sigma)


@pytest.mark.parametrize("seed", range(20))
def test_a_tape_that_contradicts_two_positions_is_covered_by_the_sigma_of_both(seed: int) -> None:
    """Which of them is wrong, and in which direction, a tape does not say."""
    rng = np.random.default_rng(seed)
    off_m = float(np.exp(rng.uniform(np.log(0.1), np.log(50.0))))
    first, second = rng.choice(["cam1", "cam2", "cam3", "cam4"], 2, replace=False).tolist()
    survey = surveyed()
    enu = geodetic_to_enu(np.array([table.position for table in survey.camera]), HERE)
    names = [table.id for table in survey.camera]
    apart_m = float(np.linalg.norm(enu[names.index(first)] - enu[names.index(second)]))
    taped = edit.add_tape(survey, TapeTable(first=first, second=second, distance_m=apart_m + off_m))
    for name in names:
        assert (sigma_m(taped, name) > 0.99 * off_m) is (name in (first, second))
    assert f"WARNING: {first} to {second}" in assessment.describe(taped)
    assert "sigma covers it" in assessment.contradictions(taped)[0]
    again = edit.add_tape(taped, TapeTable(first=second, second=first, distance_m=apart_m))
    assert (len(again.tape), assessment.contradictions(again)) == (1, [])
    assert sigma_m(again, first) == sigma_m(survey, first)


def test_the_operator_says_which_end_of_a_tape_is_right() -> None:
    taped = edit.add_tape(surveyed(), TapeTable(first="cam1", second="cam2", distance_m=31.0))
    one = edit.trust(taped, "cam1")
    assert sigma_m(one, "cam1") < 0.03
    assert sigma_m(one, "cam2") > 28.0
    both = edit.trust(one, "cam2")
    assert both.tape == (), "it was misread"
    assert sigma_m(both, "cam2") < 0.03
    with pytest.raises(ConfigError, match="itself"):
        edit.add_tape(taped, TapeTable(first="cam1", second="cam1", distance_m=31.0))


def test_a_position_of_another_country_is_named_where_the_survey_is_shown() -> None:
    wrong = edit.enter(surveyed(), "cam4", (-HERE[0], HERE[1], HERE[2]), (0.01, 0.01, 0.02), "typed in")
    assert "WARNING: cam4: its position is" in assessment.describe(wrong)


@pytest.mark.parametrize(
    ("position", "sigma", "key"),
    [
        ((91.0, 11.0, 500.0), (0.01, 0.01, 0.02), "position"),
        ((48.0, 190.0, 500.0), (0.01, 0.01, 0.02), "position"),
        ((48.0, 11.0, 50_000.0), (0.01, 0.01, 0.02), "position"),
        ((48.0, 11.0, 500.0), (0.0, 0.01, 0.02), "sigma"),
        ((48.0, float("nan"), 500.0), (0.01, 0.01, 0.02), "position"),
    ],
)
def test_a_mistyped_position_is_refused_with_its_key(
    position: tuple[float, float, float], sigma: tuple[float, float, float], key: str
) -> None:
    with pytest.raises(ConfigError, match=key):
        edit.enter(EMPTY, "cam1", position, sigma, "typed in")


def test_a_table_of_positions() -> None:
    text = (
        "id, lat_deg, lon_deg, height_m, sigma_east_m, sigma_north_m, sigma_up_m\n"
        "cam1,48.1,11.5,500.0,0.01,0.01,0.02\ncam2,48.1003,11.5,500.5,0.01,0.01,0.02\n"
    )
    survey = edit.enter_csv(EMPTY, text, "list.csv")
    assert [table.id for table in survey.camera] == ["cam1", "cam2"]
    assert survey.camera[1].entered is not None
    assert survey.camera[1].entered.source == "list.csv, line 3"
    with pytest.raises(ConfigError, match="line 2"):
        edit.enter_csv(EMPTY, text.replace("48.1,", "forty-eight,"), "list.csv")
    with pytest.raises(ConfigError, match="sigma_up_m"):
        edit.enter_csv(EMPTY, text.replace(", sigma_up_m", ""), "list.csv")


def test_a_boxs_fix() -> None:
    fix = Fix(
        t_unix_ns=START_NS, lat_deg=48.1, lon_deg=11.5, height_m=500.0, quality=4, sigma_m=(0.01, 0.01, 0.02),
        frame="EPSG:7931", samples=200,
    )  # fmt: skip
    survey = edit.enter_fix(EMPTY, "cam1", fix)
    assert survey.site.frame == "EPSG:7931"
    table = survey.of("cam1")
    assert table is not None
    assert table.position == (48.1, 11.5, 500.0)
    with pytest.raises(ConfigError, match="EPSG:9989"):
        edit.enter_fix(survey, "cam2", replace(fix, frame="EPSG:9989"))


def test_an_unknown_frame_widens_the_absolute_sigma_and_says_so() -> None:
    assert absolute_sigmas(surveyed())["cam1"][0] > 0.99
    assert "WARNING: unknown frame" in assessment.describe(surveyed())
    known = derived(replace(surveyed(), site=SurveySite(name="field-1", raw_frame="EPSG:7931")))
    assert absolute_sigmas(known)["cam1"][0] < 0.02
    assert "WARNING" not in assessment.describe(known)


def test_the_operators_shift_moves_every_point() -> None:
    plain = surveyed()
    moved = derived(replace(plain, site=replace(plain.site, shift_enu_m=(1.0, -2.0, 0.5))))
    for before, after in zip(plain.camera, moved.camera, strict=True):
        assert before.position is not None
        assert after.position is not None
        assert geodetic_to_enu(np.array([after.position]), before.position)[0] == pytest.approx(
            [1.0, -2.0, 0.5], abs=2e-5
        )


def network_of(survey: Survey) -> Network:
    """A network that agrees with the survey, as an adjustment of very good cameras would return it."""
    origin = mean_position(np.array([table.position for table in survey.camera]))
    centres = geodetic_to_enu(np.array([table.position for table in survey.camera]), origin)
    cameras = tuple(
        Camera(table.id, LENS, np.eye(3), centre) for table, centre in zip(survey.camera, centres, strict=True)
    )
    return Network("field-1", origin, START_NS, cameras, np.eye(6 * len(cameras)) * 1e-6, 0.5)


def test_the_survey_is_checked_against_a_network() -> None:
    survey = surveyed()
    network = network_of(survey)
    assert assessment.check_network(survey, network).passed
    few = survey
    for name in ("cam3", "cam4"):
        few = edit.drop_camera(few, name)
    with pytest.raises(CalibrationError, match="2 cameras"):
        assessment.check_network(few, network)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "site"),
        ('[site]\nname = "x"\nbogus = 1\n', "bogus"),
        ('[site]\nname = "x"\n[[camera]]\nid = "a"\n[[camera]]\nid = "a"\n', "twice"),
        ('[site]\nname = "x"\n[[camera]]\nid = "a"\nposition = [99.0, 0.0, 0.0]\n', "position"),
        ("not toml at all", "TOML"),
    ],
)
def test_a_broken_file_is_named_with_its_fault(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "survey.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        load_survey(path)
    assert str(path) in caught.value.where


@given(
    st.lists(
        st.tuples(st.floats(-60, 60), st.floats(-179, 179), st.floats(-100, 3000), st.floats(0.001, 5)), max_size=4
    )
)
def test_any_survey_survives_the_file(rows: list[tuple[float, float, float, float]]) -> None:
    survey = EMPTY
    for i, (lat, lon, height, sigma) in enumerate(rows):
        survey = edit.enter(survey, f"cam{i}", (lat, lon, height), (sigma, sigma, sigma), 'typed "in"')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "survey.toml"
        save_survey(survey, path)
        assert load_survey(path) == survey
        assert tomllib.loads(path.read_text())["site"]["name"] == "field-1"

"""The report: complete, the same twice, and readable by a browser that runs no script and asks nobody."""

import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.adjustment.projection import CAMERA_SIZE, CENTRE
from calib.errors import CalibrationError
from calib.network import Camera
from calib.simulation.simulation import simulate
from calib.solving.pixel_information import PriorTest
from calib.solving.prediction import directions, predict
from calib.solving.solution import Solution
from calib.solving.solve import SolveOptions, solve
from calib.station.archive.scene_file import load, located
from calib.station.report import HTML, JSON, Summary, summarise, to_html, write_report
from calib.station.report.grade import GRADES, SIGMA_M, grade_of
from edge.common.arrays import Array
from edge.lens import LensModel
from tests.calib.flights import site
from tests.places import ROOT
from tools.doubles.browser import browser


@pytest.fixture(scope="module")
def solution() -> Solution:
    """The study scene, solved."""
    return solve(simulate(load(located("study"))).scene, SolveOptions(evidence=True))


@pytest.fixture(scope="module")
def folder(solution: Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report on it."""
    made = tmp_path_factory.mktemp("report")
    write_report(solution, made)
    return made


class Outline(HTMLParser):
    """What a page consists of, and whom it would ask."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.asks: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        values = [(name, value or "") for name, value in attributes]
        self.asks += [
            v for name, v in values if name in ("src", "href", "xlink:href") and not v.startswith(("#", "data:"))
        ]


def test_the_same_solution_gives_the_same_bytes(solution: Solution, folder: Path, tmp_path: Path) -> None:
    write_report(solution, tmp_path)
    for name in (HTML, JSON):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_the_page_holds_everything_and_asks_nobody(folder: Path) -> None:
    text = (folder / HTML).read_text()
    outline = Outline(text)
    assert outline.asks == []
    assert "script" not in outline.tags
    assert outline.tags.count("svg") == 7
    assert not re.search(r"url\(\s*['\"]?https?:", text)
    for title in ("flight", "Residuals", "Survey and poses", "Clocks", "Lenses", "Shared observations", "Predicted"):
        assert re.search(rf"<h2>[^<]*{title}", text), title


def test_the_json_says_what_the_solution_says(solution: Solution, folder: Path) -> None:
    read = msgspec.json.decode((folder / JSON).read_bytes(), type=Summary)
    assert read == summarise(solution)
    assert [camera.id for camera in read.cameras] == [camera.id for camera in solution.network.cameras]
    assert read.network == solution.network.fingerprint
    assert read.grade in GRADES
    assert [row.distance_m for row in read.predicted] == [100.0, 300.0, 1000.0]
    pairs = {frozenset((pair.one, pair.other)) for pair in read.pairs}
    assert len(pairs) == len(read.cameras) * (len(read.cameras) - 1) // 2


def test_rows_that_were_held_back_lie_where_they_were_expected(solution: Solution) -> None:
    """The simulation's noise is what the adjustment thinks it is, so the ratio of the two is 1.

    Bound: the median of some hundred rows that correlate over a second, three cameras: a factor of 2 either way.
    """
    assert solution.report.evidence is not None
    tested = [held for held in solution.report.evidence.held_out if held is not None]
    assert len(tested) >= 2
    for held in tested:
        assert 0.5 < held.predicted_px / held.expected_px < 2.0


def test_a_report_without_evidence_is_refused(solution: Solution) -> None:
    bare = replace(solution, report=replace(solution.report, evidence=None))
    with pytest.raises(CalibrationError, match="evidence"):
        summarise(bare)


def test_a_camera_left_out_is_named_and_decides_the_grade(solution: Solution) -> None:
    left = replace(solution, report=replace(solution.report, left_out=(("<b>cam9</b>", "no pose explains it"),)))
    summary = summarise(left)
    assert summary.grade >= "C"
    assert any("cam9" in mark.reason for mark in summary.marks)


def solved(**wrong_m: tuple[float, float, float]) -> Solution:
    """A small site of five cameras, of which some are surveyed elsewhere."""
    special = {name: {"survey_error_m": off} for name, off in wrong_m.items()}
    described = site(offsets_s=(0.0,) * 5, duration_s=40.0, frame_rate_hz=10.0, special=special)
    return solve(simulate(described).scene, SolveOptions(evidence=True))


def test_one_voice_names_the_camera_that_is_surveyed_elsewhere() -> None:
    """The mark, the findings and the survey's section: the same camera, and how far off it is."""
    summary = summarise(solved(cam2=(4.0, 0.0, -3.0)))
    decisive = next(mark for mark in summary.marks if mark.name == "claims")
    assert (summary.grade, decisive.grade) == ("C", "C")
    assert "cam2" in decisive.reason
    assert "survey it again" in decisive.action
    assert summary.survey is not None
    assert (summary.survey.suspect, summary.survey.passed) == ("cam2", False)
    assert summary.survey.wrong_by_m == pytest.approx((4.0, 0.0, -3.0), abs=1.3)  # four sigmas of where it is
    others = {"cam1", "cam3", "cam4", "cam5"}
    said = [
        summary.survey.words,
        *summary.findings,
        *(m.reason for m in summary.marks if m.name in ("claims", "survey")),
    ]
    assert not any(name in words for name in others for words in said)
    assert summary.claims is not None
    assert summary.claims.p_value < 1e-6 < summary.claims.p_value_allowed


def test_a_good_site_agrees_and_accuses_nobody() -> None:
    summary = summarise(solved())
    grades = {mark.name: mark.grade for mark in summary.marks}
    assert grades["claims"] == "A"
    assert summary.survey is not None
    assert summary.survey.suspect is None
    assert summary.survey.freedom > 0
    assert summary.survey.passed


def test_a_test_that_could_test_nothing_does_not_read_as_one_that_was_passed(solution: Solution) -> None:
    """With three cameras the lenses may take what the survey is off by: chi-square 0.0 of 0 directions is no test."""
    assert solution.report.evidence is not None
    nothing = PriorTest(np.zeros(0), np.zeros(0), np.zeros((9, 0)))
    blind = replace(solution.report, evidence=replace(solution.report.evidence, survey=nothing))
    summary = summarise(replace(solution, report=blind))
    assert summary.survey is not None
    assert summary.survey.passed is None
    mark = next(mark for mark in summary.marks if mark.name == "survey")
    assert (mark.grade, "agree" in mark.reason, "not tested" in mark.reason) == ("B", False, True)
    assert "not tested" in to_html(replace(solution, report=blind), summary)


def test_names_from_outside_are_escaped(solution: Solution, tmp_path: Path) -> None:
    odd = replace(solution, network=replace(solution.network, site="<script>alert(1)</script>"))
    write_report(odd, tmp_path)
    assert "<script" not in (tmp_path / HTML).read_text()


def test_grades_fall_at_their_bounds() -> None:
    assert [grade_of(value, SIGMA_M) for value in (0.5, 0.51, 2.0, 5.0, 5.01)] == ["A", "B", "C", "D", "E"]


@pytest.mark.program("chromium")
def test_it_opens_with_scripts_disabled(folder: Path, tmp_path: Path) -> None:
    asked: list[str] = []
    with browser() as opened:
        page = opened.new_context(java_script_enabled=False, viewport={"width": 1200, "height": 900}).new_page()
        page.on("request", lambda request: None if request.url.startswith("data:") else asked.append(request.url))
        page.goto((folder / HTML).as_uri())
        assert "Calibration of study" in page.title()
        assert page.locator("svg").first.bounding_box()["height"] > 100
        shots = ROOT / "out" / "screenshots"
        shots.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(shots / "report.png"), full_page=True)
    assert asked == [(folder / HTML).as_uri()]


# What is predicted


def camera(name: str, centre: tuple[float, float, float]) -> Camera:
    """A camera that looks straight north."""
    lens = LensModel("radtan", (1000.0, 1000.0, 999.5, 999.5), (0.0,) * 5, (2000, 2000))
    return Camera(name, lens, np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array(centre))


def test_prediction_is_the_textbook_s_for_a_stereo_pair() -> None:
    """Parallel cameras, baseline b, distance z: sigma_z = sqrt 2 z^2 sigma / (b f), sigma_x = z sigma / (sqrt 2 f)."""
    pair = (camera("left", (-5.0, 0, 0)), camera("right", (5.0, 0, 0)))
    found = predict(pair, np.array([1.0, 1.0]), np.zeros((2 * CAMERA_SIZE,) * 2), np.array([[0.0, 400.0, 0.0]]))
    sigma = np.sqrt(np.diagonal(found.pixels_m2[0]))
    assert sigma[1] == pytest.approx(400.0**2 / (10 * 1000) * np.sqrt(2), rel=1e-3)
    assert sigma[0] == pytest.approx(400.0 / 1000 / np.sqrt(2), rel=1e-3)
    assert np.allclose(found.network_m2, 0.0)


def test_a_survey_error_that_all_cameras_share_moves_the_target_by_as_much() -> None:
    pair = (camera("left", (-5.0, 0, 0)), camera("right", (5.0, 0, 0)))
    covariance: Array = np.zeros((2 * CAMERA_SIZE,) * 2)
    for one in range(2):
        for other in range(2):
            rows = slice(CAMERA_SIZE * one + CENTRE.start, CAMERA_SIZE * one + CENTRE.stop)
            columns = slice(CAMERA_SIZE * other + CENTRE.start, CAMERA_SIZE * other + CENTRE.stop)
            covariance[rows, columns] = 0.04 * np.eye(3)
    found = predict(pair, np.array([1.0, 1.0]), covariance, np.array([[0.0, 100.0, 0.0]]))
    assert np.allclose(found.network_m2[0], 0.04 * np.eye(3), atol=1e-9)


def test_nothing_is_predicted_where_fewer_than_two_see() -> None:
    pair = (camera("left", (-5.0, 0, 0)), camera("right", (5.0, 0, 0)))
    found = predict(pair, np.array([1.0, 1.0]), np.zeros((2 * CAMERA_SIZE,) * 2), np.array([[0.0, -50.0, 0.0]]))
    assert found.cameras.tolist() == [0]
    assert np.isnan(found.sigma_m).all()


def test_directions_are_spread_evenly() -> None:
    """Each octant of the sphere holds an eighth of them, to a row of the spiral."""
    around = directions(800)
    assert np.allclose(np.linalg.norm(around, axis=1), 1.0)
    octant = (around > 0) @ [1, 2, 4]
    assert np.all(np.abs(np.bincount(octant, minlength=8) - 100) <= 10)


def test_solve_writes_the_report_without_slowing_what_does_not() -> None:
    """`base-station` must not load the drawing library before it draws."""
    code = "import sys, calib.station.app; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0

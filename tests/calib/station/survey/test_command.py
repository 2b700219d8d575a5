"""`base-station survey` as an operator uses it: a rover on a real pty, a list, a tape, a frame."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.station.commands import survey as survey_cli
from calib.station.survey import rover_round
from calib.station.survey.store import load_survey
from edge.common.errors import ConfigError
from tests.calib.station.survey.rover import PLACE, Rover

CONFIG = '[site]\nname = "field-1"\n[[camera]]\nid = "cam1"\n[[camera]]\nid = "cam2"\n[[camera]]\nid = "cam3"\n'
ANTENNA = ("--above-lens", "0.2", "--measured-to", "phase-centre")


@pytest.fixture
def rover() -> Iterator[Rover]:
    """A rover that talks."""
    rover = Rover()
    yield rover
    rover.stop()


@pytest.fixture
def call(tmp_path: Path) -> Callable[..., int]:
    """Call the command with a configuration of three cameras."""
    (tmp_path / "base.toml").write_text(CONFIG)

    def call(*arguments: object, ask: Callable[[str], str] = lambda prompt: "") -> int:
        parser = argparse.ArgumentParser()
        survey_cli.add_arguments(parser)
        words = ["--config", str(tmp_path / "base.toml"), *map(str, arguments)]
        return survey_cli.run(parser.parse_args(words), ask)

    return call


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where the survey is kept."""
    return tmp_path / "survey.toml"


class Operator:
    """Answers the questions in order; re-initialises the rover when the second occupation begins."""

    def __init__(self, *answers: str) -> None:
        self.answers = list(answers)
        self.asked: list[str] = []

    def __call__(self, prompt: str) -> str:
        self.asked.append(prompt)
        return self.answers.pop(0)


def when_told(rover: Rover, offset_m: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the rover lose its fix when the operator is told to make it."""
    wait = rover_round.wait_for_lost_fix

    def told(receiver: object, progress: Callable[[str], None]) -> None:
        rover.reinitialise(offset_m)
        wait(receiver, progress)  # type: ignore[arg-type]

    monkeypatch.setattr(rover_round, "wait_for_lost_fix", told)


def test_two_occupations_that_agree_are_stored(
    rover: Rover,
    call: Callable[..., int],
    file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    when_told(rover, (0.01, 0.0, 0.0), monkeypatch)
    operator = Operator("y")
    assert call("occupy", "cam1", "--device", rover.device, "--seconds", 20, *ANTENNA, ask=operator) == 0
    table = load_survey(file).of("cam1")
    assert table is not None
    assert len(table.occupation) == 2
    assert table.position is not None
    assert table.position[2] == pytest.approx(PLACE.altitude_m + PLACE.separation_m - 0.2, abs=2e-3)
    printed = capsys.readouterr().out
    assert "of 20 s" in printed
    assert "10 mm horizontally" in printed


def test_a_false_fix_in_the_second_occupation_is_not_stored(
    rover: Rover, call: Callable[..., int], file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    when_told(rover, (0.2, 0.2, 0.0), monkeypatch)
    with pytest.raises(CalibrationError, match="differ by 283 mm"):
        call("occupy", "cam1", "--device", rover.device, "--seconds", 10, "--yes", *ANTENNA)
    assert not file.exists()


def test_what_the_operator_rejects_is_not_stored(rover: Rover, call: Callable[..., int], file: Path) -> None:
    with pytest.raises(CalibrationError, match="rejected"):
        call("occupy", "cam1", "--device", rover.device, "--seconds", 8, "--once", *ANTENNA, ask=Operator("n"))
    assert not file.exists()


def test_a_round_over_the_tripods(
    rover: Rover, call: Callable[..., int], file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stops = {"cam1": (0.0, 0.0, 0.0), "cam2": (40.0, 0.0, 0.0), "cam9": (0.0, 0.0, 0.0), "cam3": (0.0, 40.0, 0.0)}
    answers = iter(["cam1", "cam2", "cam9", "cam3", "cam1", ""])

    def ask(prompt: str) -> str:
        answer = next(answers)
        rover.offset_m = np.array(stops.get(answer, (0.0, 0.0, 0.0)))
        return answer

    code = call("rover", "--device", rover.device, "--seconds", 8, "--once", "--yes", *ANTENNA, ask=ask)
    printed = capsys.readouterr().out
    assert code == 0
    assert "cam9 is not configured" in printed
    assert "loop closure on cam1" in printed
    assert [table.id for table in load_survey(file).camera] == ["cam1", "cam2", "cam3"]


def test_the_antenna_is_asked_for(rover: Rover, call: Callable[..., int], file: Path) -> None:
    operator = Operator("0.3", "ARP")
    arguments = ("occupy", "cam1", "--device", rover.device, "--seconds", 8, "--once", "--yes")
    with pytest.raises(CalibrationError, match="data sheet"):
        call(*arguments, ask=operator)
    assert ["height" in operator.asked[0], "ARP" in operator.asked[1]] == [True, True]
    with pytest.raises(ConfigError, match="no number"):
        call(*arguments, ask=Operator("a lot"))


def test_entering_showing_taping_framing(
    call: Callable[..., int], file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "list.csv"
    table.write_text(
        "id,lat_deg,lon_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m\n"
        "cam2,48.1003,11.5,500,0.01,0.01,0.02\ncam3,48.1,11.5005,500,0.01,0.01,0.02\n"
    )
    assert call("enter", "cam1", 48.1, 11.5, 500, "--sigma", 0.01, 0.01, 0.02) == 0
    assert call("import", table) == 0
    assert call("tape", "cam1", "cam2", 33.36) == 0
    assert call("frame", "--is", "EPSG:7931", "--epoch", 2026.9, "--from-service", "SAPOS") == 0
    capsys.readouterr()
    assert call() == 0
    shown = capsys.readouterr().out
    assert all(f"cam{i}: 48.1" in shown for i in (1, 2, 3))
    assert "EPSG:7931" in shown
    assert "agrees" in shown
    assert call("drop", "cam3") == 0
    assert [each.id for each in load_survey(file).camera] == ["cam1", "cam2"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("enter", "cam9", 48.1, 11.5, 500, "--sigma", 0.01, 0.01, 0.02),
        ("enter", "cam1", 98.1, 11.5, 500, "--sigma", 0.01, 0.01, 0.02),
        ("import", "/nowhere.csv"),
        ("drop", "cam1"),
        ("tape", "cam1", "cam2", 10),
        ("frame", "--epoch", 3.0),
        ("check", "/nowhere.toml"),
        ("occupy", "cam1", *ANTENNA),
    ],
)
def test_what_cannot_be_done_says_why_and_changes_nothing(
    call: Callable[..., int], file: Path, arguments: tuple[object, ...]
) -> None:
    with pytest.raises(ConfigError) as caught:
        call(*arguments)
    assert caught.value.action
    assert not file.exists()


def enter(call: Callable[..., int], longitude: float, *more: str, ask: Callable[[str], str]) -> int:
    return call("enter", "cam1", 48.1, longitude, 500.0, "--sigma", 0.01, 0.01, 0.02, *more, ask=ask)


def test_a_typed_position_that_contradicts_the_stored_one_asks(call: Callable[..., int], file: Path) -> None:
    enter(call, 11.5, ask=lambda _: "")
    stored, metre = file.read_text(), 1 / 74_500
    asked: list[str] = []
    for answer in ("n", "", "no"):
        with pytest.raises(CalibrationError, match="contradicts"):
            enter(call, 11.5 + 30 * metre, ask=lambda prompt, said=answer: asked.append(prompt) or said)  # type: ignore[misc]
    assert "29.995 m beside" in asked[0]
    assert file.read_text() == stored
    assert enter(call, 11.5 + 0.01 * metre, ask=lambda _: pytest.fail("asked")) == 0
    assert enter(call, 11.5 + 30 * metre, ask=lambda _: "y") == 0
    assert enter(call, 11.5, "--yes", ask=lambda _: pytest.fail("asked")) == 0


def test_an_occupation_that_contradicts_a_typed_position_asks(
    rover: Rover, call: Callable[..., int], file: Path
) -> None:
    """Of a position that somebody typed and the rover's, 30 m apart, either may be the wrong one."""
    height_m = PLACE.altitude_m + PLACE.separation_m - 0.2
    typed = (PLACE.lat_deg + 30 / 111_200, PLACE.lon_deg, height_m)
    call("enter", "cam1", *typed, "--sigma", 0.02, 0.02, 0.04)
    stored = file.read_text()
    once = ("occupy", "cam1", "--device", rover.device, "--seconds", "8", "--once", *ANTENNA)
    operator = Operator("n")
    with pytest.raises(CalibrationError, match="contradicts"):
        call(*once, ask=operator)
    assert "m beside and 0.000 m" in operator.asked[0]
    assert file.read_text() == stored
    assert call(*once, ask=Operator("y", "y")) == 0
    (table,) = load_survey(file).camera
    assert len(table.occupation) == 1


def test_a_round_that_does_not_close_stays_with_its_points_until_they_are_settled(
    rover: Rover, call: Callable[..., int], file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    once = ("--device", rover.device, "--seconds", "20", "--once", "--yes", *ANTENNA)
    for camera, east_m in (("cam1", 0.0), ("cam2", 30.0), ("cam3", 61.3)):
        rover.offset_m = np.array([east_m, 0.0, 0.0])
        assert call("occupy", camera, *once) == 0
    rover.offset_m = np.array([1.3, 0.0, 0.0])
    with pytest.raises(CalibrationError, match=r"1\.30. m beside"):
        call("occupy", "cam1", *once)
    capsys.readouterr()
    call("show")
    assert "not closed: back on cam1" in capsys.readouterr().out
    tables = load_survey(file).camera
    assert all(table.position_sigma and table.position_sigma[0] > 1.29 for table in tables)
    call("trust", "cam1")
    call("trust", "cam2")
    call("drop", "cam3")
    assert "not closed" not in capsys.readouterr().out.splitlines()[-1]
    after = load_survey(file)
    assert after.closure == ()
    assert all(table.position_sigma and table.position_sigma[0] < 0.03 for table in after.camera)


@pytest.mark.parametrize(
    ("said", "setting", "named"),
    [
        ({"separation": "0.0"}, "--separation", "EGM96"),
        ({"separation": f"{-PLACE.separation_m}"}, "--separation", "wrong sign"),
        ({"separation": ""}, "--separation", "missing"),
        ({"age": ""}, "--accept-unknown-age", "age of corrections unknown"),
    ],
)
def test_what_a_setting_has_to_mend_is_said_soon_and_the_setting_mends_it(
    rover: Rover, call: Callable[..., int], file: Path, *, said: dict[str, str], setting: str, named: str
) -> None:
    rover.said = said
    once = ("occupy", "cam1", "--device", rover.device, "--seconds", "20", "--once", "--yes", *ANTENNA)
    with pytest.raises(CalibrationError, match=named):
        call(*once)
    assert not file.exists()
    assert call(*once, setting, *((PLACE.separation_m,) if setting == "--separation" else ())) == 0
    (table,) = load_survey(file).camera
    assert table.position is not None
    assert table.position[2] == pytest.approx(PLACE.altitude_m + PLACE.separation_m - 0.2, abs=2e-3)

"""The guide's survey steps, followed word for word, put the lens where it is; each of its three ways."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from calib.station.config import load
from calib.station.survey.in_force import with_survey
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.receiver import Receiver
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import camera_key
from tests.calib.station.survey.rover import PLACE, Rover
from tools.guide import GUIDE

SITE = "field-1"
NAMES = ("cam0", "cam1", "cam2")
OFFSETS_M = {"cam0": (0.0, 0.0, 0.0), "cam1": (60.0, 0.0, 1.5), "cam2": (0.0, 50.0, -2.0)}  # of the tripods, ENU
FIX_WITHIN_S = 60.0  # on a busy machine
QUESTIONS = re.compile(r"camera to occupy .*?: |now break the corrections|accept \w+\? .*? ")
HEIGHT_WITHIN_M = 0.002  # GGA's millimetres, and the degrees' rounding

_text = GUIDE.read_text()
SECTION = _text[_text.index("## Survey\n") : _text.index("## Aim\n")]


def lines(language: str) -> list[str]:
    """The lines of the section's blocks of one language."""
    return "".join(re.findall(rf"^```{language}\n(.*?)^```", SECTION, re.DOTALL | re.MULTILINE)).splitlines()


def line_with(word: str) -> str:
    """The section's one console line of this action."""
    (line,) = (line for line in lines("console") if word in shlex.split(line))
    return line


def phase_centre_above_lens_m() -> float:
    """How the guide's tripods are built, by its own words."""
    words = r"underside is\s+([\d.]+) m above the lens, and the phase centre ([\d.]+) m above the underside"
    found = re.search(words, SECTION)
    assert found is not None
    return float(found[1]) + float(found[2])


def lens_heights_m() -> list[float]:
    """The truth: the receivers' positions are those of the phase centres."""
    first_m = PLACE.altitude_m + PLACE.separation_m - phase_centre_above_lens_m()
    return [first_m + OFFSETS_M[name][2] for name in NAMES]


def surveyed_heights_m(folder: Path) -> list[float | None]:
    """What the station will use."""
    sections = with_survey(load(folder / "base.toml"), folder).values()
    return [None if section.position is None else section.position[2] for section in sections]


@pytest.fixture
def configure(tmp_path: Path, endpoint: str) -> Callable[..., None]:
    """Write base.toml into the folder in which the lines are typed."""

    def write(**more: object) -> None:
        config = {
            "site": {"name": SITE},
            "state_folder": "state",
            "camera": [{"id": name} for name in NAMES],
            "link": {"listen": [endpoint]},
        }
        (tmp_path / "base.toml").write_text(tomli_w.dumps(config | more))

    return write


def environment() -> dict[str, str]:
    return os.environ | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}


@contextmanager
def box(name: str, endpoint: str, gnss: dict[str, object]) -> Iterator[None]:
    """A box's receiver and link, with the [gnss] that the guide gives it."""
    rover = Rover()
    rover.offset_m = np.array(OFFSETS_M[name])
    try:
        with (
            Receiver(build(gnss | {"device": rover.device}, GnssConfig, where="the guide")) as receiver,
            Link(LinkSettings(connect=(endpoint,)), name=name) as link,
        ):
            while (fix := receiver.fix()) is None:
                assert receiver.wait(FIX_WITHIN_S), receiver.status()
            link.declare_presence(camera_key(SITE, name))
            link.set_state(camera_key(SITE, name, "fix"), fix)
            yield
    finally:
        rover.stop()


def test_a_receiver_on_each_box(configure: Callable[..., None], tmp_path: Path, endpoint: str) -> None:
    configure()
    gnss = tomllib.loads("\n".join(lines("toml")))["gnss"]
    with ExitStack() as stack:
        for name in NAMES:
            stack.enter_context(box(name, endpoint, gnss))
        subprocess.run(shlex.split(line_with("boxes")), cwd=tmp_path, env=environment(), check=True)
    assert surveyed_heights_m(tmp_path) == pytest.approx(lens_heights_m(), abs=HEIGHT_WITHIN_M)


class Operator:
    """Types the line, answers its questions, carries the rover about and makes it lose its fix when it is told to."""

    def __init__(self, rover: Rover, folder: Path) -> None:
        self._rover, self._folder = rover, folder
        self._stops = [*NAMES, NAMES[0], ""]  # and Enter to end
        self.read = ""

    def type(self, line: str) -> int:
        """Do all that the program asks for; its exit code."""
        with subprocess.Popen(
            shlex.split(line), cwd=self._folder, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as program:
            assert program.stdin is not None
            assert program.stdout is not None
            done = 0
            while chunk := os.read(program.stdout.fileno(), 4096):
                self.read += chunk.decode()
                for found in QUESTIONS.finditer(self.read):
                    if found.start() < done:
                        continue
                    done = found.end()
                    answer = self._answer(found[0])
                    if answer is not None:
                        program.stdin.write(f"{answer}\n".encode())
                        program.stdin.flush()
            return program.wait()

    def _answer(self, asked: str) -> str | None:
        if asked.startswith("accept"):
            return "y"
        if asked.startswith("now"):
            east, north, up = self._rover.offset_m.tolist()
            self._rover.reinitialise((east, north, up))
            return None
        stop = self._stops.pop(0)
        self._rover.offset_m = np.array(OFFSETS_M.get(stop, (0.0, 0.0, 0.0)))
        return stop


def test_one_rover(configure: Callable[..., None], tmp_path: Path) -> None:
    rover = Rover()
    try:
        configure(receiver={"device": rover.device})
        operator = Operator(rover, tmp_path)
        assert operator.type(line_with("rover")) == 0, operator.read
    finally:
        rover.stop()
    assert "loop closure on cam0" in operator.read
    assert surveyed_heights_m(tmp_path) == pytest.approx(lens_heights_m(), abs=HEIGHT_WITHIN_M)


def test_typed_in(configure: Callable[..., None], tmp_path: Path) -> None:
    configure()
    typed = {}
    for line in lines("sh"):
        printed = subprocess.run(
            shlex.split(line), cwd=tmp_path, env=environment(), check=True, capture_output=True, text=True
        ).stdout
        if (entered := re.search(r"enter (\w+) [\d.]+ [\d.]+ ([\d.]+)", line)) is not None:
            typed[entered[1]] = float(entered[2])
    assert surveyed_heights_m(tmp_path) == [typed[name] for name in NAMES]
    assert "survey minus tape" in printed
    assert "agrees" in printed

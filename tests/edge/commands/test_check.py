"""`edge-node check`, in this process: one line for each thing the box depends on, and what to do about it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from edge.app import DONE, FAILED, MISUSED, main
from edge.commands.check import check_box
from edge.common.health import Check
from edge.config import BoxConfig, load
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import station_key
from tests.edge.footage import flight, sky, write_video

SIZE = (320, 240)
CONFIG = """
site = "test"
[[camera]]
id = "cam1"
source = {{ path = "{folder}/flight.mp4", t0_unix_ns = 1700000000000000000, bound_s = 0.001 }}
lens = "lens.toml"
[detector]
model = "{model}"
[clock]
source = "assumed"
[spool]
folder = "{folder}/spool"
[link]
connect = ["{endpoint}"]
"""
LENS = 'model = "radtan"\nintrinsics = [300.0, 300.0, 159.5, 119.5]\ndistortion = [0, 0, 0, 0]\nsize_px = [320, 240]\n'


@pytest.fixture
def box(tmp_path: Path, model: Path, endpoint: str) -> Path:
    """A box that lacks nothing but a base station."""
    rng = np.random.default_rng(8)
    write_video(tmp_path / "flight.mp4", [sky(SIZE, [place], rng) for place in flight(15)], 30)
    (tmp_path / "lens.toml").write_text(LENS)
    file = tmp_path / "edge.toml"
    file.write_text(CONFIG.format(folder=tmp_path, model=model, endpoint=endpoint))
    return file


@pytest.fixture
def base(endpoint: str) -> Iterator[None]:
    """A base station of that site."""
    with Link(LinkSettings(listen=(endpoint,)), name="base") as link:
        link.declare_presence(station_key("test"))
        assert link.wait_open(10)
        yield


def found(file: Path) -> dict[str, Check]:
    return {check.name: check for check in check_box(load(file, BoxConfig), file)}


def change(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.mark.usefixtures("base")
def test_a_box_that_is_well(box: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checks = found(box)
    assert {name for name, check in checks.items() if check.level == "ok"} >= {
        "configuration", "lens cam1", "camera cam1", "detector cam1", "spool", "link",
    }  # fmt: skip
    assert "320 x 240 frames, timed by file, uncertain by 1 ms" in checks["camera cam1"].reason
    assert main(["check", "--config", str(box)]) == DONE
    out = capsys.readouterr().out
    assert '"site": "test"' in out
    assert "PASS link: the base station answers" in out
    assert "WARN clock: assumed" in out


def test_without_a_base_it_says_so_and_that_is_no_failure(box: Path) -> None:
    # Nobody listens at all: the session still opens, and waits.
    check = found(box)["link"]
    assert check.level in ("warn", "fail")
    assert check.action


@pytest.mark.parametrize(
    ("old", "new", "name", "words"),
    [
        ('"lens.toml"', '"none.toml"', "lens cam1", "no such lens file"),
        ("flight.mp4", "none.mp4", "camera cam1", "no such file"),
        ("dots.onnx", "none.onnx", "camera cam1", "no such model file"),
        ("/spool", "/lens.toml/spool", "spool", "cannot be written to"),
    ],
)
def test_each_fault_is_a_finding_beside_the_others(box: Path, old: str, new: str, name: str, words: str) -> None:
    change(box, old, new)
    checks = found(box)
    assert checks[name].level == "fail"
    assert words in checks[name].reason
    assert checks[name].action
    assert checks["configuration"].level == "ok"
    assert "link" in checks


def test_a_recording_without_frames(box: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    change(box, "flight.mp4", "empty")
    assert "holds no picture" in found(box)["camera cam1"].reason


def test_undated_frames_are_warned_of(box: Path) -> None:
    change(box, ", t0_unix_ns = 1700000000000000000, bound_s = 0.001", "")
    check = found(box)["camera cam1"]
    assert (check.level, "uncertain by unknown" in check.reason) == ("warn", True)


def test_a_receiver_that_is_not_there(box: Path, capsys: pytest.CaptureFixture[str]) -> None:
    box.write_text(box.read_text() + '[gnss]\ndevice = "/dev/skyfix-none"\n')
    check = found(box)["gnss"]
    assert check.level == "fail"
    assert "absent" in check.reason
    assert main(["check", "--config", str(box)]) == FAILED
    assert "FAIL gnss: absent" in capsys.readouterr().out


def test_what_is_misused_is_told_from_what_fails(box: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--config", str(box.parent / "none.toml")]) == MISUSED
    assert main(["run", "--config", str(box), "--camera", "cam9"]) == MISUSED
    assert "has no camera cam9" in capsys.readouterr().err

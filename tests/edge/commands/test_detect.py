"""`edge-node detect`, in this process: what the model sees, as rows that `solve` reads, and as pictures."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.station.archive import tables, track_columns
from edge.app import DONE, FAILED, MISUSED, main
from tests.edge.footage import flight, sky, write_video

SIZE = (320, 240)
T0 = 1_700_000_000 * 10**9
FRAMES = 45


@pytest.fixture
def video(tmp_path: Path) -> Path:
    rng = np.random.default_rng(8)
    return write_video(tmp_path / "a flight.mp4", [sky(SIZE, [place], rng) for place in flight(FRAMES)], 30)


def rows(folder: Path, camera: str) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "tracks" / f"{camera}.csv").read_text().splitlines()))


def test_a_flight_becomes_a_track_folder_and_a_sheet(
    video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "tracks of it"
    assert main(["detect", str(video), "-o", str(out), "--model", str(model), "--t0", str(T0)]) == DONE
    said = capsys.readouterr()
    assert f"{FRAMES} frames, 1 tracks" in said.out
    assert said.err == ""  # no terminal, no bar
    found = rows(out, "a-flight")
    assert len(found) >= FRAMES - 10
    assert len({row["track"] for row in found}) == 1
    for row in found:
        u, v = flight(FRAMES)[round((int(row["t_unix_ns"]) - T0) * 30 / 1e9)]
        assert (float(row["u_px"]), float(row["v_px"])) == pytest.approx((u, v), abs=1.6)
    table = tables.read(out / "tracks" / "a-flight.csv", ("t_unix_ns", "u_px", "v_px"))
    assert track_columns.stamps(table)[1].all()
    sheet = cv2.imread(str(out / "a-flight.jpg"))
    assert sheet.shape[1] == 1200
    assert sheet.shape[0] > 1200 * 240 / 320 + 150


def test_a_folder_a_mask_and_the_same_again(video: Path, model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(8)
    for k, place in enumerate(flight(FRAMES)):
        image = sky(SIZE, [place, (place[0], place[1] + 120)], rng)
        cv2.imwrite(str(folder / f"{k}.png"), image)
    mask = tmp_path / "mask.toml"
    mask.write_text("size_px = [320, 240]\n[[region]]\ncorners_px = [[0, 140], [319, 140], [319, 239], [0, 239]]\n")
    tables_ = []
    for name, more in (("one", ["--mask", str(mask)]), ("two", ["--mask", str(mask)]), ("all", [])):
        out = tmp_path / name
        command = ["detect", str(folder), "-o", str(out), "--model", str(model), "--fps", "30", "--camera", "north"]
        assert main([*command, *more]) == DONE
        tables_.append((out / "tracks" / "north.csv").read_bytes())
    assert tables_[0] == tables_[1]
    assert {row["track"] for row in rows(tmp_path / "one", "north")} == {"1"}
    assert len({row["track"] for row in rows(tmp_path / "all", "north")}) == 2


def test_a_configuration_gives_lens_and_detector(video: Path, model: Path, tmp_path: Path) -> None:
    lens = (
        'model = "radtan"\nintrinsics = [300.0, 300.0, 159.5, 119.5]\ndistortion = [0, 0, 0, 0]\nsize_px = [320, 240]\n'
    )
    (tmp_path / "lens.toml").write_text(lens)
    config = tmp_path / "edge.toml"
    config.write_text(
        f'site = "hill"\n[[camera]]\nid = "cam7"\nlens = "lens.toml"\nsource.path = "/dev/video0"\n'
        f'[detector]\nmodel = "{model}"\n'
    )
    assert main(["detect", str(video), "-o", str(tmp_path / "out"), "--config", str(config)]) == DONE
    assert len(rows(tmp_path / "out", "cam7")) >= FRAMES - 10


@pytest.mark.parametrize(
    "case",
    [
        ("rtsp://me:secret@10.0.0.1/s", [], MISUSED, "is a camera, not a recording"),
        ("none.mp4", [], FAILED, "no such file"),
        (".", [], FAILED, "holds no picture"),
        ("video", ["--t0", "17"], MISUSED, "t0_unix_ns"),
        ("video", ["--model", "none.onnx"], FAILED, "no such model file"),
        ("video", ["--camera", "a b"], MISUSED, "id"),
        ("video", ["--fps", "0"], MISUSED, "fps"),
        ("video", ["--mask", "none.toml"], MISUSED, "cannot be read"),
    ],
)
def test_what_cannot_be_done_is_said(
    video: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    case: tuple[str, list[str], int, str],
) -> None:
    source, more, code, said = case
    tmp_path = video.parent
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    path = str(video) if source == "video" else source
    assert main(["detect", path, "-o", "out", *more]) == code
    told = capsys.readouterr().err
    assert said in told
    assert "secret" not in told

"""`base-station solve` on recordings that a real station made: with what is in them, or with another survey."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.geodesy import ecef_to_enu, enu_to_geodetic
from calib.station.app import main
from calib.station.archive import recording
from calib.station.archive.recording import Recorder
from calib.station.config import BaseConfig, CameraSection, SiteSection
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from calib.station.core.surveyed_site import SurveyedSite
from edge import __version__
from edge.messages import encode, station_key
from tools.doubles.box_messages import SITE, messages
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Scene, Spec, make

SPEC = Spec(cameras=4, uavs=1, rate_hz=10.0, duration_s=40.0, noise_px=0.5)
NS = 10**9


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make(SPEC)


def places(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """Where the lenses truly are."""
    found = {}
    for camera in scene.truth:
        lat, lon, height = enu_to_geodetic(camera.centre_enu[None], ORIGIN)[0].tolist()
        found[camera.id] = (lat, lon, height)
    return found


def record(
    scene: Scene, folder: Path, *, fixes: bool = True, survey: SurveyedSite | None = None, **limits: int
) -> Path:
    """What a station records of the scene: each message before it is computed from, and what the station says of it."""
    sections = [CameraSection(id=camera.id) for camera in scene.truth]
    config = BaseConfig(site=SiteSection(name=SITE, origin=ORIGIN), camera=sections)
    station = Station(config, {section.id: section for section in sections}, StoredState())
    recorder = Recorder(folder, SITE, **{"min_free_mb": 1, **limits})
    if survey is not None:
        recorder.hold(station_key(SITE, "survey"), encode(survey.message(T0_UNIX_NS)))
    for sent in messages(scene):
        if sent.key.endswith("/fix") and not fixes:
            continue
        recorder.write(sent.key, sent.payload, sent.arrival_ns)
        station.handle(sent.key, sent.payload, sent.arrival_ns)
        for topic, message in station.tick(sent.arrival_ns).publish:
            recorder.write(station_key(SITE, topic), encode(message), sent.arrival_ns)
    recorder.close()
    assert recorder.path is not None
    return recorder.path


def configuration(folder: Path, positions: dict[str, tuple[float, float, float]], site: str = SITE) -> Path:
    """A base.toml with typed positions."""
    cameras = "".join(f'[[camera]]\nid = "{name}"\nposition = {list(place)}\n' for name, place in positions.items())
    path = folder / "base.toml"
    path.write_text(f'[site]\nname = "{site}"\norigin = {list(ORIGIN)}\n{cameras}')
    return path


def flown(out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and ENU positions about ORIGIN of a trajectory.csv, from its ECEF columns."""
    rows = np.genfromtxt(out / "trajectory.csv", delimiter=",", skip_header=2)
    return np.loadtxt(out / "trajectory.csv", np.int64, delimiter=",", skiprows=2, usecols=0), ecef_to_enu(
        rows[:, 2:5], ORIGIN
    )


def error_m(out: Path, scene: Scene) -> np.ndarray:
    """Mean error of the flight, east, north, up."""
    stamps, points = flown(out)
    assert len(stamps) > 100
    true = np.array([scene.positions(int(t))[0] for t in stamps])
    return np.asarray((points - true).mean(axis=0))


RIGHT_M = 0.25  # three of the flight's own sigmas here; a survey half a metre off shows


def test_with_the_fixes_that_are_in_it(scene: Scene, tmp_path: Path) -> None:
    path = record(scene, tmp_path)
    assert main(["solve", str(path), "-o", str(tmp_path / "out")]) == 0
    assert np.abs(error_m(tmp_path / "out", scene)).max() < RIGHT_M
    for name in ("network.toml", "report.html", "report.json"):
        assert (tmp_path / "out" / name).stat().st_size > 0


def test_the_grade_and_why_are_printed_as_the_report_has_them(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, moved = record(scene, tmp_path), places(scene)
    name = min(moved)
    moved[name] = (moved[name][0], moved[name][1], moved[name][2] - 30.0)
    config = configuration(tmp_path, moved)
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 0
    report = msgspec.json.decode((tmp_path / "out" / "report.json").read_bytes())
    printed = capsys.readouterr().out.splitlines()
    assert f"grade {report['grade']}: {report['verdict']}" in printed
    assert f"what would improve it most: {report['improvement']}" in printed
    assert report["grade"] >= "C"
    assert any(line.startswith("found: ") and name in line for line in printed)


def test_typed_positions_apply_to_a_recording_without_fixes(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, config = record(scene, tmp_path, fixes=False), configuration(tmp_path, places(scene))
    assert main(["solve", str(path), "-o", str(tmp_path / "none")]) == 1
    assert "0 calibrated cameras have a surveyed position" in capsys.readouterr().err
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 0
    assert np.abs(error_m(tmp_path / "out", scene)).max() < RIGHT_M


def test_a_survey_beside_the_configuration_applies_too(scene: Scene, tmp_path: Path) -> None:
    path = record(scene, tmp_path, fixes=False)
    cameras = "".join(f'[[camera]]\nid = "{camera.id}"\n' for camera in scene.truth)
    (tmp_path / "base.toml").write_text(f'[site]\nname = "{SITE}"\nsurvey = "site.toml"\n{cameras}')
    rows = "".join(
        f'[[camera]]\nid = "{name}"\nsize_px = [1920, 1080]\nlens = "radtan"\nintrinsics = [1300, 1300, 960, 540]\n'
        f"distortion = [0, 0, 0, 0]\nposition = {list(place)}\n"
        for name, place in places(scene).items()
    )
    (tmp_path / "site.toml").write_text(f'[site]\nname = "{SITE}"\n{rows}')
    arguments = ["solve", str(path), "--config", str(tmp_path / "base.toml"), "-o", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert np.abs(error_m(tmp_path / "out", scene)).max() < RIGHT_M


def test_the_survey_in_the_recording_is_enough(scene: Scene, tmp_path: Path) -> None:
    known = SurveyedSite(SITE, ORIGIN, {n: CameraSection(id=n, position=p) for n, p in places(scene).items()})
    path = record(scene, tmp_path, fixes=False, survey=known)
    assert main(["solve", str(path), "-o", str(tmp_path / "out")]) == 0
    assert np.abs(error_m(tmp_path / "out", scene)).max() < RIGHT_M


def test_another_survey_replaces_the_recorded_one(scene: Scene, tmp_path: Path) -> None:
    path = record(scene, tmp_path)
    raised = {name: (lat, lon, height + 0.5) for name, (lat, lon, height) in places(scene).items()}
    config = configuration(tmp_path, raised)
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 0
    assert error_m(tmp_path / "out", scene)[2] == pytest.approx(0.5, abs=RIGHT_M)


def test_a_later_file_of_a_long_recording_is_solved_by_itself(tmp_path: Path) -> None:
    """Its survey and lenses were said long before it began."""
    long = make(replace(SPEC, rate_hz=20.0, duration_s=60.0))
    known = SurveyedSite(SITE, ORIGIN, {n: CameraSection(id=n, position=p) for n, p in places(long).items()})
    record(long, tmp_path / "long", fixes=False, survey=known, max_file_mb=1)
    later = sorted((tmp_path / "long").glob("*.mcap"))[1]
    assert next(recording.read(later)).key == station_key(SITE, "survey")
    assert main(["solve", str(later), "-o", str(tmp_path / "out")]) == 0
    assert np.abs(error_m(tmp_path / "out", long)).max() < 2 * RIGHT_M, "a third of the flight"


@pytest.mark.parametrize("text", [None, "this is no toml at all", '[site]\nname = "bench"\n'])
def test_a_configuration_that_is_none_is_wrong_usage_and_named(
    text: str | None, scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "other.toml"
    if text is not None:
        config.write_text(text)
    path = record(scene, tmp_path)
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 2
    assert str(config) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_configuration_of_another_site_is_refused(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = configuration(tmp_path, places(scene), site="meadow")
    path = record(scene, tmp_path)
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 2
    assert "of site 'meadow', the recording of 'bench'" in capsys.readouterr().err


def test_a_camera_that_the_configuration_does_not_name_is_named_and_left_out(
    scene: Scene, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    known = places(scene)
    del known["cam3"]
    path, config = record(scene, tmp_path), configuration(tmp_path, known)
    assert main(["solve", str(path), "--config", str(config), "-o", str(tmp_path / "out")]) == 0
    assert "camera cam3: the configuration does not name it: left out" in caplog.text
    assert "cam3" not in (tmp_path / "out" / "network.toml").read_text()


def test_a_track_folder_has_its_survey_in_it(tmp_path: Path, scene: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    config = configuration(tmp_path, places(scene))
    (tmp_path / "folder").mkdir()
    arguments = ["solve", str(tmp_path / "folder"), "--config", str(config), "-o", str(tmp_path / "out")]
    assert main(arguments) == 2
    assert "leave --config out" in capsys.readouterr().err


def test_a_recording_that_breaks_off_is_solved_up_to_there(scene: Scene, tmp_path: Path) -> None:
    path = record(scene, tmp_path)
    whole = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 9 // 10 + 7])
    assert main(["solve", str(cut), "-o", str(tmp_path / "out")]) == 0
    stamps, _ = flown(tmp_path / "out")
    assert 33 < (stamps[-1] - stamps[0]) / NS < 38
    cut.write_bytes(whole[:20])
    assert main(["solve", str(cut), "-o", str(tmp_path / "out2")]) == 2


def test_the_trajectory_says_where_it_is_and_the_same_input_gives_the_same_bytes(scene: Scene, tmp_path: Path) -> None:
    path = record(scene, tmp_path)
    assert main(["solve", str(path), "-o", str(tmp_path / "one")]) == 0
    assert main(["solve", str(path), "-o", str(tmp_path / "two")]) == 0
    one, two = ((tmp_path / out / "trajectory.csv").read_bytes() for out in ("one", "two"))
    assert one == two
    about, header, first, *_ = one.decode().splitlines()
    assert about.startswith("# origin ")
    assert abs(float(about.split()[2]) - ORIGIN[0]) < 1e-4  # degrees: the middle of the cameras, within metres of it
    assert __version__ in about
    assert about.endswith(f"from {path.name}")
    row = dict(zip(header.split(","), map(float, first.split(",")), strict=True))
    geodetic = np.array([[row["lat_deg"], row["lon_deg"], row["height_m"]]])
    enu = enu_to_geodetic(
        np.array([[row["east_m"], row["north_m"], row["up_m"]]]), tuple(map(float, about.split()[2:5]))
    )
    assert geodetic == pytest.approx(enu, abs=2e-4)
    assert geodetic[0, :2] == pytest.approx(enu[0, :2], abs=1e-8), "a millimetre"

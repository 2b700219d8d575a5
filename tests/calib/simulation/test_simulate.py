"""A simulation is only worth something if its truth is exact and its errors are the ones asked for."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from calib.geodesy import geodetic_to_enu
from calib.network import from_toml
from calib.simulation.description import Bump, CameraSpec, ClockStep, LensFault, ObjectSpec, Simulation
from calib.simulation.simulation import Simulated, disturb, simulate, watch
from calib.station.app import main
from calib.station.archive.scene_file import load, located
from calib.station.archive.simulated_folder import write_folder

STUDY = located("study")
CIRCLE = [(60.0 * np.cos(a), 60.0 * np.sin(a), 40.0 + 5 * np.sin(3 * a)) for a in np.linspace(0, 6, 25)]


def camera(**changes: object) -> CameraSpec:
    """A camera that sees all of the circle, with every systematic effect on and every random one off."""
    known: dict[str, object] = {
        "id": "cam0",
        "centre_enu": (0.0, -170.0, 0.0),
        "look_at_enu": (0.0, 0.0, 40.0),
        "roll_deg": 3.0,
        "distortion": (-0.1, 0.02, 1e-3, -1e-3),
        "clock_offset_s": 0.4,
        "clock_rate": 200e-6,
        "readout_s": 0.03,
    }
    return CameraSpec(**(known | changes))  # type: ignore[arg-type]


def scene(*cameras: CameraSpec, seed: int = 5) -> Simulation:
    circle = ObjectSpec(waypoints_enu=tuple(CIRCLE), step_s=2.0)
    return Simulation(seed=seed, duration_s=46.0, object=(circle,), camera=cameras or (camera(),))


def residuals_px(simulated: Simulated, camera_id: str = "cam0") -> np.ndarray:
    """Reported minus predicted from the truth, by the network's own model of clocks and shutter."""
    rows, truth = simulated.rows[camera_id], simulated.network.camera(camera_id)
    assert truth is not None
    t_s = truth.site_time_s(rows.t_unix_ns, rows.pixels[:, 1], simulated.network.t_mid_unix_ns)
    at = simulated.flights[0].position_enu(t_s + simulated.duration_s / 2)
    return rows.pixels - truth.project(at)


def test_truth_is_exact_with_clock_shutter_and_lens() -> None:
    simulated = simulate(scene())
    assert len(simulated.rows["cam0"].track) == 1381
    # A pixel near 1000 is a double to 1e-13; the lens inverse stops at 1e-12 rays, 1e-9 px at this focal length.
    assert np.abs(residuals_px(simulated)).max() < 1e-9


def test_same_trial_same_numbers_and_other_trial_others() -> None:
    watched = watch(scene(camera(noise_px=1.0, dropout=0.2, clutter_per_frame=0.1)))
    first, again, other = (disturb(watched, trial).rows["cam0"] for trial in (0, 0, 1))
    assert np.array_equal(first.pixels, again.pixels)
    assert np.array_equal(first.t_unix_ns, again.t_unix_ns)
    assert len(first.track) != len(other.track) or not np.array_equal(first.pixels, other.pixels)


def test_each_kind_of_error_has_a_stream_of_its_own() -> None:
    alone = simulate(scene(camera(noise_px=1.0))).rows["cam0"]
    both = simulate(scene(camera(noise_px=1.0, dropout=0.3, clutter_per_frame=0.5))).rows["cam0"]
    objects = both.source == 1
    shared = np.isin(alone.t_unix_ns, both.t_unix_ns[objects])
    assert 0.6 < shared.mean() < 0.8  # 0.3 dropped of 1381 frames: one sigma 0.012
    assert np.array_equal(alone.pixels[shared], both.pixels[objects])


@pytest.mark.parametrize(("kind", "sigma"), [("gaussian", 2.0), ("uniform", 2.0 / np.sqrt(3))])
def test_noise_has_the_sigma_asked_for(kind: str, sigma: float) -> None:
    found = residuals_px(simulate(scene(camera(noise=kind, noise_px=2.0, readout_s=0.0))))
    # One sigma of a standard deviation from 2 x 1381 draws is 1.3 %; four of them.
    assert np.std(found) == pytest.approx(sigma, rel=0.055)


def test_drift_is_correlated_over_the_time_asked_for() -> None:
    long = Simulation(
        seed=2,
        duration_s=2000.0,
        object=(ObjectSpec(waypoints_enu=((0, 0, 40), (1, 0, 40)), step_s=2000.0),),
        camera=(camera(drift_px=1.0, drift_s=0.5, readout_s=0.0, distortion=(0.0, 0.0, 0.0, 0.0)),),
    )
    error = residuals_px(simulate(long))[:, 0]
    lag = 15  # frames of 1/30 s: one correlation time, so 1/e is left
    # 2000 s hold 2000 independent pieces of 2 tau: 0.022 one sigma; four of them.
    assert np.corrcoef(error[:-lag], error[lag:])[0, 1] == pytest.approx(np.exp(-1), abs=0.09)
    assert np.std(error) == pytest.approx(1.0, rel=0.09)


def test_misses_come_in_runs_of_the_length_asked_for() -> None:
    watched = watch(scene(camera(dropout=0.25, dropout_length_s=0.5)))
    gaps = []
    for trial in range(40):
        frames = np.round((disturb(watched, trial).rows["cam0"].t_unix_ns - watched.simulation.start_unix_ns) * 30e-9)
        gaps.append(np.diff(frames) - 1)
    missed = np.concatenate(gaps)
    # About 23 runs a trial, 920 in all, each geometric with a spread like its mean: 3.3 % one sigma.
    assert missed[missed > 0].mean() == pytest.approx(15.0, rel=0.13)
    assert missed.sum() / (missed.sum() + len(missed)) == pytest.approx(0.25, abs=0.04)


def test_clutter_is_poisson_and_numbered_apart() -> None:
    rows = simulate(scene(camera(clutter_per_frame=0.5))).rows["cam0"]
    clutter = rows.source == 0
    assert clutter.sum() == pytest.approx(0.5 * 1381, abs=4 * np.sqrt(0.5 * 1381))
    assert len(np.unique(rows.track[clutter])) == clutter.sum()
    assert not set(rows.track[clutter]) & set(rows.track[~clutter])
    assert np.all(np.diff(rows.t_unix_ns) >= 0)


def test_outliers_are_anywhere_and_marked_as_nobodys() -> None:
    simulated = simulate(scene(camera(outlier=0.3)))
    rows = simulated.rows["cam0"]
    wrong = np.linalg.norm(residuals_px(simulated), axis=1) > 1.0
    assert np.array_equal(wrong, rows.source == 0)
    assert wrong.mean() == pytest.approx(0.3, abs=0.05)


def test_a_knock_turns_the_camera_from_then_on() -> None:
    knocked = camera(bump=(Bump(at_s=20.0, rotation_deg=(0.0, 0.3, 0.0)),), clock_offset_s=0.0, clock_rate=0.0)
    simulated = simulate(scene(knocked))
    t_s = (simulated.rows["cam0"].t_unix_ns - simulated.start_unix_ns) * 1e-9
    error = residuals_px(simulated)
    assert np.abs(error[t_s < 19.9]).max() < 1e-9
    # 0.3 deg about the vertical image axis moves a pixel by f tan(0.3 deg) = 5.2 px near the middle.
    assert np.median(error[t_s > 20.1, 0]) == pytest.approx(5.2, abs=1.0)


def test_a_clock_step_makes_later_stamps_later() -> None:
    stepped = camera(clock_step=(ClockStep(at_s=20.0, step_s=0.05),), readout_s=0.0, clock_offset_s=0, clock_rate=0)
    simulated = simulate(scene(stepped))
    rows, truth = simulated.rows["cam0"], simulated.network.cameras[0]
    t_s = (rows.t_unix_ns - simulated.start_unix_ns) * 1e-9
    shown = truth.project(simulated.flights[0].position_enu(t_s - 0.05))
    assert np.abs((rows.pixels - shown)[t_s > 20.0]).max() < 1e-9


def test_survey_and_lens_errors_are_published_and_not_true() -> None:
    wrong = camera(
        survey_error="gaussian",
        survey_sigma_m=(0.1, 0.1, 0.2),
        survey_error_m=(1.0, 0.0, 0.0),
        lens_error=LensFault(focal=0.01),
    )
    watched = watch(scene(wrong))
    drawn = [disturb(watched, trial) for trial in range(200)]
    published = np.array([trial.scene.cameras[0].position_enu for trial in drawn])
    true = drawn[0].network.cameras[0]
    # 200 draws: the mean is good to sigma / sqrt(200), the deviation to 5 %; four sigma each.
    assert published.mean(axis=0) - true.centre_enu == pytest.approx([1.0, 0.0, 0.0], abs=0.06)
    assert published.std(axis=0) == pytest.approx([0.1, 0.1, 0.2], rel=0.2)
    focal = np.array([trial.scene.cameras[0].lens.intrinsics[0] for trial in drawn])
    assert true.lens.intrinsics[0] == 1000.0
    assert focal.std() == pytest.approx(10.0, rel=0.2)


def test_folder_holds_the_scene_and_its_truth(tmp_path: Path) -> None:
    simulated = simulate(load(STUDY))
    write_folder(simulated, tmp_path / "a")
    write_folder(simulated, tmp_path / "b")
    for file in ("site.toml", "truth.toml", "truth.csv", "tracks/cam0.csv", "truth/drone.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    network = from_toml((tmp_path / "a" / "truth.toml").read_text())
    assert [one.id for one in network.cameras] == ["cam0", "cam1", "cam2"]
    rows = np.loadtxt(tmp_path / "a" / "tracks" / "cam1.csv", delimiter=",", skiprows=1, usecols=(1, 2))
    assert rows == pytest.approx(simulated.rows["cam1"].pixels, abs=1e-9)
    site = tomllib.loads((tmp_path / "a" / "site.toml").read_text())
    for entry, known in zip(site["camera"], simulated.scene.cameras, strict=True):
        found = geodetic_to_enu(np.array([entry["position"]]), simulated.scene.origin)[0]
        assert found == pytest.approx(known.position_enu, abs=1e-6)


def test_study_scene_is_the_published_one() -> None:
    truth = simulate(load(STUDY)).network
    assert [round(float(np.linalg.norm(one.centre_enu)), 9) for one in truth.cameras] == [100.0] * 3
    assert truth.cameras[0].project(np.array([[0.0, 0.0, 65.0]]))[0] == pytest.approx([960.0, 540.0])


def test_program_writes_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(STUDY), "-o", str(tmp_path / "out"), "--trial", "3"]) == 0
    assert "seed 1, trial 3" in capsys.readouterr().out
    assert (tmp_path / "out" / "truth.csv").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed = 1\nnoize = 2\n", "noize"),
        (
            'seed = 1\n[[object]]\nwaypoints_enu = [[0,0,1],[1,0,1]]\n[[camera]]\nid="a"\ncentre_enu=[0,0,0]\n' * 1
            + '[[camera]]\nid="a"\ncentre_enu=[0,0,0]\n',
            "'a' given twice",
        ),
        (
            "seed = 1\n[[object]]\nwaypoints_enu = [[0,0,1],[1,0,1]]\ntimes_s=[1.0]\n"
            '[[camera]]\nid="a"\ncentre_enu=[0,0,0]\n',
            "1 times for 2 waypoints",
        ),
        (
            "seed = 1\n[[object]]\nwaypoints_enu = [[0,0,1],[1,0,1]]\n"
            '[[camera]]\nid="a"\ncentre_enu=[0,0,0]\nlook_at_enu=[0,0,9]\n',
            "straight up",
        ),
    ],
)
def test_a_wrong_scene_is_refused_by_name(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(text)
    assert main(["simulate", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err

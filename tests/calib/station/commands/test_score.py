"""The score must find a truth whose clock and frame are its own, and must not flatter what it scores."""

import json
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.geometry.rotation import rotation
from calib.scoring.alignment import ALIGNMENTS, fit
from calib.scoring.consistency import Stated
from calib.scoring.timing import Path
from calib.scoring.trajectory import evaluate
from calib.station.app import main
from edge.common.errors import SkyfixError

START_S = 1_780_000_000.0


def flight(t_s: np.ndarray) -> np.ndarray:
    """Loops of 20 s whose shape changes slowly: nearly the same one loop later, as real flights are."""
    phase = 2 * np.pi * t_s / 20.0
    wide = 50.0 + 0.1 * t_s
    return np.column_stack([wide * np.cos(phase), 30 * np.sin(phase), 40 + 5 * np.sin(0.7 * phase) + 0.02 * t_s])


def paths(shift_s: float = 0.0, rate: float = 0.0, noise_m: float = 0.0) -> tuple[Path, Path]:
    """A truth at 5 Hz on a clock of its own, and an estimate of most of it at 20 Hz with holes, since 1970."""
    truth_t = np.arange(0.0, 240.0, 0.2)
    true_t = truth_t + rate * (truth_t - 119.9)
    estimate_t = np.arange(20.0, 230.0, 0.05)
    estimate_t = estimate_t[estimate_t % 50.0 < 38.0]
    noise = np.random.default_rng(3).normal(0.0, noise_m, (len(estimate_t), 3))
    return Path(estimate_t + START_S + shift_s, flight(estimate_t) + noise), Path(truth_t, flight(true_t))


def test_figures_are_what_their_names_say() -> None:
    t = np.arange(4.0)
    truth = Path(t, np.column_stack([t, np.zeros(4), np.zeros(4)]))
    error = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    result = evaluate(Path(t, truth.enu + error), truth, "none", "none", max_gap_s=1.0)
    assert result.rmse_m == pytest.approx(np.sqrt(26 / 4))
    assert result.mae_1_norm_m == pytest.approx(8 / 4)
    assert result.mae_2_norm_m == pytest.approx(6 / 4)
    assert result.maximum_m == pytest.approx(5.0)
    assert result.median_m == pytest.approx(0.5)
    assert result.rmse_axis_m == pytest.approx((1.5, 2.0, 0.5))
    assert result.r_squared == pytest.approx(1 - 26 / 5)  # the truth's spread is 5 m^2, all of it east


@settings(max_examples=6, deadline=None)
@given(shift_s=st.floats(-300, 300), rate=st.floats(-0.006, 0.006), yaw=st.floats(-3.1, 3.1))
def test_clock_and_yaw_are_found(shift_s: float, rate: float, yaw: float) -> None:
    estimate, truth = paths(shift_s, rate)
    turned = Path(estimate.t_s, estimate.enu @ rotation([0.0, 0.0, yaw]).T + [40.0, -7.0, 11.0])
    result = evaluate(turned, truth, "yaw", "rate")
    # Linear interpolation over 0.05 s at 7 m/s^2 errs by a dt^2 / 8 = 2 mm.
    assert result.rmse_m < 0.005
    assert result.shift_s == pytest.approx(START_S + shift_s, abs=1e-3)
    assert result.rate == pytest.approx(rate, abs=1e-5)
    assert np.cos(np.radians(result.yaw_deg) + yaw) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("alignment", ALIGNMENTS)
def test_each_alignment_takes_away_its_own_freedom_and_no_more(alignment: str) -> None:
    estimate, truth = paths()
    same_clock = Path(truth.t_s + START_S, truth.enu)
    shifted = Path(estimate.t_s, estimate.enu + np.array([5.0, 0.0, 0.0]))
    yawed = Path(estimate.t_s, shifted.enu @ rotation([0.0, 0.0, 0.1]).T)
    tilted = Path(estimate.t_s, yawed.enu @ rotation([0.1, 0.0, 0.0]).T)
    scaled = Path(estimate.t_s, tilted.enu * 1.01)
    hidden = ALIGNMENTS.index(alignment)  # type: ignore[arg-type]
    for level, moved in enumerate([estimate, shifted, yawed, tilted, scaled]):
        rmse = evaluate(moved, same_clock, alignment, "none").rmse_m  # type: ignore[arg-type]
        assert (rmse < 0.005) == (level <= hidden)


@pytest.mark.parametrize("alignment", ["none", "yaw", "sim3"])
def test_a_true_sigma_is_called_true_and_half_of_it_is_not(alignment: str) -> None:
    """Errors drawn from covariances that point everywhere, in a frame that is turned against the truth's."""
    rng, t_s = np.random.default_rng(5), np.arange(2000) * 0.1
    roots = 0.1 * np.linalg.qr(rng.normal(size=(2000, 3, 3)))[0] * rng.uniform(0.5, 2.0, (2000, 1, 3))
    errors = (roots @ rng.normal(size=(2000, 3, 1)))[:, :, 0]
    R = rotation([0.0, 0.0, 0.4]) if alignment != "none" else np.eye(3)
    estimate, truth = Path(t_s, flight(t_s) + errors), Path(t_s, flight(t_s) @ R.T)
    for factor in (1.0, 0.25):
        stated = Stated(factor * roots @ np.swapaxes(roots, 1, 2), np.repeat([2, 5], 1000))
        result = evaluate(estimate, truth, alignment, "none", stated=stated)  # type: ignore[arg-type]
        parts = {part.over: part for part in result.consistency}
        # 2000 draws of three degrees of freedom: one sigma of their mean is 0.055; seven parameters were given away.
        assert parts["all"].nees * factor == pytest.approx(3.0, abs=0.2)
        assert parts["all"].error_over_sigma == pytest.approx(1 / np.sqrt(factor), rel=0.04)
        assert parts["2 cameras"].rows == parts["5 cameras"].rows == 1000
        assert parts["60 to 120 s"].rows == 600
        assert (parts["all"].beyond < 0.005) == (factor == 1.0)


def test_noise_is_reported_in_full() -> None:
    estimate, truth = paths(noise_m=0.5)
    result = evaluate(estimate, truth, "yaw", "rate")
    # Half way between two noisy rows of 0.5 m an axis, sqrt(1/2) of the noise is left: the best such shift is taken.
    assert result.rmse_m == pytest.approx(0.5 * np.sqrt(3 / 2), rel=0.08)
    assert result.shift_s == pytest.approx(START_S, abs=0.03)  # half a row is 0.025 s


def test_gaps_are_not_bridged() -> None:
    estimate, truth = paths()
    result = evaluate(estimate, Path(truth.t_s + START_S, truth.enu), "none", "none")
    assert result.truth_rows == 1050
    assert result.matched == pytest.approx(1050 * 38 / 50, abs=12)
    assert result.maximum_m < 0.01


def test_a_mirror_is_never_taken_for_a_rotation() -> None:
    estimate, _ = paths()
    mirrored = (estimate.enu * [1.0, 1.0, -1.0])[None]
    R = fit("se3", mirrored, estimate.enu[None], np.ones(mirrored.shape[:2])).R_truth_estimate[0]
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_paths_that_never_meet_are_an_error() -> None:
    estimate, truth = paths()
    with pytest.raises(SkyfixError, match="0 rows of the truth meet"):
        evaluate(estimate, truth, "none", "none")
    with pytest.raises(SkyfixError, match="one flight"):
        evaluate(Path(estimate.t_s[:2], estimate.enu[:2]), truth)


def write_trajectory(file: FilePath, estimate: Path, track: np.ndarray) -> None:
    header = "t_unix_ns,track,x_m,y_m,z_m,east_m,north_m,up_m,sigma_east_m,sigma_north_m,sigma_up_m,cameras"
    rows = [
        f"{round(t * 1e9)},{n},0,0,0,{e},{no},{u},1,1,1,3"
        for t, n, (e, no, u) in zip(estimate.t_s.tolist(), track.tolist(), estimate.enu.tolist(), strict=True)
    ]
    file.write_text("\n".join([header, *rows]) + "\n")


def write_truth(file: FilePath, truth: Path) -> None:
    rows = [f"{t},{e},{n},{u}" for t, (e, n, u) in zip(truth.t_s.tolist(), truth.enu.tolist(), strict=True)]
    file.write_text("\n".join(["# a comment", "t_s,east_m,north_m,up_m", *rows]) + "\n")


def test_program_joins_the_pieces_of_one_object_and_leaves_out_the_other(
    tmp_path: FilePath, capsys: pytest.CaptureFixture[str]
) -> None:
    estimate, truth = paths()
    drone = 1 + (estimate.t_s > START_S + 100).astype(int)
    bird_t = estimate.t_s[200:900]
    both = Path(np.append(estimate.t_s, bird_t), np.vstack([estimate.enu, np.full((700, 3), 300.0)]))
    write_trajectory(tmp_path / "trajectory.csv", both, np.append(drone, np.full(700, 7)))
    write_truth(tmp_path / "truth.csv", truth)
    arguments = [str(tmp_path / "trajectory.csv"), str(tmp_path / "truth.csv"), "--json", str(tmp_path / "r.json")]
    assert main(["score", *arguments]) == 0
    said = capsys.readouterr().out
    assert "tracks 2, 1" in said
    assert "3 cameras" in said
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["rmse_m"] < 0.005
    assert main(["score", *arguments, "--track", "9"]) == 1
    assert "no rows of track 9" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "no column"), ("t_s,east_m,north_m\n1,2,3\n", "no column up_m"), ("t_s,east_m,north_m,up_m\n1,2,x,3\n", "x")],
)
def test_a_wrong_file_is_named(text: str, said: str, tmp_path: FilePath, capsys: pytest.CaptureFixture[str]) -> None:
    estimate, _ = paths()
    write_trajectory(tmp_path / "trajectory.csv", estimate, np.ones(len(estimate.t_s), int))
    (tmp_path / "truth.csv").write_text(text)
    assert main(["score", str(tmp_path / "trajectory.csv"), str(tmp_path / "truth.csv")]) == 1
    error = capsys.readouterr().err
    assert "truth.csv" in error
    assert said in error

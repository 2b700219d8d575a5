"""The similarity between scaffold and survey: recovered, never a reflection, wrong positions found."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.geometry.similarity import Similarity, fit_similarity, fit_with_up, rms

SIX = np.array([[0, 0, 0], [50, 4, 1], [20, 60, 0], [-40, 30, 2], [-30, -40, 1], [10, -70, 3]], float)
vectors = st.tuples(*[st.floats(-3, 3)] * 3)


def moved(points: np.ndarray, scale: float, vector: tuple[float, ...], shift: tuple[float, ...]) -> np.ndarray:
    return Similarity(scale, rotation(vector), np.array(shift)).apply(points)


@given(scale=st.floats(1e-3, 1e3), vector=vectors, shift=st.tuples(*[st.floats(-1e3, 1e3)] * 3))
def test_a_similarity_is_recovered(scale: float, vector: tuple[float, ...], shift: tuple[float, ...]) -> None:
    target = moved(SIX, scale, vector, shift)
    fit = fit_similarity(SIX, target)
    assert fit.similarity.scale == pytest.approx(scale, rel=1e-9)
    assert fit.similarity.rotation == pytest.approx(rotation(vector), abs=1e-9)
    assert rms(fit.residual) < 1e-9 * (scale * 100 + 1000)


@given(seed=st.integers(0, 10**6))
def test_a_mirrored_set_gives_a_rotation_all_the_same(seed: int) -> None:
    source = np.random.default_rng(seed).normal(size=(5, 3))
    fit = fit_similarity(source, source * [1, 1, -1])
    assert np.linalg.det(fit.similarity.rotation) == pytest.approx(1.0)


def test_three_points_in_a_plane_suffice() -> None:
    target = moved(SIX[:3], 2.0, (0.1, 0.2, 2.5), (5, 6, 7))
    assert rms(fit_similarity(SIX[:3], target).residual) < 1e-10


def test_weights_decide_who_is_believed() -> None:
    target = SIX.copy()
    target[5] += [0, 0, 9.0]
    weight = np.array([1, 1, 1, 1, 1, 1e-12])
    fit = fit_similarity(SIX, target, weight)
    assert np.abs(fit.residual[:5]).max() < 1e-9
    assert fit.residual[5, 2] == pytest.approx(9.0)


def test_a_rigid_fit_keeps_the_scale() -> None:
    assert fit_similarity(SIX, 2 * SIX, scaled=False).similarity.scale == 1.0


def test_points_in_a_line_are_flat() -> None:
    line = np.outer(np.arange(4.0), [1, 2, 0.1])
    assert fit_similarity(line, line).flatness < 1e-12
    assert fit_similarity(SIX, SIX).flatness > 0.5


@given(vector=vectors, seed=st.integers(0, 10**6))
def test_two_cameras_and_up_fix_a_frame(vector: tuple[float, ...], seed: int) -> None:
    truth = Similarity(3.0, rotation(vector), np.array([1.0, 2.0, 3.0]))
    target = np.array([[0.0, 0, 0], [50.0, 10, 2]])
    source = (target - truth.shift) @ truth.rotation / truth.scale
    up_source = np.array([truth.rotation.T @ [0, 0, 1]])
    found = fit_with_up(source, target, up_source)
    points = np.random.default_rng(seed).normal(size=(5, 3))
    assert found.apply(points) == pytest.approx(truth.apply(points), abs=1e-8)


def test_what_cannot_fix_a_frame_is_refused_with_advice() -> None:
    with pytest.raises(CalibrationError, match=r"needs three.*survey"):
        fit_similarity(SIX[:2], SIX[:2])
    with pytest.raises(CalibrationError, match="at one place"):
        fit_similarity(np.ones((4, 3)), SIX[:4])
    with pytest.raises(CalibrationError, match="not a similarity"):
        Similarity(1.0, np.diag([1.0, 1.0, -1.0]), np.zeros(3))

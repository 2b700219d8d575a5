"""Rotations by a vector, and the one between directions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geometry.rotation import fit_rotation, rotation, skew

VECTORS = st.tuples(*[st.floats(-3, 3)] * 3)


@given(vector=VECTORS)
def test_a_vector_turns_about_itself_by_its_length(vector: tuple[float, float, float]) -> None:
    turned = rotation(vector)
    assert turned @ turned.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1.0)
    assert turned @ vector == pytest.approx(np.array(vector), abs=1e-9)


@given(vector=VECTORS, other=VECTORS)
def test_skew_is_the_cross_product(vector: tuple[float, float, float], other: tuple[float, float, float]) -> None:
    assert skew(np.array(vector)) @ other == pytest.approx(np.cross(vector, other), abs=1e-12)


@given(vector=VECTORS, seed=st.integers(0, 10**6))
def test_the_turn_between_directions_is_found(vector: tuple[float, float, float], seed: int) -> None:
    source = np.random.default_rng(seed).normal(size=(6, 3))
    source /= np.linalg.norm(source, axis=1, keepdims=True)
    target = source @ rotation(vector).T
    assert fit_rotation(target, source[None], np.ones(6))[0] == pytest.approx(rotation(vector), abs=1e-7)


def test_directions_in_a_mirror_are_no_reason_to_turn_the_world_inside_out() -> None:
    source = np.random.default_rng(3).normal(size=(6, 3))
    source /= np.linalg.norm(source, axis=1, keepdims=True)
    assert np.linalg.det(fit_rotation(source * [-1, 1, 1], source[None], np.ones(6))[0]) == pytest.approx(1.0)

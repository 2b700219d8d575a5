"""The lens models: what projection does, its inverse undoes, and the derivatives are the function's own."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from edge.common.errors import LensError
from edge.lens import LensModel, distort, pixel_to_ray, ray_to_pixel

SIZE = (1920, 1080)
PLAIN = LensModel("radtan", (1000.0, 1001.0, 959.5, 539.5), (0.0, 0.0, 0.0, 0.0), SIZE)
BARREL = LensModel("radtan", (1000.0, 1001.0, 959.5, 539.5), (-0.28, 0.09, 3e-4, -2e-4, -0.012), SIZE)
RATIONAL = LensModel("radtan", (900.0, 905.0, 950.0, 545.0), (0.3, 0.02, 1e-4, 2e-4, 0.001, 0.6, 0.08, 0.002), SIZE)
FISHEYE = LensModel("fisheye", (900.0, 900.0, 959.5, 539.5), (0.02, -0.004, 0.001, -2e-4), SIZE)
LENSES = pytest.mark.parametrize(
    "lens", [PLAIN, BARREL, RATIONAL, FISHEYE], ids=["plain", "barrel", "rational", "fish"]
)

inside_u = st.floats(0, SIZE[0] - 1)
inside_v = st.floats(0, SIZE[1] - 1)


@LENSES
@given(u=inside_u, v=inside_v)
def test_a_pixel_comes_back_from_its_ray(lens: LensModel, u: float, v: float) -> None:
    ray = pixel_to_ray(lens, np.array([[u, v]]))
    assume(np.isfinite(ray).all())  # beyond the fold there is no ray, which the next test but one asks for
    back = ray_to_pixel(lens, ray)
    # The inverse stops at 1e-9 in normalised coordinates, 1e-6 px at 1000 px focal length.
    assert np.abs(back - [u, v]).max() < 2e-6


@LENSES
def test_every_pixel_of_these_images_has_a_ray(lens: LensModel) -> None:
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 65), np.linspace(0, SIZE[1] - 1, 37))
    assert np.isfinite(pixel_to_ray(lens, np.column_stack([u.ravel(), v.ravel()]))).all()


def test_a_pixel_beyond_the_fold_is_nan_not_a_guess() -> None:
    folding = LensModel("radtan", (500.0, 500.0, 960.0, 540.0), (-0.4, 0.0, 0.0, 0.0), SIZE)
    # x (1 - 0.4 x^2) has its maximum 0.609 at x = 0.913: 304 px from the centre and no further.
    near, beyond = pixel_to_ray(folding, np.array([[960.0 + 300, 540.0], [960.0 + 310, 540.0]]))
    assert np.isfinite(near).all()
    assert near[0] < 0.913
    assert np.isnan(beyond).all()


@LENSES
def test_what_is_no_ray_is_no_pixel_and_the_other_way_round_and_nothing_is_said_of_it(lens: LensModel) -> None:
    nowhere = np.array([[np.nan, np.nan], [0.1, 0.1]])
    assert np.isnan(ray_to_pixel(lens, nowhere)[0]).all()
    assert np.isnan(pixel_to_ray(lens, nowhere)[0]).all()
    assert np.isfinite(distort(lens, nowhere).by_ray[1]).all()


@LENSES
@given(x=st.floats(-0.9, 0.9), y=st.floats(-0.5, 0.5))
def test_derivatives_are_those_of_finite_differences(lens: LensModel, x: float, y: float) -> None:
    ray, step = np.array([[x, y]]), 1e-6
    at = distort(lens, ray)
    for axis in range(2):
        shift = np.eye(2)[axis] * step
        slope = (distort(lens, ray + shift).xy - distort(lens, ray - shift).xy)[0] / (2 * step)
        # Central differences are good to step^2 and to 1e-16 / step.
        assert at.by_ray[0, :, axis] == pytest.approx(slope, abs=1e-8)
    changed = [lens.refined(np.array([0, 0, 0, 0, sign * step])) for sign in (1, -1)]
    slope = (distort(changed[0], ray).xy - distort(changed[1], ray).xy)[0] / (2 * step)
    assert at.by_coefficient[0] == pytest.approx(slope, abs=1e-8)


def test_the_axis_of_a_fisheye_is_no_special_place() -> None:
    centre = np.array([FISHEYE.intrinsics[2:]])
    assert pixel_to_ray(FISHEYE, centre) == pytest.approx(np.zeros((1, 2)), abs=1e-12)
    assert distort(FISHEYE, np.zeros((1, 2))).by_ray[0] == pytest.approx(np.eye(2), abs=1e-9)


@pytest.mark.parametrize(
    ("model", "intrinsics", "distortion", "words"),
    [
        ("radial", (1.0, 1.0, 0.0, 0.0), (0.0,) * 4, "unknown model"),
        ("radtan", (1.0, 1.0, 0.0, 0.0), (0.0,) * 3, "give 4 or 5 or 8"),
        ("fisheye", (1.0, 1.0, 0.0, 0.0), (0.0,) * 5, "give 4"),
        ("radtan", (0.0, 1.0, 0.0, 0.0), (0.0,) * 4, "fx, fy > 0"),
        ("radtan", (1.0, float("nan"), 0.0, 0.0), (0.0,) * 4, "fx, fy > 0"),
    ],
)
def test_numbers_that_are_no_lens_are_refused(
    model: str, intrinsics: tuple[float, ...], distortion: tuple[float, ...], words: str
) -> None:
    with pytest.raises(LensError, match=words):
        LensModel(model, intrinsics, distortion, SIZE)  # type: ignore[arg-type]

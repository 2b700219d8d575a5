"""Two cameras with the same rows are named before anything is solved; two that look alike are not."""

import numpy as np
import pytest

from calib.errors import CalibrationError
from calib.observations import Observations
from calib.solving.copies import refuse_copies

T_NS = 1_780_000_000 * 10**9


def seen(pixels: np.ndarray, *, keep: np.ndarray | None = None, late_ns: int = 0) -> Observations:
    t = T_NS + late_ns + np.arange(len(pixels), dtype=np.int64) * 10**8
    keep = np.ones(len(pixels), bool) if keep is None else keep
    return Observations(t[keep], pixels[keep], np.ones(int(keep.sum()), np.int64))


def path(seed: int, *, decimals: int = 6, scale_px: float = 300.0) -> np.ndarray:
    rng, t = np.random.default_rng(seed), np.arange(600) / 10.0
    smooth = np.column_stack([960 + scale_px * np.sin(t / 3 + seed), 540 + scale_px * np.sin(t / 4.1 + 2 * seed)])
    return np.round(smooth + rng.normal(0, 0.7, smooth.shape), decimals)


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("late_ns", [0, 40_000_000, 3600 * 10**9])
def test_a_copy_is_named(lost: float, late_ns: int) -> None:
    rng = np.random.default_rng(1)
    rows = {"cam0": seen(path(1)), "cam1": seen(path(2), keep=rng.random(600) >= lost)}
    rows["cam2"] = seen(path(2), keep=rng.random(600) >= lost, late_ns=late_ns)
    with pytest.raises(CalibrationError, match="the rows of cam2 are those of cam1") as caught:
        refuse_copies(rows, "hill")
    assert "cam0" not in str(caught.value)


@pytest.mark.parametrize("scale_px", [0.0, 3.0, 300.0])
def test_cameras_that_look_alike_in_whole_pixels_are_none(scale_px: float) -> None:
    """A drone in the middle of both pictures, all but still."""
    rows = {f"cam{k}": seen(path(3 + k, decimals=0, scale_px=scale_px)) for k in range(3)}
    refuse_copies(rows, "hill")


def test_pixels_that_never_change_are_no_copy() -> None:
    refuse_copies({"cam0": seen(np.full((99, 2), 5.0)), "cam1": seen(np.full((99, 2), 5.0))}, "hill")
    refuse_copies({"cam0": seen(np.zeros((2, 2))), "cam1": seen(np.zeros((2, 2)))}, "hill")

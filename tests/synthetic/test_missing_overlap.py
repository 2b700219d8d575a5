"""Cameras that never see the object together."""

import pytest

from calib.errors import CalibrationError
from calib.simulation.description import Blind
from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


def seeing(**spans_s: tuple[float, float]) -> dict[str, dict[str, object]]:
    """Cameras that see from a second to a second and nothing else."""
    return {
        name: {"blind": (Blind(from_s=-1.0, to_s=start), Blind(from_s=end, to_s=1e3))}
        for name, (start, end) in spans_s.items()
    }


def test_cameras_that_overlap_for_seconds_are_joined_by_the_others() -> None:
    found = solved(site(offsets_s=(0.0,) * 4, special=seeing(cam1=(0.0, 30.0), cam4=(27.0, 60.0))))
    assert len(found.names) == 4
    assert_right(found)


def test_a_camera_that_hardly_saw_it_is_left_out_by_name() -> None:
    found = solved(site(offsets_s=(0.0,) * 4, special=seeing(cam4=(59.0, 60.0))))
    assert found.names == ["cam1", "cam2", "cam3"]
    assert [name for name, _ in found.solution.report.left_out] == ["cam4"]
    assert_right(found)


def test_cameras_that_take_turns_are_refused_with_what_to_do() -> None:
    turns = seeing(cam1=(0.0, 20.0), cam2=(20.1, 40.0), cam3=(40.1, 60.0))
    with pytest.raises(
        CalibrationError, match=r"two must: cam1, cam2, cam3: .*fly 40 s and more where others see it too"
    ):
        solved(site(special=turns))

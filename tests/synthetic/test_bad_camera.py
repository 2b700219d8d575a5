"""One camera that does not belong is named and never spoils the others."""

from dataclasses import replace

import numpy as np
import pytest

from calib.observations import Observations, Scene
from calib.simulation.simulation import Simulated
from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved


def with_tracks(simulated: Simulated, seen: Observations) -> Scene:
    return replace(simulated.scene, observations={**simulated.scene.observations, "cam2": seen})


def nonsense(simulated: Simulated) -> Scene:
    """A detector that follows something else: a smooth walk over the image."""
    own = simulated.scene.observations["cam2"]
    walk = np.cumsum(np.random.default_rng(4).normal(0, 4.0, own.pixels.shape), axis=0)
    return with_tracks(simulated, replace(own, pixels=np.abs((walk + 900) % 1800 - 900)))


def standing(simulated: Simulated) -> Scene:
    """A dead pixel, or a lamp: always in one place."""
    own = simulated.scene.observations["cam2"]
    return with_tracks(simulated, replace(own, pixels=np.full(own.pixels.shape, 400.0)))


def mirrored(simulated: Simulated) -> Scene:
    """Frames delivered left to right."""
    own = simulated.scene.observations["cam2"]
    return with_tracks(simulated, replace(own, pixels=own.pixels * [-1, 1] + [1919, 0]))


@pytest.mark.parametrize("fault", [nonsense, standing, mirrored])
def test_a_camera_that_sees_another_world(fault: object) -> None:
    found = solved(site(offsets_s=(0.0,) * 4), change=fault)  # type: ignore[arg-type]
    assert found.names == ["cam1", "cam3", "cam4"]
    assert dict(found.solution.report.left_out)["cam2"]
    assert_right(found)


@pytest.mark.parametrize("trial", [0, 1])
def test_a_detector_full_of_clutter(trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * 4, special={"cam2": {"outlier": 0.6}}), trial=trial)
    assert {"cam1", "cam3", "cam4"} <= set(found.names)
    assert_right(found)


def test_the_lens_file_of_another_camera() -> None:
    other = {"cam2": {"published_intrinsics": (1600.0, 1600.0, 960.0, 540.0)}}
    found = solved(site(offsets_s=(0.0,) * 4, special=other))
    named = " ".join((*(why for name, why in found.solution.report.left_out if name == "cam2"),
                      *(str(f) for f in found.solution.report.findings if "cam2" in f.cameras)))  # fmt: skip
    assert "lens" in named
    assert {"cam1", "cam3", "cam4"} <= set(found.names)
    assert_right(found)

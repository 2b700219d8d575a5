"""No survey at all: the shape is right, the frame is the scaffold's own and its unit the scaffold's baseline."""

import numpy as np
import pytest

from calib.geometry.similarity import fit_similarity, rms
from tests.calib.flights import site
from tests.synthetic.solving import solved


@pytest.mark.parametrize("trial", [0, 1])
def test_the_shape_is_the_truths(trial: int) -> None:
    found = solved(site(offsets_s=(0.0,) * 4), trial=trial, local=True)
    trajectory = found.solution.trajectory
    truth = found.truth.truth_enu(trajectory.t_unix_ns)
    flown = np.isfinite(truth[:, 0])
    fit = fit_similarity(trajectory.points_enu[flown], truth[flown])
    # As good as with a survey: half a pixel at 100 m, averaged, and lenses of 1 % that the flight refines: 0.25 m.
    assert rms(fit.residual) < 0.25
    assert fit.flatness > 0.1


def test_the_gauge_is_one_camera_and_a_unit_baseline() -> None:
    centres = [camera.centre_enu for camera in solved(site(offsets_s=(0.0,) * 4), local=True).solution.network.cameras]
    at_origin = [centre for centre in centres if np.linalg.norm(centre) < 1e-4]
    assert len(at_origin) == 1
    assert min(abs(np.linalg.norm(centre) - 1) for centre in centres) < 1e-4

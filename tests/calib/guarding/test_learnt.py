"""What the guard learns of honest cameras: how far boxes lie off their objects, and how clocks wander."""

import numpy as np
import pytest

from calib.guarding.boxshare import FIRST_SHARE, BoxShare
from calib.guarding.evidence import ObjectEvidence
from calib.guarding.wander import SETTLED_NS, UNDISCIPLINED_SIGMA_S, WANDER_SIGMA_S, ClockEstimate, ClockWander
from tests.calib.guarding.slices import slices_of
from tools.doubles.flight import Spec, frames, make

NS = 10**9


def a_slice(spread_px2: float, width_px: float) -> ObjectEvidence:
    scene = make(Spec(cameras=4, uavs=1, rate_hz=15.0, duration_s=3.0))
    found = slices_of(scene, frames(scene))[0].objects[0][1]
    return ObjectEvidence(
        **{**vars(found), "spread_px2": spread_px2, "width_px": np.full(len(found.cameras), width_px)}
    )


@pytest.mark.parametrize("share", [0.02, 0.5])
def test_the_share_of_a_box_follows_what_is_seen(share: float) -> None:
    box, found = BoxShare(), a_slice((share * 10.0) ** 2, 10.0)
    assert box.sigma == FIRST_SHARE
    for _ in range(400):
        box.learn(found)
    # What it began with is still worth a hundredth of the variance.
    assert box.sigma == pytest.approx(share, abs=0.03)


def test_a_clock_is_held_against_its_own_past_if_the_flight_told_it() -> None:
    wander = ClockWander()
    assert wander.expected(0, 2).sigma_s == pytest.approx([UNDISCIPLINED_SIGMA_S] * 2)
    wander.add(0, ClockEstimate(np.array([0.03, 0.01]), np.array([0.003, 0.04])))
    wander.add(5 * NS, ClockEstimate(np.array([0.09, 0.09]), np.array([0.001, 0.001])))
    assert wander.expected(SETTLED_NS - 1, 2).off_s == pytest.approx([0.0, 0.0]), "a step would still be in it"
    settled = wander.expected(SETTLED_NS, 2)
    assert settled.off_s == pytest.approx([0.03, 0.01])
    assert settled.sigma_s == pytest.approx(np.hypot([0.003, 0.04], WANDER_SIGMA_S)), "what the flight did not tell"
    wander.clear()
    assert wander.expected(SETTLED_NS, 2).off_s == pytest.approx([0.0, 0.0])

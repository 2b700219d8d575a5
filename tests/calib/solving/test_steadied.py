"""Clocks that are looked into, and those that are left in peace."""

from dataclasses import replace

import numpy as np

from calib.simulation.simulation import simulate
from calib.solving.common_time import on_one_time
from calib.solving.inputs import prepare
from tests.calib.flights import site

RATES = (-2.4e-3, 1.9e-3, 2.3e-3, -1.1e-3, 0.6e-3)


def test_phones_that_all_run_at_a_pace_of_their_own_keep_their_clocks() -> None:
    """Nobody's pace is beyond doubt then, and each is confirmed by the others' tracks all the same."""
    simulated = simulate(site(offsets_s=(0.0,) * 5, duration_s=150.0))
    middle = simulated.start_unix_ns + round(75.0 * 1e9)
    rows = {}
    for (name, own), rate in zip(sorted(simulated.scene.observations.items()), RATES, strict=True):
        since_s = (own.t_unix_ns - middle) * 1e-9
        rows[name] = replace(own, t_unix_ns=middle + np.round(since_s / (1 + rate) * 1e9).astype(np.int64))
    timed = on_one_time(prepare(replace(simulated.scene, observations=rows)))
    assert set(timed.clocks) == set(rows)
    assert not timed.found
    assert not timed.inputs.left_out
    rates = np.array([timed.clocks[name].rate for name in sorted(rows)])
    # A hundredth of a second at the ends of two and a half minutes is 130 ppm, twice.
    assert np.abs((rates - rates[0]) - (np.array(RATES) - RATES[0])).max() < 3e-4

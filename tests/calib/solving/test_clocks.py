"""Clocks that disagree, aligned from two cameras' tracks of one flight."""

import numpy as np
import pytest

from calib.simulation.simulation import simulate
from calib.solving.clocks import COARSE_STEP_S, FAR_S, FINE_STEP_S, NEAR_S, align, align_all
from calib.solving.series import TrackSeries, split_tracks
from tests.calib.flights import site

# Steps of a hundredth: the nearest is at most half of one away; a track read between rows adds the noise's own part.
ALIGNED_S = 1.5 * FINE_STEP_S


def tracks(offsets_s: tuple[float, ...], **known: object) -> dict[str, list[TrackSeries]]:
    """Tracks of cameras whose clocks are slow by so much."""
    simulated = simulate(site(offsets_s=offsets_s, **known))  # type: ignore[arg-type]
    scene, t_mid = simulated.scene, simulated.start_unix_ns + round(simulated.duration_s / 2 * 1e9)
    return {c.id: split_tracks(scene.observations[c.id], c.lens, t_mid) for c in scene.cameras}


@pytest.mark.parametrize("offset_s", [-2.97, -0.8, -0.004, 0.0, 0.333, 2.5])
def test_an_offset_within_three_seconds(offset_s: float) -> None:
    seen = tracks((0.0, offset_s, 0.0), noise_px=0.7)
    found = align(seen["cam1"], seen["cam2"], NEAR_S)
    assert found is not None
    assert found.offset_s == pytest.approx(offset_s, abs=ALIGNED_S)


@pytest.mark.parametrize("offset_s", [-118.0, 47.31])
def test_an_offset_within_two_minutes(offset_s: float) -> None:
    seen = tracks((0.0, offset_s, 0.0), noise_px=0.7, duration_s=180.0)
    found = align(seen["cam1"], seen["cam2"], FAR_S)
    assert found is not None
    assert found.offset_s == pytest.approx(offset_s, abs=ALIGNED_S)


def test_a_rate_of_1000_ppm_leaves_the_offset_of_the_middle() -> None:
    simulated = site(offsets_s=(0.0, 1.2, 0.0), noise_px=0.7, rate=1e-3)
    scene = simulate(simulated).scene
    t_mid = simulated.start_unix_ns + round(30 * 1e9)
    seen = {c.id: split_tracks(scene.observations[c.id], c.lens, t_mid) for c in scene.cameras}
    found = align(seen["cam1"], seen["cam2"], NEAR_S)
    assert found is not None
    assert found.offset_s == pytest.approx(1.2, abs=30e-3 + COARSE_STEP_S)  # half a minute of it, and a coarse step


def test_all_cameras_are_tied_together() -> None:
    truth = (0.0, 1.71, -2.2)
    found = align_all(tracks(truth, noise_px=0.7))
    relative = np.array([found[name] - found["cam1"] for name in ("cam1", "cam2", "cam3")])
    assert relative == pytest.approx(truth, abs=2 * ALIGNED_S)


def test_trusted_stamps_stand() -> None:
    seen = tracks((0.0, 0.0, 1.3), noise_px=3.0)
    found = align_all(seen, NEAR_S, frozenset({"cam1", "cam2"}))
    assert found["cam1"] == found["cam2"] == 0.0
    assert found["cam3"] == pytest.approx(1.3, abs=2 * ALIGNED_S)


def test_two_cameras_that_share_nothing_have_no_alignment() -> None:
    seen = tracks((0.0, 0.0, 0.0), noise_px=0.7)
    one = seen["cam1"][0]
    early = TrackSeries(1, one.t_s[:200], one.rays[:200], one.row[:200])
    late = TrackSeries(1, one.t_s[-200:], one.rays[-200:], one.row[-200:])
    assert align([early], [late], NEAR_S) is None


def test_same_tracks_same_offsets() -> None:
    seen = tracks((0.0, 0.5, -0.5), noise_px=0.7)
    assert align_all(seen) == align_all(seen)

"""Clocks that disagree, aligned from two cameras' tracks of one flight."""

import numpy as np
import pytest

from calib.simulation.simulation import simulate
from calib.solving.camera_tracks import camera_tracks
from calib.solving.clocks import FINE_STEP_S, align, chain, smooth
from calib.solving.series import TrackSeries
from tests.calib.flights import site

# Steps of a hundredth: the nearest is at most half of one away; a track read between rows adds the noise's own part.
ALIGNED_S = 1.5 * FINE_STEP_S


def tracks(offsets_s: tuple[float, ...], **known: object) -> dict[str, list[TrackSeries]]:
    """Tracks of cameras whose clocks are slow by so much."""
    simulated = simulate(site(offsets_s=offsets_s, **known))  # type: ignore[arg-type]
    scene, t_mid = simulated.scene, simulated.start_unix_ns + round(simulated.duration_s / 2 * 1e9)
    return {c.id: camera_tracks(c.id, scene.observations[c.id], c.lens, t_mid).tracks for c in scene.cameras}


def late(track: TrackSeries, by_s: float) -> TrackSeries:
    """The same track on a clock that is ahead."""
    return TrackSeries(track.number, track.t_s + by_s, track.rays, track.row)


@pytest.mark.parametrize("offset_s", [-2.97, -0.8, -0.004, 0.0, 0.333, 2.5])
def test_an_offset_of_seconds(offset_s: float) -> None:
    seen = tracks((0.0, offset_s, 0.0), noise_px=0.7)
    found = align(seen["cam1"], seen["cam2"])
    assert found.convincing
    assert found.candidates[0].shift_s == pytest.approx(offset_s, abs=ALIGNED_S)


@pytest.mark.parametrize("offset_s", [-118.0, 18.0, -3600.0, 31_536_000.0])
def test_an_offset_of_any_size_is_found_wherever_the_stamps_lie(offset_s: float) -> None:
    seen = tracks((0.0, 0.0, 0.0), noise_px=0.7)
    found = align(seen["cam1"], [late(track, -offset_s) for track in seen["cam2"]])
    assert found.convincing
    assert found.candidates[0].shift_s == pytest.approx(offset_s, abs=ALIGNED_S)


@pytest.mark.parametrize("rate", [1e-3, -2.5e-3, 5.667e-3])
def test_a_rate_comes_with_its_offset(rate: float) -> None:
    simulated = site(offsets_s=(0.0, 1.2, 0.0), noise_px=0.7, rate=rate, duration_s=120.0)
    scene = simulate(simulated).scene
    t_mid = simulated.start_unix_ns + round(60 * 1e9)
    seen = {c.id: camera_tracks(c.id, scene.observations[c.id], c.lens, t_mid).tracks for c in scene.cameras}
    found = align(seen["cam1"], seen["cam2"])
    assert found.convincing
    assert found.candidates[0].offset_s == pytest.approx(1.2, abs=2 * ALIGNED_S)
    # A step of a hundredth of a second at the ends of two minutes is 170 ppm.
    assert found.candidates[0].rate == pytest.approx(rate, abs=3e-4)


def test_what_two_cameras_saw_at_different_times_convinces_nobody() -> None:
    seen = tracks((0.0, 0.0, 0.0), noise_px=0.7, duration_s=120.0)
    half = [track.t_s < 0 for track in (seen["cam1"][0], seen["cam2"][0])]
    early, late_one = (
        TrackSeries(1, track.t_s[keep], track.rays[keep], track.row[keep])
        for track, keep in zip((seen["cam1"][0], seen["cam2"][0]), (half[0], ~half[1]), strict=True)
    )
    assert not align([early], [late_one]).convincing


def test_two_cameras_that_share_too_little_have_no_alignment() -> None:
    seen = tracks((0.0, 0.0, 0.0), noise_px=0.7)
    one = seen["cam1"][0]
    early = TrackSeries(1, one.t_s[:200], one.rays[:200], one.row[:200])  # 13 s
    found = align([early], seen["cam2"])
    assert found.candidates == ()
    assert found.as_stamped is None


def test_a_track_in_pieces_is_aligned_as_a_whole() -> None:
    seen = tracks((0.0, 0.4, 0.0), noise_px=0.7)
    whole = seen["cam2"][0]
    pieces = [
        TrackSeries(number, whole.t_s[rows], whole.rays[rows], whole.row[rows])
        for number, rows in enumerate(np.array_split(np.arange(len(whole.t_s)), 8))
    ]
    found = align(seen["cam1"], pieces)
    assert found.convincing
    assert found.candidates[0].shift_s == pytest.approx(0.4, abs=ALIGNED_S)
    assert len(chain(pieces).t_s) == len(whole.t_s)


def test_strays_are_taken_out_and_turns_are_not() -> None:
    track = tracks((0.0, 0.0, 0.0), noise_px=0.0)["cam1"][0]
    assert len(smooth(track).t_s) == len(track.t_s)
    rays = track.rays.copy()
    rays[100] += 0.05
    assert len(smooth(TrackSeries(1, track.t_s, rays, track.row)).t_s) == len(track.t_s) - 1


def test_same_tracks_same_alignment() -> None:
    seen = tracks((0.0, 0.5, -0.5), noise_px=0.7)
    assert align(seen["cam1"], seen["cam2"]) == align(seen["cam1"], seen["cam2"])

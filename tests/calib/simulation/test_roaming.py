"""Flights at random: as wild as asked for, for as long as asked for, near home, the same for the same seed."""

import numpy as np
import pytest

from calib.simulation.description import Blind, CameraSpec, ObjectSpec, Roam, Simulation
from calib.simulation.flight import ObjectFlight
from calib.simulation.roaming import AFTER_S, DRAG_S, SPRING_S2, roam
from calib.simulation.simulation import simulate, watch
from edge.common.errors import ConfigError

HOME = (10.0, -20.0, 50.0)
LONG_S = 2000.0
WILD = ObjectSpec(name="bird", kind="bird", roam=Roam(home_enu=HOME, sigma_m_s2=3.0, tau_s=0.8))
LOOKING = CameraSpec(id="cam0", centre_enu=(0.0, -120.0, 0.0), look_at_enu=HOME)


def scene(*objects: ObjectSpec, seed: int = 3, **camera: object) -> Simulation:
    looking = CameraSpec(id="cam0", centre_enu=(0.0, -120.0, 0.0), look_at_enu=HOME, **camera)  # type: ignore[arg-type]
    return Simulation(seed=seed, duration_s=20.0, object=objects, camera=(looking,))


def driven_m_s2(flight: ObjectFlight, t_s: np.ndarray) -> np.ndarray:
    """(N, 3) what is left of the acceleration without spring and drag."""
    off = flight.position_enu(t_s) - HOME
    return np.asarray(flight.spline(t_s, nu=2) + np.array(SPRING_S2) * off + DRAG_S * flight.velocity_enu(t_s))


def test_accelerations_have_the_sigma_and_the_correlation_time_asked_for() -> None:
    flight = roam(WILD, LONG_S, np.random.default_rng(1))
    every_s = 0.1
    found = driven_m_s2(flight, np.arange(10.0, LONG_S, every_s))
    # 2000 s hold 2500 correlation times of three axes: 0.8 % one sigma. The spline's knots, an eighth of a correlation
    # time apart, round off about as much of the variance: 6 % of sigma.
    assert np.std(found) == pytest.approx(3.0, rel=0.1)
    lag = round(0.8 / every_s)
    correlated = np.mean(found[:-lag] * found[lag:]) / np.var(found)
    assert correlated == pytest.approx(np.exp(-1), abs=0.06)


def test_it_stays_about_its_home_for_as_long_as_the_scene_lasts_and_a_little_longer() -> None:
    flight = roam(WILD, LONG_S, np.random.default_rng(2))
    t_s = np.arange(0.0, LONG_S + AFTER_S, 0.5)
    off = flight.position_enu(t_s) - HOME
    assert np.isfinite(off).all()
    assert np.abs(off.mean(axis=0)).max() < 10.0
    # A driven spring: sigma^2 = drive^2 tau / (spring drag) where tau is short beside its swing, so 24 m level; five.
    assert np.abs(off).max() < 5 * 3.0 * np.sqrt(0.8 / (SPRING_S2[0] * DRAG_S))


def test_a_seed_is_a_flight_and_each_object_has_its_own() -> None:
    other = ObjectSpec(name="other", roam=WILD.roam)
    one, again, third = (watch(scene(WILD, other, seed=seed)).flights for seed in (3, 3, 4))
    t_s = np.arange(0.0, 20.0, 0.1)
    assert np.array_equal(one[0].position_enu(t_s), again[0].position_enu(t_s))
    assert not np.allclose(one[0].position_enu(t_s), one[1].position_enu(t_s))
    assert not np.allclose(one[0].position_enu(t_s), third[0].position_enu(t_s))


def test_frames_that_show_nothing_arrive_as_well() -> None:
    found = simulate(scene(clutter_per_frame=0.2))
    assert len(found.frames_unix_ns["cam0"]) == 601  # 20 s of 30 Hz and the first
    assert set(found.rows["cam0"].t_unix_ns) < set(found.frames_unix_ns["cam0"])
    assert set(found.rows["cam0"].source) == {0}


def test_unseen_for_longer_than_the_gap_it_is_another_track() -> None:
    hovering = ObjectSpec(waypoints_enu=(HOME, HOME), step_s=20.0)
    for gap_s, tracks in ((0.5, 2), (1.5, 1)):
        found = simulate(scene(hovering, blind=(Blind(from_s=8.0, to_s=9.0),), track_gap_s=gap_s))
        assert len(set(found.rows["cam0"].track)) == tracks


@pytest.mark.parametrize(
    ("thing", "duration_s", "said"),
    [
        (ObjectSpec(roam=WILD.roam, waypoints_enu=(HOME, HOME)), 9.0, "roams and has waypoints"),
        (ObjectSpec(), 9.0, "flies nowhere"),
        (WILD, None, "no waypoint says when the scene ends"),
        (ObjectSpec(roam=WILD.roam, start_s=99.0), 9.0, "starts after the scene's end"),
    ],
)
def test_what_cannot_be_flown_is_refused_by_name(thing: ObjectSpec, duration_s: float | None, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        watch(Simulation(seed=1, duration_s=duration_s, object=(thing,), camera=(LOOKING,)))

"""Clocks off by seconds, or by minutes, or running at rates of their own: found from the tracks, and named."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from calib.observations import Scene
from calib.simulation.description import ClockStep
from calib.simulation.simulation import Simulated
from tests.calib.flights import site
from tests.synthetic.solving import Solved, assert_right, solved


def assert_clocks(found: Solved, offsets_s: tuple[float, ...]) -> None:
    """Offsets between cameras are the truth's, to five of their own sigmas and never worse than 5 ms."""
    reports = found.solution.report.cameras
    assert len(reports) == len(offsets_s)
    for report, truth in zip(reports[1:], offsets_s[1:], strict=True):
        between = (report.clock_offset_s - reports[0].clock_offset_s) - (truth - offsets_s[0])
        sigma = reports[0].sigma_offset_s + report.sigma_offset_s
        assert abs(between) < min(5 * sigma, 5e-3), report.id


@pytest.mark.parametrize("offsets_s", [(0.0, 2.0, -2.0, 0.0), (0.0, -0.7, 0.3, 0.0)])
def test_seconds(offsets_s: tuple[float, ...]) -> None:
    found = solved(site(offsets_s=offsets_s))
    assert_clocks(found, offsets_s)
    named = " ".join(map(str, found.solution.report.findings))
    assert "clock of cam2" in named
    assert "clock of cam3" in named
    assert "clock of cam1" not in named


def test_two_minutes() -> None:
    offsets_s = (0.0, 117.0, 0.0, 0.0)
    found = solved(site(offsets_s=offsets_s, duration_s=300.0, frame_rate_hz=8.0))
    assert_clocks(found, offsets_s)


@pytest.mark.parametrize("rate", [2e-4, -1e-3])
def test_a_rate_of_its_own(rate: float) -> None:
    found = solved(site(offsets_s=(0.0, 0.5, 0.0, 0.0), rate=rate))
    assert_clocks(found, (0.0, 0.5, 0.0, 0.0))
    report = found.solution.report.cameras[1]
    assert abs(report.clock_rate - rate) < 5 * report.sigma_rate


@pytest.mark.parametrize("off_s", [0.1, -0.1])
def test_the_first_by_name_is_not_the_time_where_five_others_say_another(off_s: float) -> None:
    """All state the same bound, so it was taken for the site's time: the flight, and all others, were off by it."""
    offsets_s = (off_s, 0.0, 0.0, 0.0, 0.0, 0.0)
    found = solved(site(offsets_s=offsets_s, duration_s=25.0, frame_rate_hz=10.0, each={"clock_bound_s": 1e-3}))
    reports = found.solution.report.cameras
    assert abs(reports[0].clock_offset_s - off_s) < 5e-3
    assert all(abs(report.clock_offset_s) < 5e-3 for report in reports[1:])
    assert "clock of cam1" in told(found)
    assert "clock of cam2" not in told(found)


def test_a_camera_with_a_bad_clock_that_denies_it_is_named() -> None:
    bounded = {"clock_bound_s": 2e-3}
    found = solved(site(offsets_s=(0.0, 0.0, 1.3, 0.0), each=bounded))
    assert any(
        "clock of cam3" in str(finding) and "own bound" in str(finding) for finding in found.solution.report.findings
    )
    assert_clocks(found, (0.0, 0.0, 1.3, 0.0))
    assert_right(found)


def told(found: Solved) -> str:
    return " ".join(str(finding) for finding in found.solution.report.findings)


def test_a_rounded_frame_rate_is_told_as_one_and_nobody_else_is_blamed() -> None:
    found = solved(
        site(offsets_s=(0.0,) * 3, rate=30 / 29.83 - 1, each={"clock_bound_s": 5e-3}, duration_s=90.0),
    )
    assert "clock of cam2 runs 5" in told(found)
    assert "29.83 frames a second" in told(found)
    assert {name for finding in found.solution.report.findings for name in finding.cameras} == {"cam2"}
    assert_right(found)


@pytest.mark.parametrize("cameras", [3, 4])
def test_the_first_camera_at_an_odd_pace_is_named_and_not_all_others(cameras: int) -> None:
    """All state the same bound, and the first by name is taken for the site's time: its pace was everybody's."""
    odd = {"cam1": {"clock_rate": 30 / 29.97 - 1}}
    found = solved(site(offsets_s=(0.0,) * cameras, each={"clock_bound_s": 5e-3}, special=odd, duration_s=90.0))
    assert {name for finding in found.solution.report.findings for name in finding.cameras} == {"cam1"}
    assert_right(found)


def test_a_time_zone_is_found_and_named() -> None:
    def an_hour_ahead(simulated: Simulated) -> Scene:
        own = simulated.scene.observations["cam3"]
        late = replace(own, t_unix_ns=own.t_unix_ns + 3600 * 10**9)
        return replace(simulated.scene, observations={**simulated.scene.observations, "cam3": late})

    found = solved(site(offsets_s=(0.0,) * 4, each={"clock_bound_s": 5e-3}), change=an_hour_ahead)
    assert found.names == ["cam1", "cam2", "cam3", "cam4"]
    assert "cam3 is +3600.0" in told(found)
    assert "1 h: another time zone" in told(found)
    # The network holds for the stamps as they came.
    camera, true = found.solution.network.camera("cam3"), found.truth.network.camera("cam3")
    assert camera is not None
    assert true is not None
    stamp = np.array([found.truth.start_unix_ns + 3630 * 10**9])
    site_s = camera.site_time_s(stamp, np.zeros(1), found.truth.start_unix_ns)
    later_s = (found.truth.start_unix_ns - found.solution.network.t_mid_unix_ns) * 1e-9 * camera.clock_rate
    assert site_s[0] + later_s == pytest.approx(30.0, abs=5e-3)
    assert_right(found)


@pytest.mark.parametrize("step_s", [2.0, -0.5])
def test_a_clock_that_stepped_is_cut_there_and_the_time_told(step_s: float) -> None:
    stepped = {"cam2": {"clock_step": (ClockStep(at_s=55.0, step_s=step_s),)}}
    found = solved(site(offsets_s=(0.0,) * 4, each={"clock_bound_s": 5e-3}, special=stepped, duration_s=90.0))
    at = datetime.fromtimestamp(found.truth.start_unix_ns * 1e-9 + 55.0, UTC)
    (sentence,) = (str(one) for one in found.solution.report.findings if "stepped" in str(one))
    size_s = float(sentence.split("cam2 stepped by ")[1].split(" s ")[0])
    assert size_s == pytest.approx(step_s, abs=0.06)  # two pieces, each placed to a few hundredths
    named = datetime.strptime(sentence.split(" at ")[1][:19], "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
    assert abs((named - at).total_seconds()) <= 3.0  # a piece's worth of noise, and the second's fraction
    assert found.names == ["cam1", "cam2", "cam3", "cam4"]
    assert_right(found)

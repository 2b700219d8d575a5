"""Clocks off by seconds, or by minutes, or running at rates of their own: found from the tracks, and named."""

import pytest

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


def test_a_camera_with_a_bad_clock_that_denies_it_is_named() -> None:
    bounded = {"clock_bound_s": 2e-3}
    found = solved(site(offsets_s=(0.0, 0.0, 1.3, 0.0), each=bounded))
    assert any(
        "clock of cam3" in str(finding) and "own bound" in str(finding) for finding in found.solution.report.findings
    )
    assert_clocks(found, (0.0, 0.0, 1.3, 0.0))
    assert_right(found)

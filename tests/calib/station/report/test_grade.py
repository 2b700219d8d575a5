"""The mark for what is claimed of a site, and what a test that tested nothing says."""

import pytest

from calib.solving.doubts import Claim, Doubt
from calib.solving.found import Cause, Found
from calib.solving.strain import Believed, Strain
from calib.station.report.grade import claims, worst
from calib.station.report.summary import Mark

GOOD = Strain(21.0, 20, 0.4, (), 0.4)
NAMED = Found(Cause.POSITION, ("b",), "the surveyed position of b is off by 2.00 m", cure="survey it")
RIVALS = Found(Cause.POSITION, ("a", "b"), "a is off, or b is off; none of these was believed", True, "correct it")
LATE = Found(Cause.CLOCK, ("c",), "the clock of c is +0.3 s off the site's")


def strained(*probabilities: float) -> Strain:
    doubts = tuple(Believed(Doubt(Claim.POSITION, ("b",), 1.0, 1e-2), one) for one in probabilities)
    return Strain(90.0, 20, 1e-10, doubts, 0.5)


@pytest.mark.parametrize(
    ("strain", "findings", "grade", "reason", "action"),
    [
        (GOOD, (), "A", "agree with what the cameras saw (chi-square 21.0 of 20)", ""),
        (GOOD, (LATE,), "A", "agree", ""),  # that a clock is beyond its bound, the mark for clocks says
        (strained(1.0), (LATE, NAMED), "C", "position of b is off by 2.00 m", "survey it"),
        (strained(0.6, 0.4), (RIVALS,), "D", "a is off, or b is off", "correct it"),
        (strained(1.0, 0.6), (NAMED, RIVALS), "D", "a is off, or b is off", "correct it"),
        (Strain(0.0, 0, 1.0, (), 1.0), (), "B", "not tested", "survey every camera"),
        (None, (), "B", "not tested", "survey every camera"),  # a local frame
    ],
)
def test_what_is_claimed_has_a_mark(
    strain: Strain | None, findings: tuple[Found, ...], grade: str, reason: str, action: str
) -> None:
    mark = claims(strain, findings)
    assert (mark.name, mark.grade) == ("claims", grade)
    assert reason in mark.reason
    assert action in mark.action
    assert bool(mark.action) is (grade != "A")


def test_the_worst_decides_and_of_equal_ones_the_first() -> None:
    marks = [Mark(name=name, grade=grade, reason="", action="") for name, grade in zip("abcd", "ACCB", strict=True)]
    assert worst(marks).name == "b"

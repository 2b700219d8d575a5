"""What is told of a calibration: one that is wrong by name and number, several that may be by all their names."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib.observations import SiteCamera
from calib.solving.doubts import Claim, Doubt
from calib.solving.findings import MOST_TOLD, contradiction, findings
from calib.solving.found import Cause, Found
from calib.solving.solution import CameraReport
from calib.solving.strain import CERTAIN, Believed, Strain
from tests.calib.solving.claims import LENS_MODEL

PLACES = {"a": (0.0, 0.0, 0.0), "b": (100.0, 0.0, 0.0), "c": (0.0, 80.0, 0.0), "d": (90.0, 90.0, 0.0)}


def report(name: str, **known: object) -> CameraReport:
    good: dict[str, object] = {
        "id": name,
        "rows": 500,
        "inlier_share": 0.97,
        "sigma_px": 0.7,
        "correlated_s": 0.1,
        "clock_offset_s": 0.0,
        "sigma_offset_s": 1e-3,
        "clock_rate": 0.0,
        "sigma_rate": 1e-6,
        "readout_s": 0.0,
        "sigma_readout_s": 0.0,
        "lens_before": LENS_MODEL,
        "lens_after": LENS_MODEL,
        "sigma_lens": (2.0, 2.0, 2.0, 2.0, 1e-3),
        "centre_enu": PLACES[name],
        "sigma_centre_m": (0.02, 0.02, 0.02),
        "sigma_attitude_rad": (1e-4, 1e-4, 1e-4),
        "survey_misfit_m": (0.0, 0.0, 0.0),
    }
    return CameraReport(**(good | known))  # type: ignore[arg-type]


def told(
    *doubts: tuple[Claim, tuple[str, ...], float], bound_s: float | None = 0.005, **special: CameraReport
) -> tuple[Found, ...]:
    cameras = tuple(special.get(name, report(name)) for name in PLACES)
    sites = {name: SiteCamera(name, LENS_MODEL, None, None, clock_bound_s=bound_s) for name in PLACES}
    return findings(cameras, sites, strained(*doubts))


def strained(*doubts: tuple[Claim, tuple[str, ...], float]) -> Strain:
    together = tuple(
        Believed(Doubt(claim, names, 1.0, 1e-2, together=len(names) > 2), probability)
        for claim, names, probability in doubts
    )
    return Strain(80.0, 20, 1e-9, together, 0.5)


def longer(share: float) -> CameraReport:
    """Camera b with a lens file that is that much too long."""
    after = replace(LENS_MODEL, intrinsics=(1000 / (1 + share), 1000 / (1 + share), 960.0, 540.0))
    return report("b", lens_after=after)


def test_a_good_site_has_nothing_to_tell() -> None:
    assert told() == ()
    assert findings((report("a"),), {"a": SiteCamera("a", LENS_MODEL, None, None)}, None) == ()


@pytest.mark.parametrize(
    ("claim", "camera", "cause", "words"),
    [
        (Claim.POSITION, report("b", survey_misfit_m=(3.0, 0.0, -4.0)), Cause.POSITION, r"off by 5\.00 m and was not"),
        (Claim.LENS, longer(0.1), Cause.LENS, r"lens file of b is off by \+10\.0 % and was not believed: calibrate it"),
        (Claim.DISTORTION, report("b"), Cause.LENS, "distortion of b is off and was not believed: .*raw pixels"),
        (Claim.CLOCK, report("b", clock_offset_s=-0.3), Cause.CLOCK, r"clock of b is off by \+0\.300 s"),
    ],
)
def test_the_one_thing_that_is_wrong_is_named_measured_and_cured(
    claim: Claim, camera: CameraReport, cause: Cause, words: str
) -> None:
    (found,) = told((claim, ("b",), 0.99), b=camera)
    assert (found.cause, found.cameras, found.undecided) == (cause, ("b",), False)
    assert re.search(words, str(found)), str(found)


def test_several_that_are_wrong_alike_are_spoken_of_in_the_plural() -> None:
    (found,) = told((Claim.LENS, tuple(PLACES), 1.0), b=longer(0.1), a=replace(longer(0.1), id="a"))
    assert "lens files of all cameras are off by +10.0 % and were not believed: calibrate them" in str(found)


def test_what_is_sure_stands_alone_and_what_is_not_among_its_rivals() -> None:
    found = told((Claim.POSITION, ("d",), CERTAIN), (Claim.LENS, ("a",), CERTAIN - 0.3), (Claim.POSITION, ("b",), 0.3))
    assert [one.undecided for one in found] == [False, True]
    assert found[0].cameras == ("d",)
    assert found[1].cameras == ("a", "b")
    assert "the lens file of a is off, or the surveyed position of b is off; these cannot be told apart" in str(
        found[1]
    )
    assert "position of d" not in str(found[1])


def test_what_is_left_over_beside_something_certain_is_no_contradiction() -> None:
    """cam b with 95.1 %, all of them with 4.1 %: the sigma covers it, and nobody is accused."""
    found = told((Claim.POSITION, ("b",), 0.951), (Claim.POSITION, tuple(PLACES), 0.041))
    assert [(one.cameras, one.undecided) for one in found] == [(("b",), False)]


def test_one_rival_that_is_not_sure_is_not_called_indistinguishable() -> None:
    (found,) = told((Claim.POSITION, ("b",), 0.9))
    assert found.undecided
    assert "told apart" not in str(found)


def test_too_many_rivals_are_nobody() -> None:
    rivals = [(Claim.POSITION, (name,), 0.2) for name in PLACES] + [(Claim.LENS, (name,), 0.1) for name in PLACES]
    assert len(rivals) > MOST_TOLD
    words = contradiction(strained(*rivals), len(PLACES))
    assert "nobody can tell where" in words
    assert not any(f" of {name} " in words for name in PLACES)


@pytest.mark.parametrize(("off_m", "exchanged"), [(2.0, True), (40.0, False)])
def test_two_tripods_each_surveyed_in_the_other_s_place_are_exchanged(off_m: float, exchanged: bool) -> None:
    """Within a tenth of their distance of each other's places."""
    way = np.subtract(PLACES["a"], PLACES["b"])
    a = report("a", survey_misfit_m=tuple(way.tolist()))
    b = report("b", survey_misfit_m=tuple((-way + [off_m, 0.0, 0.0]).tolist()))
    (found,) = told((Claim.POSITION, ("a", "b"), 1.0), a=a, b=b)
    assert ("positions of a and b are exchanged" in str(found)) is exchanged
    assert found.cameras == ("a", "b")


def test_what_is_doubted_is_not_told_a_second_time() -> None:
    """The same clock as a doubt and as one beyond its bound."""
    late = report("b", clock_offset_s=-0.3)
    assert len(told(b=late)) == 1
    assert len(told((Claim.CLOCK, ("b",), 0.99), b=late)) == 1
    assert len(told((Claim.LENS, ("b",), 0.99), b=longer(0.1))) == 1


@pytest.mark.parametrize(("offset_s", "bound_s", "told_of"), [(0.3, 0.005, 1), (0.004, 0.005, 0), (0.3, None, 1)])
def test_clocks_beyond_their_bounds_are_told(offset_s: float, bound_s: float | None, told_of: int) -> None:
    found = told(b=report("b", clock_offset_s=offset_s), bound_s=bound_s)
    assert [one.cause for one in found] == [Cause.CLOCK] * told_of


@pytest.mark.parametrize(("share", "told_of"), [(0.1, 1), (0.02, 0)])
def test_lenses_that_were_moved_by_more_than_lens_files_are_good_for_are_told(share: float, told_of: int) -> None:
    assert [one.cause for one in told(b=longer(share))] == [Cause.LENS] * told_of

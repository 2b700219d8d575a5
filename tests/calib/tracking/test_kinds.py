"""The tracker on flights that are not calm and boxes that are not good: one scene of each kind, other than the bench's.

The bench (`tools.bench.tracking_kinds`) has the figures over many seeds; here no kind may break.
"""

import numpy as np
import pytest

from tools.doubles.tracker_kinds import KINDS
from tools.doubles.tracker_scores import score

SEED = 100
FOLLOWED = (
    "calm, then 2.0 g, 15 Hz",
    "agile, 4 g",
    "circle, 25 m/s, 3 g, 15 Hz",
    "two of three late by 0.4 s",
    "pass at 2.9 km",
    "one camera alone for 5 s",
    "errors that last 1.5 s",
    "half of its noise claimed",
    "a number for each row",
)


@pytest.mark.parametrize("name", FOLLOWED)
def test_every_object_is_followed_under_one_number_with_a_true_sigma(name: str) -> None:
    (kind,) = (kind for kind in KINDS if kind.name == name)
    found = score(kind, range(SEED, SEED + 1))
    # 100 instants or more, their errors alike for a second: the mean of ten draws of three degrees of freedom.
    assert np.mean(found.nees) < 6.0
    assert found.renumbered == 0
    assert found.false == 0
    # A range of kilometres from a base of 90 m takes some seconds to be known at all.
    assert max(found.born_s) < (5.0 if "2.9 km" in name else 1.6)
    assert found.missed < 0.15 * found.seen  # of one camera alone: what is found again half a second after


def test_one_camera_alone_keeps_every_number_in_several_scenes() -> None:
    """Its frames waited for the silent others, and came after the newest: 2 to 5 of 15 were renumbered."""
    (kind,) = (kind for kind in KINDS if kind.name == "one camera alone for 5 s")
    assert score(kind, range(303, 306)).renumbered == 0


@pytest.mark.xfail(
    strict=True, reason="rays that miss each other by half a box do not meet: found late, sigma too small"
)
def test_a_detector_that_puts_its_box_beside_the_object_is_seen_through_at_once() -> None:
    (kind,) = (kind for kind in KINDS if kind.name == "box off by 0.25 m, three cameras")
    found = score(kind, range(SEED, SEED + 1))
    assert max(found.born_s) < 1.6
    assert np.mean(found.nees) < 6.0

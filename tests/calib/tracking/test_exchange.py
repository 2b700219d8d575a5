"""Another network in flight: targets keep their numbers, and nothing that was learnt of the cameras is forgotten."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from calib.tracking.estimates import TargetState
from calib.tracking.targets import Tracker
from tools.doubles.flight import T0_UNIX_NS, Scene
from tools.doubles.tracker_kinds import KINDS, Kind, frames_of, scene_of

SEED = 103  # in which no object leaves the sight of the camera that is left alone
LATER_NS = 3 * 10**9  # by which the other network's own epoch differs


def kind_of(name: str) -> Kind:
    (kind,) = (kind for kind in KINDS if kind.name == name)
    return kind


def followed(tracker: Tracker, kind: Kind, scene: Scene) -> Iterator[float]:
    """Has the tracker follow a scene; s since its beginning, after each frame."""
    for frame in frames_of(kind, scene):
        tracker.observe(frame)
        tracker.advance(tracker.newest_s)
        yield (frame.t_unix_ns - T0_UNIX_NS) * 1e-9


def numbers(tracker: Tracker, scene: Scene) -> list[int]:
    """The number of the target nearest to each object."""
    now_s = tracker.newest_s
    truth = scene.positions(tracker.network.t_mid_unix_ns + round(now_s * 1e9))
    said = tracker.predicted(now_s)
    return [min(said, key=lambda e: float(np.linalg.norm(e.position_enu - at))).track for at in truth]


@pytest.mark.parametrize("blind_at_exchange", [False, True])
def test_targets_keep_their_numbers_also_those_of_one_camera_alone(blind_at_exchange: bool) -> None:
    """All cameras but one see nothing from 5 to 10 s: what it holds an object by is its number in the picture."""
    kind = kind_of("one camera alone for 5 s")
    scene, exchanged = scene_of(kind, SEED), False
    tracker, before = Tracker(scene.network), list[int]()
    for t_s in followed(tracker, kind, scene):
        if not before and t_s > 4:
            before = numbers(tracker, scene)
        if not exchanged and t_s > (8.5 if blind_at_exchange else 4.5):
            assert tracker.alone == (3 if blind_at_exchange else 0)
            tracker.exchange(replace(scene.network, t_mid_unix_ns=T0_UNIX_NS + LATER_NS))
            exchanged = True
    assert sorted(before) == [1, 2, 3]
    assert numbers(tracker, scene) == before


def test_what_was_learnt_of_pixels_that_stay_wrong_counts_under_the_next_network_from_the_first() -> None:
    kind = kind_of("errors that last 1.5 s")
    scene = scene_of(kind, SEED)
    tracker = Tracker(scene.network)
    for _ in followed(tracker, kind, scene):
        pass
    tracker.exchange(replace(scene.network, t_mid_unix_ns=T0_UNIX_NS + LATER_NS))
    first = tracker.estimates(tracker.newest_s)
    tracker.advance(tracker.newest_s + 0.2)  # by which what was learnt is looked at
    assert len(first) == 3
    for was, now in zip(first, tracker.estimates(tracker.newest_s), strict=True):
        assert was.track == now.track
        np.testing.assert_allclose(now.covariance[:3, :3], was.covariance[:3, :3], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("ended_by", ["dismissed", "its camera distrusted"])
def test_what_one_camera_alone_sees_ends_with_the_belief_in_it(ended_by: str) -> None:
    """Its number would otherwise go on to a target found after all was taken back."""
    kind = kind_of("one camera alone for 5 s")
    scene = scene_of(kind, SEED)
    tracker = Tracker(scene.network)
    for t_s in followed(tracker, kind, scene):
        if t_s > 8.5:
            break
    assert tracker.alone == 3
    farewells = tracker.dismiss() if ended_by == "dismissed" else tracker.distrust("cam3", 0.01)
    assert sorted(e.track for e in farewells) == [1, 2, 3]
    assert {e.state for e in farewells} == {TargetState.LOST}
    assert tracker.alone == 0

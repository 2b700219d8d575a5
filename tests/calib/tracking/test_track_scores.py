"""Track scores: what confirms a track, what does not bring one back."""

import numpy as np

from calib.tracking.track_scores import AssociationEvidence, TrackScores


def one_target(last_s: float) -> TrackScores:
    """A confirmed target that two cameras saw until last_s."""
    scores = TrackScores(2)
    scores.add(1, 0.0, ((0, 5), (1, 5)))
    for t_s in np.arange(0.0, last_s, 1 / 30):
        for camera in (0, 1):
            scores.hit(
                camera, np.array([0]), float(t_s), AssociationEvidence(np.array([5]), np.array([8.0]), np.array([2.0]))
            )
    scores.confirm()
    assert scores.confirmed.all()
    return scores


def test_one_detection_where_a_target_was_last_seen_is_not_its_return_but_three_are() -> None:
    """A coasting target's gate is metres wide; sooner or later some clutter falls into it, which is worth little."""
    scores = one_target(1.0)
    scores.hold_back_unseen(2.0)
    weak = AssociationEvidence(np.array([9]), np.array([4.0]), np.array([2.0]))
    before_s = float(scores.last_s[0])
    scores.hit(0, np.array([0]), 2.0, weak)
    assert scores.last_s[0] == before_s
    for t_s in (2.03, 2.07):
        scores.hit(1, np.array([0]), t_s, weak)
    assert scores.last_s[0] == 2.07


def test_a_target_that_many_frames_deny_is_not_kept_alive_by_a_hit_now_and_then() -> None:
    scores = one_target(1.0)
    last_s = float(scores.last_s[0])
    for k in range(60):
        scores.miss(1, np.array([0]), float(np.log(0.2)))
        if k % 10 == 0:
            scores.hit(
                0, np.array([0]), 1.0 + k / 30, AssociationEvidence(np.array([5]), np.array([8.0]), np.array([2.0]))
            )
    assert scores.last_s[0] < last_s + 1.1

"""Which tracks are one object, from true poses: whatever the numbers do, no object is made of two."""

import numpy as np
import pytest

from calib.simulation.simulation import Simulated
from calib.solving.identity import Identified, identify
from calib.solving.inputs import prepare
from calib.solving.scaffold import Pose, threshold_ray
from tools.doubles.hazards.kinds import draw

PURE = 0.97  # of a track's rows: where two objects are within a few pixels of each other, either may be meant


def identified(simulated: Simulated) -> Identified:
    inputs = prepare(simulated.scene)
    poses = {c.id: Pose(c.R_cam_enu, c.centre_enu, 1.0) for c in simulated.network.cameras if c.id in inputs.tracks}
    offsets = {c.id: c.clock_offset_s for c in simulated.network.cameras}
    return identify(inputs.tracks, offsets, poses, threshold_ray(list(inputs.tracks.values())))


def shown(simulated: Simulated, found: Identified) -> dict[int, list[tuple[int, float, int]]]:
    """By object the true source of each of its tracks, what share of its rows is of it, and how many they are."""
    by_object: dict[int, list[tuple[int, float, int]]] = {}
    for name, tracks in found.tracks.items():
        for track in tracks:
            number = found.objects.get((name, track.number))
            if number is not None:
                counts = np.bincount(simulated.rows[name].source[track.row])
                share = float(counts.max() / counts.sum())
                by_object.setdefault(number, []).append((int(counts.argmax()), share, len(track.row)))
    return by_object


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize(
    "kind",
    [
        "healthy_several",
        "healthy_several_missed",
        "numbers_exchanged_often",
        "exchanged_at_meetings",
        "exchanged_any_often",
        "one_number_for_all",
        "rank_by_column",
        "rank_in_any_order",
        "several_new_each_row",
        "several_new_each_0.9_s",
    ],
)
def test_no_object_is_made_of_two(kind: str, number: int) -> None:
    simulated = draw(kind, "choose", 11, number).simulated
    found = shown(simulated, identified(simulated))
    for tracks in found.values():
        assert len({source for source, _, _ in tracks}) == 1
        assert min(share for _, share, _ in tracks) > PURE
    used = sum(rows for tracks in found.values() for _, _, rows in tracks)
    assert used > 0.9 * sum(np.sum(rows.source > 0) for rows in simulated.rows.values())


@pytest.mark.parametrize("number", range(3))
def test_birds_are_matched_where_chance_is_excluded(number: int) -> None:
    simulated = draw("healthy_birds", "choose", 11, number).simulated
    found = shown(simulated, identified(simulated))
    wrong = sum(len({source for source, _, _ in tracks}) > 1 for tracks in found.values())
    assert wrong == 0
    assert len(found) > 5


def test_a_single_object_is_what_it_was() -> None:
    """One thing at a time: no cut, one object, every row of its cameras."""
    simulated = draw("healthy_usual", "choose", 11, 0).simulated
    found = identified(simulated)
    assert set(found.objects.values()) == {0}
    assert {name: [track.number for track in own] for name, own in found.tracks.items()} == {
        name: [track.number for track in own] for name, own in prepare(simulated.scene).tracks.items()
    }

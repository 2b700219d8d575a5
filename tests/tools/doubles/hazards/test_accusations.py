"""Who is accused by an answer: a camera that is named, not one that is listed, and of undecided ones the lot."""

import pytest

from tools.doubles.hazards.accusations import Accusation, in_refusal

CAMERAS = ("cam0", "cam1", "cam2", "cam10")


@pytest.mark.parametrize(
    ("message", "accused"),
    [
        ("georeferencing: 2 calibrated cameras have a surveyed position (cam0, cam2), three must; survey more", set()),
        ("adjustment: cam1 does not fit, and without it nothing can be calibrated; check lens file", {"cam1"}),
        ("the position of cam10 looks wrong by 12.3 m", {"cam10"}),
        ("the positions of cam0, cam1, cam2 and cam10 are exchanged", set()),
        ("survey: the cameras and the flight are upside down; check the pixels' v axis", set()),
    ],
)
def test_a_refusal_accuses_whom_it_says_to_be_wrong(message: str, accused: set[str]) -> None:
    assert {name for accusation in in_refusal(message, CAMERAS) for name in accusation.cameras} == accused


def test_of_cameras_that_cannot_be_told_apart_none_is_accused_falsely_if_the_guilty_one_is_among_them() -> None:
    pair = frozenset({"cam0", "cam1"})
    undecided = Accusation(pair, undecided=True, sentence="cam0 or cam1, which cannot be told")
    assert undecided.innocent(frozenset({"cam1"})) == frozenset()
    assert undecided.innocent(frozenset({"cam2"})) == pair
    assert Accusation(pair, undecided=False, sentence="both").innocent(frozenset({"cam1"})) == {"cam0"}

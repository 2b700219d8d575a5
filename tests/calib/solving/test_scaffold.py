"""The scaffold: every camera has a pose from tracks alone, however many objects are in the air."""

import pytest

from calib.solving.common_time import on_one_time
from calib.solving.inputs import prepare
from calib.solving.scaffold import FAIR_SHARE, build
from tools.doubles.hazards.kinds import draw


@pytest.mark.parametrize(("kind", "seed", "number"), [("healthy_several", 172, 1), ("healthy_several_missed", 171, 1)])
def test_of_four_drones_and_three_cameras_each_camera_has_a_pose(kind: str, seed: int, number: int) -> None:
    """No number of one camera helps another's. Drawn from all combinations of tracks at once, one scene in twelve had
    no pair of cameras that meant the same objects, and was refused."""
    timed = on_one_time(prepare(draw(kind, "choose", seed, number).simulated.scene))
    scaffold = build(timed.inputs.tracks, {name: clock.offset_s for name, clock in timed.clocks.items()})
    assert set(scaffold.poses) == set(timed.inputs.tracks)
    assert min(pose.share for pose in scaffold.poses.values()) > FAIR_SHARE

"""Scenes of trouble: each is one, the same for the same seed, wrong where it says and nowhere else."""

from pathlib import Path

import numpy as np
import pytest

from calib.station.archive import trackfolder
from edge.common.errors import ConfigError
from tools.doubles.hazards import folder
from tools.doubles.hazards.brought import Brought
from tools.doubles.hazards.kinds import HEALTHY_SHARE, KINDS, draw, planned

ALL = pytest.mark.parametrize("kind", list(KINDS))


# What the folder itself gives away, before anything is solved.
REFUSED_AS_READ = {
    "lat_lon_all": "exchanged",
    "lat_lon_one_of_3": "km",
    "lat_lon_one_of_4": "km",
    "portrait_one": "a picture that is turned",
}


def rows(brought: Brought) -> list[np.ndarray]:
    return [np.column_stack([own.t_unix_ns, own.track, own.pixels]) for own in brought.simulated.rows.values()]


@ALL
def test_a_scene_can_be_brought_and_says_whose_fault_it_is(kind: str, tmp_path: Path) -> None:
    brought = draw(kind, "choose", 7, 0)
    assert 2 <= len(brought.cameras) <= 6
    assert {name for fault in brought.faults for name in fault.cameras} <= set(brought.cameras)
    assert brought.healthy == KINDS[kind].healthy
    assert not (brought.healthy and brought.faults)
    folder.write(brought, tmp_path)
    if kind in REFUSED_AS_READ:
        with pytest.raises(ConfigError, match=REFUSED_AS_READ[kind]):
            trackfolder.read(tmp_path)
        return
    read = trackfolder.read(tmp_path)
    assert set(read.rows) == set(brought.cameras)
    # A camera that never saw anything would be a kind of its own; blind in turns or in the end is enough.
    assert min(len(own.t_unix_ns) for own in read.rows.values()) > 30


@pytest.mark.parametrize("kind", ["healthy_usual", "numbers_exchanged_often", "stamps_counted", "swap_of_3"])
def test_the_same_seed_and_number_give_the_same_scene_and_others_another(kind: str) -> None:
    first = draw(kind, "choose", 0, 1)
    again, other, kept_back = draw(kind, "choose", 0, 1), draw(kind, "choose", 0, 2), draw(kind, "report", 0, 1)
    assert all(np.array_equal(one, two) for one, two in zip(rows(first), rows(again), strict=True))
    assert first.note == again.note
    for different in (other, kept_back):
        assert not np.array_equal(rows(first)[0], rows(different)[0])


def test_two_exchanged_positions_are_each_others() -> None:
    brought = draw("swap_of_3", "choose", 0, 0)
    truth = {camera.id: camera.centre_enu for camera in brought.simulated.network.cameras}
    written = {site.id: site.position_enu for site in brought.simulated.scene.cameras}
    one, other = brought.faults[0].cameras
    # Five sigmas of the survey's 4 cm in height.
    assert np.abs(written[one] - truth[other]).max() < 0.2
    assert np.abs(written[other] - truth[one]).max() < 0.2
    assert brought.guilty == {one, other}


def test_a_mirrored_picture_is_counted_from_the_other_side() -> None:
    brought = draw("mirrored_u_one", "choose", 0, 0)
    (name,) = brought.faults[0].cameras
    number = brought.cameras.index(name)
    camera = brought.simulated.network.cameras[number]
    own = brought.simulated.rows[name]
    points = brought.simulated.truth_enu(own.t_unix_ns)
    in_camera = (points - camera.centre_enu) @ camera.R_cam_enu.T
    u = camera.lens.intrinsics[0] * in_camera[:, 0] / in_camera[:, 2] + camera.lens.intrinsics[2]
    assert np.median(np.abs(own.pixels[:, 0] + u - 1919.0)) < 5.0  # 0.7 px of noise


def test_numbers_exchanged_once_change_once_in_one_camera_only() -> None:
    brought = draw("numbers_exchanged_once", "choose", 0, 0)
    changes = {}
    for name, own in brought.simulated.rows.items():
        shown = (own.source > 0) & (own.track <= 2)
        agrees = own.track[shown] == own.source[shown]
        changes[name] = int(np.sum(np.diff(agrees.astype(int)) != 0))
    (guilty,) = brought.faults[0].cameras
    assert changes.pop(guilty) == 1
    assert set(changes.values()) == {0}


def test_a_lens_file_is_told_to_be_off_only_where_it_is() -> None:
    brought = draw("focal_one", "choose", 0, 0)
    assert brought.guilty == set(brought.faults[0].cameras)
    assert draw("healthy_usual", "choose", 0, 0).faults == ()


def test_every_third_scene_is_healthy_and_the_kinds_take_turns() -> None:
    plan = planned(list(KINDS), 300)
    healthy = [KINDS[kind].healthy for kind, _ in plan]
    assert sum(healthy) == 300 // HEALTHY_SHARE
    counts = [sum(name == kind for name, _ in plan) for kind in KINDS if not KINDS[kind].healthy]
    assert max(counts) - min(counts) <= 1
    assert len(set(plan)) == len(plan)

"""Whoever looks sees which box runs another version than the station."""

from calib.station.core.intake import CameraIntake
from calib.station.core.versions import check_versions
from edge.messages import Health


def box(name: str, version: str | None) -> CameraIntake:
    health = Health(t_unix_ns=2 * 10**18, epoch=1, level="ok", items=[], counters={}, version=version or "")
    return CameraIntake(name, health=None if version is None else health)


def test_a_mix_of_versions_is_told() -> None:
    check = check_versions("0.3.0", [box("cam0", "0.3.0"), box("cam1", "0.2.0"), box("cam2", ""), box("cam3", None)])
    assert check.level == "warn"
    assert check.reason == "this is 0.3.0; cam1 runs 0.2.0, cam2 runs an older one, which does not say"


def test_one_version_is_well_and_so_is_a_box_that_was_not_heard() -> None:
    assert check_versions("0.3.0", [box("cam0", "0.3.0"), box("cam1", None)]).level == "ok"
    assert check_versions("0.3.0", []).level == "ok"

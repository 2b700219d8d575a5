"""Where the lenses stand: one offset between antenna and lens, at the box, and a sigma that covers what nobody said."""

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from calib.station.config import BaseConfig, CameraSection, SiteSection, load
from calib.station.core.intake import CameraIntake
from calib.station.core.positions import UNKNOWN_OFFSET_M, Positions, lens_position
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from edge.common.errors import ConfigError
from edge.config import GnssConfig
from edge.gnss.averaging import SERVICES
from edge.gnss.gates import Policy
from edge.gnss.receiver import make_fix
from edge.gnss.session import StaticSession
from edge.messages import Fix, camera_key, decode, encode
from tools.doubles.receiver import Place, gga

SITE = "hill"
ABOVE_M = 0.12
PLACE = Place()
ANTENNA = (PLACE.lat_deg, PLACE.lon_deg, PLACE.altitude_m + PLACE.separation_m)
T0_UNIX_NS = 1_790_000_000 * 10**9


def fix_from(lever_arm_m: tuple[float, float, float] | None) -> Fix:
    """What a box makes of two minutes of a receiver."""
    config = GnssConfig(device="/dev/null", lever_arm_m=lever_arm_m)
    session = StaticSession(SERVICES[config.service], Policy(), baseline_m=0.0)
    t = dt.datetime.fromtimestamp(T0_UNIX_NS * 1e-9, dt.UTC)
    for second in range(120):
        session.feed(gga(t + dt.timedelta(seconds=second), PLACE), float(second))
    surveyed = session.surveyed()
    assert surveyed is not None
    return make_fix(surveyed, config, T0_UNIX_NS)


def station(*, position: tuple[float, float, float] | None = None) -> Station:
    """A station whose origin is the antenna of cam0."""
    sections = [CameraSection(id=f"cam{k}", position=position if k == 0 else None) for k in range(3)]
    config = BaseConfig(site=SiteSection(name=SITE, origin=ANTENNA), camera=sections)
    return Station(config, {section.id: section for section in sections}, StoredState())


def placed(at: Station, payload: bytes) -> tuple[float, float]:
    """Height above the antenna at which the station puts cam0's lens after this fix, and its sigma."""
    at.handle(camera_key(SITE, "cam0", "fix"), payload, T0_UNIX_NS)
    place = at.positions.of("cam0", at.intake.cameras["cam0"])
    assert place is not None
    return float(place[0][2]), float(np.sqrt(place[1][2, 2]))


def warned(at: Station) -> list[str]:
    """The health lines about antennas."""
    at.tick(T0_UNIX_NS + 2 * 10**9)
    assert at.health is not None
    return [f"{item.name}: {item.reason} -> {item.action}" for item in at.health.items if "antenna" in item.name]


def test_a_box_that_knows_its_antennas_offset_sends_the_lens_and_it_is_taken_off_once() -> None:
    fix, at = fix_from((0.0, 0.0, ABOVE_M)), station()
    height_m, sigma_m = placed(at, encode(fix))
    assert fix.of == "lens"
    assert height_m == pytest.approx(-ABOVE_M, abs=1e-3)
    assert sigma_m == pytest.approx(fix.sigma_m[2], rel=1e-6)
    assert warned(at) == []


def test_an_antenna_at_the_lens_is_said_with_zeros() -> None:
    fix = fix_from((0.0, 0.0, 0.0))
    assert fix.of == "lens"
    assert lens_position(fix) == (pytest.approx(ANTENNA, abs=1e-6), pytest.approx(fix.sigma_m))


@pytest.mark.parametrize("older", [False, True])
def test_a_fix_of_the_antenna_is_used_with_a_sigma_that_covers_the_offset_and_said(older: bool) -> None:
    fix, at = fix_from(None), station()
    payload = encode(fix).replace(b',"of":"antenna"', b"") if older else encode(fix)
    assert decode(payload, Fix, where="box") == fix
    height_m, sigma_m = placed(at, payload)
    assert height_m == pytest.approx(0.0, abs=1e-3)
    assert sigma_m == pytest.approx(np.hypot(fix.sigma_m[2], UNKNOWN_OFFSET_M[2]))
    assert sigma_m > ABOVE_M, "a usual mount is within one sigma"
    (line,) = warned(at)
    assert "cam0" in line
    assert "gnss.lever_arm_m" in line


def test_a_surveyed_position_is_the_lens_whatever_the_box_sends() -> None:
    at = station(position=ANTENNA)
    placed(at, encode(fix_from(None)))
    assert warned(at) == []


def test_no_sigma_is_taken_for_better_than_a_receiver_can_be() -> None:
    fix = replace(fix_from((0.0, 0.0, 0.0)), sigma_m=(0.001, 0.001, 0.001))
    assert lens_position(fix)[1] == pytest.approx((0.005, 0.005, 0.005))


def test_the_bases_old_key_is_refused_with_where_it_went(tmp_path: Path) -> None:
    path = tmp_path / "base.toml"
    cameras = "".join(f'[[camera]]\nid = "cam{k}"\n' for k in range(3))
    path.write_text(f'[site]\nname = "hill"\n{cameras}antenna_to_camera_m = [0.0, 0.0, -0.12]\n')
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert caught.value.where == str(path)
    assert ".antenna_to_camera_m is no key of the base any more" in caught.value.what
    assert "gnss.lever_arm_m in the edge.toml" in caught.value.what
    assert "opposite sign" in caught.value.action
    assert "If the box has it already" in caught.value.action
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize("centre", [(47.4, 8.5, 500.0), (-16.8, 180.0, 20.0)])
def test_a_position_of_another_country_is_not_believed_and_said(centre: tuple[float, float, float]) -> None:
    east = 1e-3 + 1.23456e-8  # as a receiver writes them: all on a round grid would be told as rounded
    places = [
        (centre[0], centre[1] - east, 500.0),
        (centre[0] + east, -centre[1] if centre[1] == 180 else centre[1], 500.0),
    ]
    places += [
        (centre[0] - east, -centre[1] + east if centre[1] == 180 else centre[1] + east, 500.0),
        (8.512345678, 47.412345678, 500.0),
    ]
    sections = {f"cam{k}": CameraSection(id=f"cam{k}", position=place) for k, place in enumerate(places)}
    boxes = {name: CameraIntake(name) for name in sections}
    positions = Positions(sections, None)
    positions.update(boxes)
    assert positions.origin is not None
    assert positions.of("cam3", boxes["cam3"]) is None
    for name in ("cam0", "cam1", "cam2"):
        place = positions.of(name, boxes[name])
        assert place is not None
        assert np.linalg.norm(place[0]) < 200
    (check,) = positions.checks(boxes)
    assert (check.name, check.level) == ("position cam3", "fail")
    assert "km from the other cameras" in check.reason

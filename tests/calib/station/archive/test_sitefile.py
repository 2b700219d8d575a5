"""site.toml: what no site can be is refused with what was probably meant; what is unusual is a site like any other."""

from pathlib import Path

import numpy as np
import pytest

from calib.geodesy import enu_to_geodetic
from calib.station.archive import sitefile
from edge.common.errors import ConfigError

PLACES = {"alps": (47.4, 8.5, 500.0), "taveuni": (-16.8, 180.0, 20.0), "chukotka": (66.0, -180.0, 5.0),
          "pole": (89.9999, 30.0, 3.0), "equator": (0.0, 0.0, 0.0), "plata": (-34.6, -58.4, 10.0)}  # fmt: skip
CAMERAS_ENU = np.array([[0.0, 0.0, 2.0], [120.0, 10.0, 1.0], [40.0, 130.0, 3.0], [-60.0, 70.0, 0.0]])
Place = tuple[float, float, float]


def places(at: Place) -> list[Place]:
    return [(lat, lon, h) for lat, lon, h in enu_to_geodetic(CAMERAS_ENU, at).tolist()]


def site(path: Path, positions: list[Place], origin: Place | None = None, begin: str = "") -> Path:
    rows = "".join(
        f'[[camera]]\nid = "cam{k}"\nsize_px = [1920, 1080]\nlens = "radtan"\ndistortion = [0.0, 0.0, 0.0, 0.0]\n'
        f"intrinsics = [1300.0, 1300.0, 960.0, 540.0]\nposition = {list(place)}\n"
        for k, place in enumerate(positions)
    )
    told = f"origin = {list(origin)}\n" if origin else ""
    file = path / "site.toml"
    file.write_text(f'{begin}[site]\nname = "hill"\n{told}{rows}', encoding="utf-8")
    return file


def refusal(file: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        sitefile.load(file)
    assert str(file) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", sorted(PLACES))
def test_the_origin_is_the_middle_of_the_cameras_wherever_they_stand(name: str, tmp_path: Path) -> None:
    _, origin, cameras = sitefile.load(site(tmp_path, places(PLACES[name])))
    found = np.array([camera.position_enu for camera in cameras])
    assert np.abs(found.mean(axis=0)).max() < 0.01
    apart = np.linalg.norm(found[:, None] - found[None], axis=2)
    true = np.linalg.norm(CAMERAS_ENU[:, None] - CAMERAS_ENU[None], axis=2)
    assert apart == pytest.approx(true, abs=1e-3)
    assert -180 <= origin[1] <= 180


def test_an_origin_far_away_is_no_error(tmp_path: Path) -> None:
    assert sitefile.load(site(tmp_path, places(PLACES["alps"]), (48.4, 8.5, 0.0)))[1] == (48.4, 8.5, 0.0)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("name", ["alps", "plata"])
def test_exchanged_coordinates_of_some_cameras_are_named(name: str, count: int, tmp_path: Path) -> None:
    right = places(PLACES[name])
    wrong = [(lon, lat, h) if k < count else (lat, lon, h) for k, (lat, lon, h) in enumerate(right)]
    told = refusal(site(tmp_path, wrong))
    assert "camera cam0" in told
    if count == 1:
        assert "the order of latitude and longitude is wrong" in told
    assert "km from the other cameras" in told


def test_one_of_three_and_two_of_four_are_named_too(tmp_path: Path) -> None:
    (lat, lon, h), *rest = places(PLACES["alps"])[:3]
    assert "camera cam0: its position is 5477 km" in refusal(site(tmp_path, [(lon, lat, h), *rest]))


def test_a_sign_that_is_missing_is_named(tmp_path: Path) -> None:
    (lat, lon, h), *rest = places(PLACES["plata"])
    assert "the sign of its longitude is wrong" in refusal(site(tmp_path, [(lat, -lon, h), *rest]))
    assert "the sign of its latitude is wrong" in refusal(site(tmp_path, [(-lat, lon, h), *rest]))


def test_all_exchanged_is_named_where_the_origin_tells(tmp_path: Path) -> None:
    wrong = [(lon, lat, h) for lat, lon, h in places(PLACES["alps"])]
    assert "latitude and longitude are exchanged" in refusal(site(tmp_path, wrong, PLACES["alps"]))


def test_all_in_one_place_is_refused(tmp_path: Path) -> None:
    assert "all cameras have the same position" in refusal(site(tmp_path, [PLACES["alps"]] * 3))


def test_one_camera_alone_or_none_surveyed_is_a_site(tmp_path: Path) -> None:
    assert len(sitefile.load(site(tmp_path, [PLACES["alps"]]))[2]) == 1


def test_a_longitude_beyond_the_range_is_told_its_own_range(tmp_path: Path) -> None:
    told = refusal(site(tmp_path, [(47.0, 368.0, 500.0), *places(PLACES["alps"])[1:]]))
    assert "camera[0].position[1] = 368.0" in told
    assert "give a number >= -180 and <= 180" in told


def test_an_invisible_mark_at_the_beginning_is_read(tmp_path: Path) -> None:
    assert len(sitefile.load(site(tmp_path, places(PLACES["alps"]), begin="\ufeff"))[2]) == 4

"""WGS 84 against known values: poles, equator, one metre up and down, near the centre of the Earth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geodesy import R_ecef_enu, ecef_to_enu, enu_to_ecef, enu_to_geodetic, geodetic_to_enu, mean_position

A_M, B_M = 6378137.0, 6356752.314245179  # WGS 84's semi-axes
HERE = np.zeros((1, 3))

# Origin (latitude deg, longitude deg, height m) and its ECEF metres.
TABLE = [
    ((0.0, 0.0, 0.0), (A_M, 0.0, 0.0)),
    ((0.0, 90.0, 0.0), (0.0, A_M, 0.0)),
    ((0.0, 180.0, 0.0), (-A_M, 0.0, 0.0)),
    ((0.0, -90.0, 1.0), (0.0, -A_M - 1, 0.0)),
    ((90.0, 0.0, 0.0), (0.0, 0.0, B_M)),
    ((-90.0, 0.0, -1.0), (0.0, 0.0, -B_M + 1)),
    ((0.0, 0.0, 1 - A_M), (1.0, 0.0, 0.0)),  # a metre from the centre
    # By the closed form N = a / sqrt(1 - e^2 sin^2), computed with forty digits.
    ((45.0, 45.0, 0.0), (3194419.1450605732, 3194419.1450605732, 4487348.408865919)),
]


def closed_form(latitude_deg: float, longitude_deg: float, height_m: float) -> np.ndarray:
    lat, lon = np.radians([latitude_deg, longitude_deg])
    e2 = 1 - (B_M / A_M) ** 2
    N = A_M / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    flat = (N + height_m) * np.cos(lat)
    return np.array([flat * np.cos(lon), flat * np.sin(lon), (N * (1 - e2) + height_m) * np.sin(lat)])


@pytest.mark.parametrize(("origin", "ecef"), TABLE)
def test_known_places(origin: tuple[float, float, float], ecef: tuple[float, float, float]) -> None:
    assert closed_form(*origin) == pytest.approx(ecef, abs=1e-3)
    assert enu_to_ecef(HERE, origin)[0] == pytest.approx(closed_form(*origin), abs=2e-9)  # two units in the last place


def test_one_degree_along_equator_and_meridian() -> None:
    east = geodetic_to_enu(np.array([[0.0, 1e-4, 0.0]]), (0.0, 0.0, 0.0))[0]
    north = geodetic_to_enu(np.array([[1e-4, 0.0, 0.0]]), (0.0, 0.0, 0.0))[0]
    assert east[0] == pytest.approx(A_M * np.radians(1e-4), abs=1e-6)
    assert north[1] == pytest.approx(B_M**2 / A_M * np.radians(1e-4), abs=1e-6)  # the meridian's radius there


latitudes = st.floats(-89.9, 89.9)
longitudes = st.floats(-180, 180)
kilometres = st.floats(-5000, 5000)


@given(origin=st.tuples(latitudes, longitudes, st.floats(-400, 9000)), place=st.tuples(*[kilometres] * 3))
def test_there_and_back(origin: tuple[float, float, float], place: tuple[float, float, float]) -> None:
    enu = np.array([place])
    # A double of 6.4e6 m has steps of 1e-9 m; a degree in double has 1e-14, 1.5e-9 m on the ground.
    assert ecef_to_enu(enu_to_ecef(enu, origin), origin) == pytest.approx(enu, abs=2e-8)
    assert geodetic_to_enu(enu_to_geodetic(enu, origin), origin) == pytest.approx(enu, abs=2e-7)


@given(lat=latitudes, lon=longitudes)
def test_the_rotation_is_the_frames_own(lat: float, lon: float) -> None:
    origin = (lat, lon, 0.0)
    R = R_ecef_enu(origin)
    assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
    assert np.linalg.det(R) == pytest.approx(1.0)
    vector = np.array([[12.0, -7.0, 3.0]])
    moved = enu_to_ecef(vector, origin) - enu_to_ecef(HERE, origin)
    assert moved[0] == pytest.approx(R @ vector[0], abs=5e-9)


@pytest.mark.parametrize("lon_deg", [8.5, 179.99995, -179.99995, 0.0])
def test_the_middle_of_a_site_is_in_the_middle_on_the_date_line_too(lon_deg: float) -> None:
    corners = np.array([[30.0, -20.0, 1.0], [-30.0, -20.0, 2.0], [0.0, 40.0, 3.0]])
    places = enu_to_geodetic(corners, (10.0, lon_deg, 100.0))
    assert geodetic_to_enu(np.array([mean_position(places)]), (10.0, lon_deg, 100.0))[0] == pytest.approx(
        [0.0, 0.0, 2.0], abs=1e-3
    )
    assert abs(mean_position(places)[1]) <= 180.0

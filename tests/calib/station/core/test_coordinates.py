"""How finely positions were written: against rounding, over the whole Earth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.geodesy import enu_to_geodetic, geodetic_to_enu
from calib.station.config import UNSTATED_SIGMA_M
from calib.station.core.coordinates import Written

RTK: tuple[float, float, float] = (0.02, 0.02, 0.04)


def written(*positions: tuple[float, float, float]) -> Written:
    """Of positions that come without a sigma."""
    return Written.of([(position, UNSTATED_SIGMA_M) for position in positions])


latitudes, longitudes = st.floats(-80, 80), st.floats(-180, 180)


@given(latitude=latitudes, longitude=longitudes, count=st.integers(0, 6))
def test_no_more_decimals_are_found_than_were_written(latitude: float, longitude: float, count: int) -> None:
    """Fewer may be found: some of the last digits are noughts."""
    place = (round(latitude, count), round(longitude, count), 450.123)
    found = written(place, place).decimals
    assert found is not None
    assert found <= count


@pytest.mark.parametrize("count", [3, 4])  # with five, the sigma that everything gets is a part of it
def test_the_error_of_rounding_is_what_the_sigma_says(count: int) -> None:
    """Of a uniform error, over 4000 places: its mean square is known to 4 sigma of 2 / sqrt(5 * 4000)."""
    rng = np.random.default_rng(1)
    square = []
    for latitude, longitude in zip(rng.uniform(-70, 70, 4000), rng.uniform(-179, 179, 4000), strict=True):
        true = (latitude, longitude, 300.0)
        place = (round(latitude, count), round(longitude, count), 300.1234)
        off = geodetic_to_enu(np.array([place]), true)[0][:2]
        square.append((off / np.array(Written(count).sigma_m(place, UNSTATED_SIGMA_M)[:2])) ** 2)
    assert np.mean(square, axis=0) == pytest.approx([1.0, 1.0], abs=0.07)


def test_a_receivers_position_keeps_its_sigma() -> None:
    place = (47.123456789, 8.987654321, 450.0)
    found = written(place, place)
    assert found.sigma_m(place, UNSTATED_SIGMA_M) == UNSTATED_SIGMA_M
    assert found.coarse is None


def test_a_sigma_that_was_stated_stands() -> None:
    """A made-up site stands on round places and says so: the solver's test of what is claimed is its second witness."""
    place = (47.1, 8.9, 450.0)
    assert Written.of([(place, RTK), (place, RTK)]).decimals is None
    assert Written(1).sigma_m(place, RTK) == RTK


def test_one_camera_at_a_round_place_is_no_rounding() -> None:
    """It stands at the origin, and the others where they were surveyed."""
    origin, other = (47.4, 8.5, 450.0), (47.400812345, 8.501234567, 451.2)
    assert written(origin, other).decimals is None
    assert written(origin).decimals is None
    assert written().decimals is None


def test_the_finest_of_a_site_says_how_it_was_written() -> None:
    assert written((47.4, 8.5, 450.0), (47.4008, 8.5012, 451.2)).decimals == 4


def test_a_height_counts_as_rounded_only_beside_rounded_angles() -> None:
    whole, fine = (47.1235, 8.9877, 450.0), (47.1235, 8.9877, 450.37)
    assert Written(4).sigma_m(whole, UNSTATED_SIGMA_M)[2] == pytest.approx(np.hypot(0.1, 1 / np.sqrt(12)))
    assert Written(4).sigma_m(fine, UNSTATED_SIGMA_M)[2] == 0.1


def test_a_rounded_position_is_still_seen_after_another_frame() -> None:
    """A file written by a program that computes in metres: a tenth of a millimetre is lost, not the grid."""
    origin = (47.0, 9.0, 400.0)
    there = geodetic_to_enu(np.array([(47.0012, 9.0034, 431.0), (47.0031, 9.0007, 431.0)]), origin)
    back = [(float(lat), float(lon), float(height)) for lat, lon, height in enu_to_geodetic(there, origin)]
    assert written(*back).decimals == 4


def test_the_user_is_told_how_far_off_they_may_be() -> None:
    assert Written(4).coarse == (
        "the positions are written to 4 decimals of a degree: each may be off by 5.6 m, which is allowed for"
    )

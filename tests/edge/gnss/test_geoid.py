"""EGM96 as it ships: against heights that others publish, over the seams of its grid."""

import numpy as np
import pytest

from edge.gnss.geoid import undulation_m


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "expected_m"),
    [
        # NIMA's own test points (OUTPUT.DAT beside its program F477).
        (38.6281550, 269.7791550, -31.628),
        (-14.6212170, 305.0211140, -2.969),
        (46.8743190, 102.4487290, -43.575),
        (-23.6174460, 133.8747120, 15.871),
        (38.6254730, 359.9995000, 50.066),
        (-0.4667440, 0.0023000, 17.329),
    ],
)
def test_against_published_heights(lat_deg: float, lon_deg: float, expected_m: float) -> None:
    assert undulation_m(lat_deg, lon_deg) == pytest.approx(expected_m, abs=0.1)


def test_nothing_jumps_at_the_date_line_or_the_poles() -> None:
    for lat_deg in np.linspace(-89.9, 89.9, 37):
        assert undulation_m(lat_deg, 179.9999) == pytest.approx(undulation_m(lat_deg, -179.9999), abs=0.05)
    for pole in (-90.0, 90.0):
        heights = [undulation_m(pole, lon_deg) for lon_deg in np.linspace(-180, 180, 25)]
        assert np.ptp(heights) < 0.2

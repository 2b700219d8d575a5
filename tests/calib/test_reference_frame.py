"""Whether a label names a frame, and what it adds to a sigma on the Earth if it does not."""

import pytest

from calib.reference_frame import UNKNOWN_FRAME_SIGMA_M, ReferenceFrame, frame_of_all


@pytest.mark.parametrize(
    ("label", "known"), [("EPSG:7931", True), ("ETRF2000", True), ("WGS84", False), ("", False), (" Unknown ", False)]
)
def test_which_labels_name_a_realisation(label: str, known: bool) -> None:
    assert ReferenceFrame(label).known is known
    assert ReferenceFrame(label).sigma_m == (0.0 if known else UNKNOWN_FRAME_SIGMA_M)


def test_what_a_conversion_is_good_for_stays_with_its_coordinates() -> None:
    assert ReferenceFrame("EPSG:9989", 0.1).sigma_m == pytest.approx(0.1)
    assert ReferenceFrame("unknown", 0.1).sigma_m == pytest.approx(1.005, abs=1e-3)


def test_a_site_is_known_as_well_as_the_least_known_of_its_cameras() -> None:
    converted, unknown = ReferenceFrame("EPSG:9989", 0.05), ReferenceFrame("WGS84")
    assert frame_of_all([ReferenceFrame("ETRS89"), converted]) == converted
    assert frame_of_all([converted, unknown]) == unknown
    assert frame_of_all([]).sigma_m == UNKNOWN_FRAME_SIGMA_M

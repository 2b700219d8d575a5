"""The hottest zone counts, a zone that does not answer is left out, and a box without zones says nothing."""

from pathlib import Path

import pytest

from edge.temperature import check_temperature


@pytest.mark.parametrize(("millidegrees", "level"), [(40_000, "ok"), (75_000, "warn"), (85_000, "fail")])
def test_the_hottest_zone_counts(tmp_path: Path, millidegrees: int, level: str) -> None:
    for number, text in enumerate(["20000", str(millidegrees), "off"]):
        (tmp_path / f"thermal_zone{number}").mkdir()
        (tmp_path / f"thermal_zone{number}" / "temp").write_text(text)
    (check,) = check_temperature(tmp_path)
    assert (check.level, check.reason) == (level, f"{millidegrees // 1000} °C")
    assert bool(check.action) == (level != "ok")


def test_a_box_without_zones_says_nothing(tmp_path: Path) -> None:
    assert check_temperature(tmp_path) == []

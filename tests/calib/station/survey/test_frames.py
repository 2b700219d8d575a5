"""Frames: what PROJ does silently is refused, what is asked for by name is right."""

import builtins
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from calib.geodesy import geodetic_to_enu
from calib.station.survey.frames import convert
from edge.common.errors import ConfigError

PLACES = {"frankfurt": (50.1, 8.7, 150.0), "boulder": (40.0, -105.2, 1600.0), "sydney": (-33.9, 151.2, 50.0)}

pyproj = pytest.importorskip("pyproj", reason='pyproj is not installed (pip install "skyfix[frames]")')


@pytest.mark.parametrize(
    ("place", "source", "shift_m"),
    [
        # Plate motion and datum differences at 2026.9, published to the centimetre.
        ("frankfurt", "EPSG:7931", (0.69, 0.67, 0.02)),
        ("boulder", "EPSG:6319", (-1.35, 0.52, -0.85)),
        ("sydney", "EPSG:7843", (0.12, 0.37, 0.00)),
    ],
)
def test_a_realisation_is_converted_at_its_epoch(place: str, source: str, shift_m: tuple[float, float, float]) -> None:
    converted = convert(np.array([PLACES[place]]), source, "EPSG:9989", 2026.9)
    moved = geodetic_to_enu(converted.geodetic, PLACES[place])[0]
    assert moved == pytest.approx(shift_m, abs=0.02)
    assert 0 <= converted.accuracy_m <= 0.1
    assert "2026.9" in converted.note


def test_the_epoch_matters() -> None:
    early, late = (
        convert(np.array([PLACES["frankfurt"]]), "EPSG:7931", "EPSG:9989", epoch).geodetic for epoch in (2015.0, 2026.9)
    )
    # Eurasia moves 2.5 cm a year.
    assert np.linalg.norm(geodetic_to_enu(late, tuple(early[0]))) == pytest.approx(0.30, abs=0.03)


@pytest.mark.parametrize(
    ("source", "target", "words"),
    [
        ("EPSG:4979", "EPSG:9989", "no operation"),  # WGS 84 the ensemble: 2 m
        ("EPSG:4480", "EPSG:9989", "no operation"),  # CGCS2000: PROJ has none
        ("EPSG:6667", "EPSG:9989", "no operation"),  # JGD2011: none either
        ("EPSG:7931", "EPSG:4979", "no target"),  # the official null operation
        ("EPSG:4258", "EPSG:9989", "ellipsoidal height"),  # two-dimensional
        ("EPSG:7789", "EPSG:9989", "ellipsoidal height"),  # geocentric
        ("EPSG:0", "EPSG:9989", "no frame"),
        ("nonsense", "EPSG:9989", "no frame"),
    ],
)
def test_null_ballpark_and_senseless_operations_are_refused(source: str, target: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        convert(np.array([PLACES["frankfurt"]]), source, target, 2026.9)
    assert caught.value.action


def test_an_epoch_out_of_range_is_refused() -> None:
    with pytest.raises(ConfigError, match="epoch"):
        convert(np.array([PLACES["frankfurt"]]), "EPSG:7931", "EPSG:9989", 20.269)


def test_without_pyproj_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> Any:
        if name.startswith("pyproj"):
            raise ImportError(name)
        return real(name, globals, locals, fromlist, level)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match="not installed") as caught:
        convert(np.array([PLACES["frankfurt"]]), "EPSG:7931", "EPSG:9989", 2026.9)
    assert "skyfix[frames]" in caught.value.action

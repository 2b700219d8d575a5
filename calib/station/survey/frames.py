"""Which reference frame coordinates are in, and the explicit conversion from one realisation to another.

The hazard is the conversion that does nothing and says nothing. A rover's coordinates are in the frame of whoever sends
the corrections, not in WGS 84, and after thirty years of plate motion the two lie 0.5 to 2 m apart. Asked for ETRS89 to
WGS 84, PROJ returns the input unchanged, by an official null operation of 1 m accuracy; without an epoch it takes the
reference epoch's, 0.2 m wrong; and for CGCS2000 it has nothing at all. So coordinates pass through with their label
unless a conversion is asked for by name, with its epoch, and only operations that claim 0.1 m or better are taken.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from edge.common.arrays import Array
from edge.common.errors import ConfigError

if TYPE_CHECKING:
    from pyproj import Transformer

TARGETS: Final = {"EPSG:9989": "ITRF2020", "EPSG:10605": "WGS 84 (G2296)"}
WORST_ACCURACY_M: Final = 0.1  # of an operation; what claims less is a null operation under another name
PLAUSIBLE_YEARS: Final = (1980.0, 2100.0)  # decimal years


@dataclass(frozen=True)
class Converted:
    """geodetic: (N, 3) in the target frame. note: the operation, its epoch and accuracy, to be kept with the points."""

    geodetic: Array
    accuracy_m: float
    note: str


def convert(geodetic: Array, source: str, target: str, epoch: float) -> Converted:
    """(N, 3) latitude deg, longitude deg, ellipsoidal m from one EPSG 3-D frame to ITRF2020 or WGS 84 (G2296).

    epoch: decimal year of the coordinates. Raises ConfigError where there is no operation that can be trusted.
    """
    if target not in TARGETS:
        allowed = " or ".join(f"{code} ({name})" for code, name in TARGETS.items())
        raise ConfigError(f"{target} is no target of a conversion", where="survey frame", action=f"give {allowed}")
    if not PLAUSIBLE_YEARS[0] <= epoch <= PLAUSIBLE_YEARS[1]:
        raise ConfigError(f"epoch {epoch}", where="survey frame", action="give the decimal year of the coordinates")
    transformer = _transformer(source, target)
    latitude, longitude, height = np.asarray(geodetic, float).reshape(-1, 3).T
    out = np.column_stack(transformer.transform(latitude, longitude, height, np.full(len(latitude), epoch))[:3])
    if not np.all(np.isfinite(out)):
        raise _refused(source, target, "the operation does not cover these coordinates")
    note = f"{source} to {target} at {epoch:g}: {transformer.description}, {transformer.accuracy:g} m"
    return Converted(out, float(transformer.accuracy), note)


def _transformer(source: str, target: str) -> "Transformer":
    try:
        from pyproj import CRS  # noqa: PLC0415 -- 33 MB that only a conversion needs
        from pyproj.exceptions import CRSError  # noqa: PLC0415
        from pyproj.transformer import TransformerGroup  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(
            "pyproj is not installed", where="survey frame", action='pip install "skyfix[frames]"'
        ) from error
    try:
        crs = CRS.from_user_input(source)
    except CRSError as error:
        raise ConfigError(f"{source!r} is no frame", where="survey frame", action="give EPSG:<code>") from error
    if not crs.is_geographic or len(crs.axis_info) != 3:
        raise ConfigError(
            f"{source} ({crs.name}) is not a frame of latitude, longitude and ellipsoidal height",
            where="survey frame",
            action="give the 3-D geographic code of the realisation, such as EPSG:7931 for ETRF2000",
        )
    for transformer in TransformerGroup(crs, target, allow_ballpark=False).transformers:
        if 0 <= transformer.accuracy <= WORST_ACCURACY_M:
            return transformer
    raise _refused(source, target, f"no operation of {WORST_ACCURACY_M} m or better")


def _refused(source: str, target: str, why: str) -> ConfigError:
    return ConfigError(
        f"{source} cannot be converted to {target}: {why}",
        where="survey frame",
        action="name the realisation, not the datum, or give a measured shift: `base-station survey frame --shift`",
    )

"""A static RTK receiver in software: correlated error and the sentences that carry it. Seeded; for benches and tests.

The error is the sum of two Gauss-Markov processes an axis, which reproduces the block means of real network RTK.
"""

import datetime as dt
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Final

import numpy as np

from edge.common.arrays import Array
from edge.gnss.gates import metres_per_degree

FAST: Final = ((0.0095, 20.0), (0.0095, 20.0), (0.024, 25.0))  # sigma m, tau s: east, north, up
SLOW: Final = ((0.0055, 400.0), (0.0055, 400.0), (0.016, 500.0))


@dataclass(frozen=True)
class Place:
    """Where the antenna is: degrees, metres above the geoid, and the geoid above the ellipsoid."""

    lat_deg: float = 48.7733
    lon_deg: float = 8.9121
    altitude_m: float = 419.166
    separation_m: float = 47.535


def gauss_markov(t_s: Array, sigma_m: float, tau_s: float, rng: np.random.Generator) -> Array:
    """(N,) a first-order Gauss-Markov process at ascending times (N,)."""
    keep = np.exp(-np.diff(t_s) / tau_s)
    drive = rng.standard_normal(len(t_s)) * sigma_m
    out = np.empty(len(t_s))
    out[0] = drive[0]
    for i, share in enumerate(keep, start=1):
        out[i] = share * out[i - 1] + np.sqrt(1 - share * share) * drive[i]
    return out


def rtk_error(t_s: Array, rng: np.random.Generator) -> Array:
    """(N, 3) east, north, up metres of error at times (N,)."""
    axes = zip(FAST, SLOW, strict=True)
    return np.column_stack([gauss_markov(t_s, *fast, rng) + gauss_markov(t_s, *slow, rng) for fast, slow in axes])


def sentence(body: str) -> bytes:
    """A body between `$` and `*`, framed."""
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def gga(
    t: dt.datetime,
    place: Place,
    error_m: Array | None = None,
    *,
    quality: int = 4,
    age: str = "1.0",
    separation: str | None = None,
    decimals: int = 7,
) -> bytes:
    """A GGA sentence at `t` of a place, off by error_m (3,) east, north, up."""
    east, north, up = (0.0, 0.0, 0.0) if error_m is None else error_m
    per_lon_m, per_lat_m = metres_per_degree(place.lat_deg)
    lat, lon = place.lat_deg + north / per_lat_m, place.lon_deg + east / per_lon_m
    shown = f"{place.separation_m:.3f}" if separation is None else separation
    return sentence(
        f"GNGGA,{_clock(t)},{_angle(lat, 2, decimals)},{'N' if lat >= 0 else 'S'},{_angle(lon, 3, decimals)},"
        f"{'E' if lon >= 0 else 'W'},{quality},12,0.5,{place.altitude_m + up:.3f},M,{shown},M,{age},0000"
    )


def rmc(t: dt.datetime, mode: str = "R") -> bytes:
    """An RMC sentence: date and mode."""
    return sentence(f"GNRMC,{_clock(t)},A,,,,,0.004,,{t:%d%m%y},,,{mode},V")


def gst(t: dt.datetime, sigma_m: float = 0.014) -> bytes:
    """A GST sentence: the receiver's own opinion."""
    return sentence(f"GNGST,{_clock(t)},25,,,,{sigma_m:.3f},{sigma_m:.3f},{2 * sigma_m:.3f}")


def zda(t: dt.datetime) -> bytes:
    """A ZDA sentence: date."""
    return sentence(f"GNZDA,{_clock(t)},{t:%d,%m,%Y},00,00")


def _clock(t: dt.datetime) -> str:
    return f"{t:%H%M%S}.{t.microsecond // 10000:02d}"


def _angle(degrees: float, digits: int, decimals: int) -> str:
    """Degrees and decimal minutes, carried properly at 60."""
    steps = round(abs(degrees) * 60 * 10**decimals)
    whole, minutes = divmod(steps, 60 * 10**decimals)
    return f"{whole:0{digits}d}{minutes // 10**decimals:02d}.{minutes % 10**decimals:0{decimals}d}"

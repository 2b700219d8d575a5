"""GeoJSON (RFC 7946), whose heights are above the WGS 84 ellipsoid by the standard: one feature a stretch."""

from typing import Any

import msgspec

from calib.station.export.flown import Flown, Track, utc


def write(flown: Flown) -> bytes:
    """The document's bytes."""
    features = [_feature(track, rows) for track in flown.tracks for rows in track.stretches()]
    document = {"type": "FeatureCollection", "name": flown.name, "features": features}
    return msgspec.json.encode(document) + b"\n"


def _feature(track: Track, rows: slice) -> dict[str, Any]:
    """A line; a stretch of a single row is a point, for a line has two."""
    places = [[round(lon, 9), round(lat, 9), round(height, 4)] for lat, lon, height in track.geodetic[rows].tolist()]
    times = [utc(t) for t in track.t_unix_ns[rows].tolist()]
    line = len(places) > 1
    geometry = {"type": "LineString" if line else "Point", "coordinates": places if line else places[0]}
    sigma = [[round(value, 4) for value in row] for row in track.sigma_enu_m[rows].tolist()]
    told = {"track": track.number, "utc": times, "sigma_east_north_up_m": sigma}
    return {"type": "Feature", "geometry": geometry, "properties": told}

"""CSV for spreadsheets and programs: one row a position; `stretch` counts up over gaps."""

from typing import Final

from calib.station.export.flown import Flown, utc

TABLE_HEADER: Final = "t_unix_ns,utc,track,stretch,lat_deg,lon_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m"


def write(flown: Flown) -> bytes:
    """The table's bytes; height_m is above the WGS 84 ellipsoid."""
    lines = [TABLE_HEADER]
    for track in flown.tracks:
        for stretch, rows in enumerate(track.stretches()):
            for t, (lat, lon, height), (east, north, up) in zip(
                track.t_unix_ns[rows].tolist(),
                track.geodetic[rows].tolist(),
                track.sigma_enu_m[rows].tolist(),
                strict=True,
            ):
                lines.append(
                    f"{t},{utc(t)},{track.number},{stretch},{lat:.9f},{lon:.9f},{height:.4f},{east:.4f},{north:.4f},{up:.4f}"
                )
    return ("\n".join(lines) + "\n").encode()

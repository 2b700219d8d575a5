"""GPX 1.1: one trk a track, one trkseg a stretch."""

import xml.etree.ElementTree as ET
from typing import Final

from calib.station.export.flown import Flown, Track, utc
from edge import __version__

GPX: Final = "http://www.topografix.com/GPX/1/1"


def write(flown: Flown) -> bytes:
    """The document's bytes."""
    ET.register_namespace("", GPX)
    root = ET.Element(f"{{{GPX}}}gpx", {"version": "1.1", "creator": f"skyfix {__version__}"})
    metadata = ET.SubElement(root, f"{{{GPX}}}metadata")
    ET.SubElement(metadata, f"{{{GPX}}}name").text = flown.name
    ET.SubElement(metadata, f"{{{GPX}}}desc").text = flown.heights
    for track in flown.tracks:
        _trk(root, flown, track)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _trk(root: ET.Element, flown: Flown, track: Track) -> None:
    trk = ET.SubElement(root, f"{{{GPX}}}trk")
    ET.SubElement(trk, f"{{{GPX}}}name").text = f"track {track.number}"
    heights_m = flown.sea_level_m(track)
    for rows in track.stretches():
        segment = ET.SubElement(trk, f"{{{GPX}}}trkseg")
        for t, (lat, lon, _), height in zip(
            track.t_unix_ns[rows].tolist(), track.geodetic[rows].tolist(), heights_m[rows].tolist(), strict=True
        ):
            point = ET.SubElement(segment, f"{{{GPX}}}trkpt", {"lat": f"{lat:.9f}", "lon": f"{lon:.9f}"})
            ET.SubElement(point, f"{{{GPX}}}ele").text = f"{height:.4f}"
            ET.SubElement(point, f"{{{GPX}}}time").text = utc(t)
            if flown.undulation_m is not None:
                ET.SubElement(point, f"{{{GPX}}}geoidheight").text = f"{flown.undulation_m:.3f}"

"""KML 2.2 with Google's gx:Track, which Google Earth plays in time: one placemark a track, one gx:Track a stretch."""

import xml.etree.ElementTree as ET
from typing import Final

from calib.station.export.flown import Flown, Track, utc

KML: Final = "http://www.opengis.net/kml/2.2"
GX: Final = "http://www.google.com/kml/ext/2.2"


def write(flown: Flown) -> bytes:
    """The document's bytes."""
    ET.register_namespace("", KML)
    ET.register_namespace("gx", GX)
    root = ET.Element(f"{{{KML}}}kml")
    document = ET.SubElement(root, f"{{{KML}}}Document")
    ET.SubElement(document, f"{{{KML}}}name").text = flown.name
    ET.SubElement(document, f"{{{KML}}}description").text = flown.heights
    for track in flown.tracks:
        _placemark(document, flown, track)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _placemark(document: ET.Element, flown: Flown, track: Track) -> None:
    placemark = ET.SubElement(document, f"{{{KML}}}Placemark")
    ET.SubElement(placemark, f"{{{KML}}}name").text = f"track {track.number}"
    several = ET.SubElement(placemark, f"{{{GX}}}MultiTrack")
    ET.SubElement(several, f"{{{KML}}}altitudeMode").text = "absolute"
    ET.SubElement(several, f"{{{GX}}}interpolate").text = "0"  # the viewer is not to fill the gaps
    heights_m = flown.sea_level_m(track)
    for rows in track.stretches():
        drawn = ET.SubElement(several, f"{{{GX}}}Track")
        ET.SubElement(drawn, f"{{{KML}}}altitudeMode").text = "absolute"
        for t in track.t_unix_ns[rows].tolist():
            ET.SubElement(drawn, f"{{{KML}}}when").text = utc(t)
        for (lat, lon, _), height in zip(track.geodetic[rows].tolist(), heights_m[rows].tolist(), strict=True):
            ET.SubElement(drawn, f"{{{GX}}}coord").text = f"{lon:.9f} {lat:.9f} {height:.4f}"

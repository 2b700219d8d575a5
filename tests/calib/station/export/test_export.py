"""Exports are read back by parsers that are not ours: positions to the millimetre, gaps as gaps, heights named."""

import csv
import io
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from calib.station.app import main
from calib.station.archive import flown_file
from calib.station.archive.recording import Recorder
from calib.station.export import FORMATS
from calib.station.export.flown import Flown, Track, utc
from edge.common.errors import SkyfixError
from edge.messages import Target, Targets, encode, station_key

T0_NS = 1_700_000_000_123_456_789
STEP_NS = 50_000_000
PLACE = (47.4085, 8.5071, 580.0)
KML = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
GPX = {"g": "http://www.topografix.com/GPX/1/1"}
MM_DEG = 1e-3 / 111_000  # a millimetre of latitude


def track(number: int = 7, rows: int = 40, hole: int | None = None) -> Track:
    """Straight to the north-east; hole: from this row on everything is 5 s later."""
    t = T0_NS + STEP_NS * np.arange(rows)
    if hole is not None:
        t[hole:] += 5_000_000_000
    k = np.arange(rows)
    geodetic = np.column_stack([PLACE[0] + 1e-6 * k, PLACE[1] + 1e-6 * k, PLACE[2] + 0.1 * k])
    return Track(number, t, geodetic, np.full((rows, 3), 0.05))


FLOWN = Flown("hill & <dale>", (track(7, hole=25), track(9, rows=1)))


def test_stretches_end_where_nothing_was_seen() -> None:
    assert FLOWN.tracks[0].stretches() == [slice(0, 25), slice(25, 40)]
    assert FLOWN.tracks[1].stretches() == [slice(0, 1)]


def test_times_are_utc_to_the_microsecond() -> None:
    assert utc(T0_NS) == "2023-11-14T22:13:20.123456Z"


def test_kml_has_a_track_for_each_stretch() -> None:
    root = ET.fromstring(FORMATS["kml"].write(FLOWN))
    assert root.findtext("k:Document/k:name", namespaces=KML) == FLOWN.name
    assert "ellipsoid, not above the sea" in str(root.findtext("k:Document/k:description", namespaces=KML))
    drawn = root.findall(".//gx:Track", KML)
    assert [len(one.findall("k:when", KML)) for one in drawn] == [25, 15, 1]
    assert [len(one.findall("gx:coord", KML)) for one in drawn] == [25, 15, 1]
    assert {mode.text for mode in root.findall(".//k:altitudeMode", KML)} == {"absolute"}
    lon, lat, height = map(float, str(drawn[1].findtext("gx:coord", namespaces=KML)).split())
    assert (lat, lon, height) == pytest.approx(FLOWN.tracks[0].geodetic[25], abs=MM_DEG)


def test_gpx_has_a_segment_for_each_stretch_and_can_be_above_the_sea() -> None:
    root = ET.fromstring(FORMATS["gpx"].write(replace(FLOWN, undulation_m=47.6)))
    assert root.get("version") == "1.1"
    segments = root.findall("g:trk/g:trkseg", GPX)
    assert [len(segment) for segment in segments] == [25, 15, 1]
    point = segments[0][0]
    assert [child.tag.partition("}")[2] for child in point] == ["ele", "time", "geoidheight"], "the schema's order"
    assert float(str(point.findtext("g:ele", namespaces=GPX))) == pytest.approx(PLACE[2] - 47.6)
    assert float(str(point.findtext("g:geoidheight", namespaces=GPX))) == pytest.approx(47.6)
    assert "taken as 47.6 m" in str(root.findtext("g:metadata/g:desc", namespaces=GPX))


def test_geojson_has_a_feature_for_each_stretch() -> None:
    told = json.loads(FORMATS["geojson"].write(FLOWN))
    kinds = [(f["geometry"]["type"], f["properties"]["track"]) for f in told["features"]]
    assert kinds == [("LineString", 7), ("LineString", 7), ("Point", 9)]
    line = told["features"][0]
    assert len(line["geometry"]["coordinates"]) == len(line["properties"]["utc"]) == 25
    lon, lat, height = line["geometry"]["coordinates"][0]
    assert (lat, lon, height) == pytest.approx(PLACE, abs=MM_DEG)


def test_csv_counts_stretches() -> None:
    rows = list(csv.DictReader(io.StringIO(FORMATS["csv"].write(FLOWN).decode())))
    assert [int(row["stretch"]) for row in rows] == [0] * 25 + [1] * 15 + [0]
    assert [int(row["t_unix_ns"]) for row in rows[:40]] == FLOWN.tracks[0].t_unix_ns.tolist()


def recorded(folder: Path) -> Path:
    """A recording of one target that is tentative first, then confirmed, then coasts."""
    recorder = Recorder(folder, "hill", min_free_mb=1)
    # One sigma 0.3 m along ECEF x, 0.1 m along the others.
    covariance = [0.09, 0, 0, 0, 0, 0, 0.01, 0, 0, 0, 0, 0.01, 0, 0, 0, 1, 0, 0, 1, 0, 1]
    for k in range(30):
        state = "tentative" if k < 5 else "confirmed" if k < 25 else "coasting"
        x_m, y_m, z_m = map(float, pymap3d.geodetic2ecef(PLACE[0], PLACE[1], PLACE[2] + k))
        target = Target(
            track=3,
            state=state,  # type: ignore[arg-type]
            ecef_m=(x_m, y_m, z_m),
            velocity_m_s=(0, 0, 1),
            covariance=covariance,
            cameras=["cam0", "cam1"],
            age_s=0.1 * k,
        )
        t_ns = T0_NS + k * STEP_NS
        recorder.write(station_key("hill", "targets"), encode(Targets(t_unix_ns=t_ns, targets=[target])), t_ns)
    recorder.close()
    assert recorder.path is not None
    return recorder.path


def test_of_a_recording_only_what_was_measured_counts(tmp_path: Path) -> None:
    flown = flown_file.load(recorded(tmp_path))
    (one,) = flown.tracks
    assert one.number == 3
    assert len(one.t_unix_ns) == 20
    assert one.geodetic[:, 2] == pytest.approx(PLACE[2] + np.arange(5, 25), abs=1e-3)
    lat, lon = np.radians(PLACE[:2])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    assert one.sigma_enu_m[:, 2] == pytest.approx(np.sqrt(up @ np.diag([0.09, 0.01, 0.01]) @ up), rel=1e-4)


def test_a_recording_without_a_position_says_so(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, "hill", min_free_mb=1)
    recorder.write(station_key("hill", "targets"), encode(Targets(t_unix_ns=T0_NS, targets=[])), T0_NS)
    recorder.close()
    assert recorder.path is not None
    with pytest.raises(SkyfixError, match="no confirmed position"):
        flown_file.load(recorder.path)


TRAJECTORY = (
    "t_unix_ns,track,x_m,y_m,z_m,east_m,north_m,up_m,sigma_east_m,sigma_north_m,sigma_up_m,cameras\n"
    f"{T0_NS},1,4276866.1,639678.1,4672894.6,0,0,0,0.1,0.1,0.2,3\n"
    f"{T0_NS + STEP_NS},1,4276866.2,639678.2,4672894.7,0,0,0,0.1,0.1,0.2,3\n"
)


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_the_command_writes_every_format(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trajectory.csv").write_text("# skyfix, a comment\n" + TRAJECTORY)
    for source in (tmp_path, tmp_path / "trajectory.csv", recorded(tmp_path / "recordings")):
        out = tmp_path / f"{source.stem}.{form}"
        assert main(["export", str(source), "--as", form, "-o", str(out)]) == 0
        assert out.stat().st_size > 100
    assert "1 tracks, 2 positions in 1 stretches" in capsys.readouterr().out


def test_what_cannot_be_exported_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "out.kml")
    assert main(["export", str(tmp_path), "--as", "kml", "-o", out]) == 1
    assert "solve it first" in capsys.readouterr().err
    (tmp_path / "trajectory.csv").write_text(TRAJECTORY.replace(str(T0_NS), "noon", 1))
    assert main(["export", str(tmp_path), "--as", "kml", "-o", out]) == 1
    assert "'noon' is not a whole number" in capsys.readouterr().err
    (tmp_path / "trajectory.csv").write_text(TRAJECTORY)
    assert main(["export", str(tmp_path), "--as", "csv", "--undulation-m", "47", "-o", out]) == 2
    assert main(["export", str(tmp_path), "--as", "kml", "-o", str(tmp_path / "no" / "out.kml")]) == 1
    assert "choose another -o" in capsys.readouterr().err

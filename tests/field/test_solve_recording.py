"""What a base recorded until it was killed is solved again, with nothing but the recording."""

import time
from pathlib import Path

import numpy as np

from calib.geodesy import ecef_to_enu
from calib.station.app import main
from calib.station.archive import recording
from edge.messages import SurveyMessage, decode
from tools.doubles.base import TrackingBase
from tools.doubles.flight import ORIGIN
from tools.doubles.heard import Heard

FLIGHT_S = 25.0
WITHIN_S = 150.0  # on a busy machine
RIGHT_M = 0.5  # three cameras, half a minute


def test_a_base_that_was_killed_left_a_recording_that_is_solved(tmp_path: Path) -> None:
    base, heard = TrackingBase(tmp_path, []), Heard(tmp_path / "disk" / "recordings")
    base.start()
    try:
        with base.boxes() as scene:
            deadline = time.monotonic() + WITHIN_S
            while not (rows := heard.look()) or rows[-1].t_unix_ns - rows[0].t_unix_ns < FLIGHT_S * 1e9:
                assert time.monotonic() < deadline
                time.sleep(0.2)
    finally:
        base.kill()
    (path,) = (tmp_path / "disk" / "recordings").glob("*.mcap")
    first = next(recording.read(path))
    survey = decode(first.payload, SurveyMessage, where=first.key)
    assert (survey.site, survey.origin, len(survey.cameras)) == ("bench", ORIGIN, 3)
    assert main(["solve", str(path), "-o", str(tmp_path / "out")]) == 0
    table = np.loadtxt(tmp_path / "out" / "trajectory.csv", delimiter=",", skiprows=2)
    stamps = np.loadtxt(tmp_path / "out" / "trajectory.csv", np.int64, delimiter=",", skiprows=2, usecols=0)
    true = np.array([scene.positions(int(t))[0] for t in stamps])
    assert np.abs((ecef_to_enu(table[:, 2:5], ORIGIN) - true).mean(axis=0)).max() < RIGHT_M

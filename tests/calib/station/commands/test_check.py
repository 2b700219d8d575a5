"""`base-station check`: a line for each thing the station depends on, and a code that says whether one fails."""

import socket
import threading
from pathlib import Path

import msgspec
import pytest

from calib.station.app import main
from calib.station.commands.check import Line, _told_by, examine
from calib.station.config import BaseConfig
from calib.station.status.asking import Running
from tests.calib.station.running import calibrated_before, configured, running, turned_until, udp_ear
from tools.doubles.ports import free_port


def lines(config: BaseConfig, folder: Path) -> dict[str, Line]:
    return {line.name: line for line in examine(config, folder)}


def test_a_configuration_that_is_well_passes(tmp_path: Path, endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    calibrated_before(tmp_path)
    with udp_ear() as ear:
        name = f"mavlink udp:127.0.0.1:{ear.port}"
        found = lines(configured(tmp_path, endpoint, mavlink={"endpoint": [ear.endpoint]}), tmp_path)
        assert main(["check", "--config", str(tmp_path / "base.toml")]) == 0
    assert found[name] == Line("PASS", name, "gcs+ecef")
    assert found["mavlink identity"].verdict == "PASS"
    assert "sends as 200/" in found["mavlink identity"].reason
    assert found["stored calibration"].reason.startswith("3 cameras")
    assert {name for name, line in found.items() if line.verdict == "FAIL"} == set()
    assert found["clock"].verdict in ("PASS", "WARN")
    assert found["clock"].reason
    assert found["survey"].verdict == "WARN"  # nothing is surveyed: the boxes must send fixes
    printed = capsys.readouterr().out
    assert '"first_solve_s": 3.0' in printed
    assert f"PASS  {name}" in printed


def test_every_receiver_is_tried_even_when_one_is_wrong(tmp_path: Path, endpoint: str) -> None:
    with udp_ear() as ear:
        name = f"mavlink udp:127.0.0.1:{ear.port}"
        wrong = {"url": "upd:127.0.0.1:1", "profile": ["ecef"]}
        key = {"url": "udp:127.0.0.1:2", "profile": ["ecef"], "signing_key": "none"}
        found = lines(configured(tmp_path, endpoint, mavlink={"endpoint": [wrong, key, ear.endpoint]}), tmp_path)
        assert main(["check", "--config", str(tmp_path / "base.toml")]) == 1
    assert found["mavlink upd:127.0.0.1:1"].verdict == "FAIL"
    assert "no MAVLink endpoint" in found["mavlink upd:127.0.0.1:1"].reason
    assert "no signing key" in found["mavlink udp:127.0.0.1:2"].reason
    assert found[name].verdict == "PASS"


def test_a_receiver_that_is_not_there_is_said_as_soon_as_the_network_says_it(tmp_path: Path, endpoint: str) -> None:
    url = f"tcp:127.0.0.1:{free_port()}"
    found = lines(configured(tmp_path, endpoint, mavlink={"endpoint": [{"url": url, "profile": ["ecef"]}]}), tmp_path)
    assert found[f"mavlink {url}"].verdict == "WARN"
    assert "Connection refused" in found[f"mavlink {url}"].reason


def test_what_is_missing_or_taken_is_named_with_what_to_do(tmp_path: Path, endpoint: str) -> None:
    host, port = endpoint.removeprefix("tcp/").split(":")
    with socket.create_server((host, int(port))), socket.create_server((host, 0)) as page:
        config = configured(tmp_path, endpoint, status={"port": page.getsockname()[1]})
        found = lines(config, tmp_path)
    for name in (f"link {endpoint}", "status page"):
        assert (found[name].verdict, found[name].reason) == ("FAIL", "Address already in use")
        assert found[name].action
    assert found["output"] == Line(
        "WARN", "output", "none: nothing is sent", "add [[mavlink.endpoint]] or [output.NAME]"
    )


def test_a_folder_that_can_t_be_written_and_a_survey_that_can_t_be_read_fail(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "file").touch()
    recording = {"folder": "recordings", "min_free_mb": 1_000_000}
    config = configured(tmp_path, endpoint, state_folder="file/state", recording=recording)
    found = lines(config, tmp_path)
    assert found["state folder"].verdict == "FAIL"
    assert found["recording"].verdict == "FAIL"
    assert found["recording"].action == "free 1000000 MB"


def test_a_station_that_runs_is_asked_and_not_fought_for_its_ports(tmp_path: Path, endpoint: str) -> None:
    """As `install.sh base` ends: with a check beside the station that it has just started."""
    with udp_ear() as ear:
        port = free_port()
        config = configured(tmp_path, endpoint, status={"port": port}, mavlink={"endpoint": [ear.endpoint]})
        with running(config, tmp_path) as station:
            asked = threading.Thread(target=lambda: found.update(lines(config, tmp_path)))
            found: dict[str, Line] = {}
            asked.start()
            assert turned_until(station, lambda: not asked.is_alive(), within_s=60.0)
        receiver = found[f"mavlink udp:127.0.0.1:{ear.port}"]
    assert found["running station"].verdict == "PASS"
    assert "collecting" in found["running station"].reason
    assert receiver.verdict == "PASS"
    assert {name for name, line in found.items() if line.verdict == "FAIL"} == set()
    assert "status page" not in found


def test_each_box_s_receiver_and_the_frame_are_told_by_the_station_that_runs() -> None:
    status = {"site": "hill", "version": "0.3.0", "phase": "calibrated", "reason": "", "endpoints": []}
    fixed = {"name": "gnss", "level": "ok", "reason": "RTK fixed, 12 satellites"}
    lost = {"name": "gnss", "level": "fail", "reason": "no byte for 9 s", "action": "check its power"}
    cameras = [{"id": "cam0", "receiver": fixed}, {"id": "cam1", "receiver": lost}, {"id": "cam2"}]
    frame = {"name": "frame", "level": "ok", "reason": "not known", "action": "name it"}
    running = msgspec.convert(status | {"cameras": cameras, "health": {"items": [frame]}}, Running)
    assert list(_told_by(running))[1:] == [
        Line("WARN", "frame", "not known", "name it"),
        Line("PASS", "receiver cam0", "RTK fixed, 12 satellites"),
        Line("FAIL", "receiver cam1", "no byte for 9 s", "check its power"),
    ]


def test_a_mix_of_versions_is_told_by_the_station_that_runs() -> None:
    status = {"site": "hill", "version": "0.3.0", "phase": "calibrated", "reason": "", "endpoints": []}
    mix = {"name": "versions", "level": "concerned", "reason": "this is 0.3.0; cam1 runs 0.2.0"}
    other = {"name": "camera cam1", "level": "ok", "reason": "sends frames"}
    running = msgspec.convert(status | {"health": {"items": [mix, other]}}, Running)
    told = {line.name: line for line in _told_by(running)}
    assert told["versions"] == Line("WARN", "versions", "this is 0.3.0; cam1 runs 0.2.0")
    assert set(told) == {"running station", "versions"}
    assert [line.name for line in _told_by(msgspec.convert(status, Running))] == ["running station"]  # an older one

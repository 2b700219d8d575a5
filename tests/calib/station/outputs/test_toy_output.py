"""A new output is a module and a table of the configuration: a toy goes through the station, its status and `check`."""

import json
from pathlib import Path

import pytest

from calib.station.commands.check import examine
from calib.station.outputs.registry import available, wanted
from calib.station.page.steps import steps
from edge.common.errors import ConfigError
from tests.calib.station.running import (
    SPEC,
    calibrated_before,
    configured,
    running,
    turned_until,
    udp_ear,
)
from tools.doubles.feed import boxes
from tools.doubles.flight import make

TOY = "tests.calib.station.outputs.json_lines"


def test_a_toy_output_gets_all_that_mavlink_gets(tmp_path: Path, endpoint: str) -> None:
    calibrated_before(tmp_path)
    with udp_ear() as ear:
        config = configured(tmp_path, endpoint, output={"lines": {"module": TOY, "port": ear.port, "rate_hz": 15.0}})
        lines = {line.name: line for line in examine(config, tmp_path)}
        assert lines["lines"].verdict == "PASS"
        said: list[dict[str, object]] = []

        def complete() -> bool:
            said.extend(json.loads(datagram) for datagram in ear.datagrams())
            return sum("track" in line for line in said) > 10 and any(line.get("online") == 3 for line in said)

        with running(config, tmp_path) as runner, boxes(make(SPEC), endpoint):
            assert runner.outputs.rate_hz == 15.0
            assert turned_until(runner, complete)
            assert turned_until(runner, lambda: runner.outputs.counters["lines_sent"] > 10)
            status = runner.status()
            assert [each.output for each in status.endpoints] == ["lines"]
            assert steps(status)[-1].level == "ok"
            assert status.counters["lines_failed_calls"] == status.counters["lines_dropped_calls"] == 0
            assert "lines" in [item.name for item in status.health.items]
        assert any("origin" in line for line in said)
    (file,) = (tmp_path / "recordings").glob("*.mcap")
    assert b"/station/output_lines" in file.read_bytes()


def test_an_output_that_there_is_not_is_refused_and_those_there_are_named(tmp_path: Path, endpoint: str) -> None:
    config = configured(tmp_path, endpoint, output={"cott": {"url": "udp:127.0.0.1:1"}})
    with pytest.raises(ConfigError, match="there is no output 'cott'") as refused, running(config, tmp_path):
        pass
    assert "mavlink" in refused.value.action
    assert "mavlink" in available()
    (line,) = [line for line in examine(config, tmp_path) if line.name.startswith("cott")]
    assert line.verdict == "FAIL"


def test_a_module_that_is_no_output_and_a_table_that_is_wrong_are_refused(tmp_path: Path, endpoint: str) -> None:
    config = configured(tmp_path, endpoint, output={"lines": {"module": "json"}})
    with pytest.raises(ConfigError, match="open_output"), running(config, tmp_path):
        pass
    config = configured(tmp_path, endpoint, output={"lines": {"module": TOY, "prot": 1}})
    with pytest.raises(ConfigError, match="unknown key prot") as refused, running(config, tmp_path):
        pass
    assert refused.value.where == "[output.lines]"


def test_mavlink_is_asked_for_in_one_place(tmp_path: Path, endpoint: str) -> None:
    with pytest.raises(ConfigError, match="section of its own"):
        wanted(configured(tmp_path, endpoint, output={"mavlink": {"system_id": 3}}))

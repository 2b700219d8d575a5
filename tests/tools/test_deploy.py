"""What is deployed is well formed: units, chrony's configuration, and the installer."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.places import ROOT
from tests.programs import options, parsers

UNITS = sorted((ROOT / "systemd").glob("*.service"))
STAYING = [unit for unit in UNITS if unit.name != "skyfix-access.service"]  # that one is done at once
MOST_EXPOSED = 2.0  # of systemd's 10


@pytest.mark.program("systemd-analyze")
def test_units_are_understood(tmp_path: Path) -> None:
    for unit in [*UNITS, *(ROOT / "systemd").glob("*.path")]:
        # The programs are not installed here; what is checked is the unit.
        text = re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", unit.read_text(), flags=re.MULTILINE)
        (tmp_path / unit.name).write_text(text)
    files = [str(file) for file in tmp_path.iterdir()]
    verdict = subprocess.run(["systemd-analyze", "verify", *files], capture_output=True, text=True, check=False)
    assert (verdict.returncode, verdict.stderr.strip()) == (0, "")


@pytest.mark.program("systemd-analyze")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_exposure(unit: Path) -> None:
    command = ["systemd-analyze", "security", "--offline=true", str(unit)]
    verdict = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    found = re.search(r"exposure level for \S+: ([\d.]+)", verdict)
    assert found, verdict
    assert float(found[1]) <= MOST_EXPOSED


@pytest.mark.parametrize("unit", STAYING, ids=lambda unit: unit.name)
def test_no_service_runs_as_root_or_gives_up(unit: Path) -> None:
    text = unit.read_text()
    assert "\nUser=skyfix\n" in text
    # A box that plays a recording to its end is done; everything else only ever ends by failing, or by being told to.
    assert f"\nRestart={'on-failure' if unit.name == 'edge-node.service' else 'always'}\n" in text
    assert "\nStartLimitIntervalSec=0\n" in text


@pytest.mark.parametrize("name", ["edge-node", "base-station", "skyfix-router"])
def test_programs_are_watched(name: str) -> None:
    text = (ROOT / "systemd" / f"{name}.service").read_text()
    assert "\nType=notify\n" in text
    assert re.search(r"^WatchdogSec=\d+$", text, re.MULTILINE)
    assert "time-sync.target" in text


@pytest.mark.program("chronyd")
@pytest.mark.parametrize("file", sorted((ROOT / "deploy" / "chrony").glob("*.conf")), ids=lambda file: file.name)
def test_chrony_understands(file: Path) -> None:
    verdict = subprocess.run(["chronyd", "-p", "-f", str(file)], capture_output=True, text=True, check=False)
    assert verdict.returncode == 0, verdict.stderr + verdict.stdout


def test_the_installer_is_bash_and_explains_itself() -> None:
    script = ROOT / "deploy" / "install.sh"
    subprocess.run(["bash", "-n", str(script)], check=True)
    verdict = subprocess.run(["bash", str(script), "everything"], capture_output=True, text=True, check=False)
    assert verdict.returncode == 2
    assert "edge|base|router" in verdict.stderr


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_starts_a_command_that_exists(unit: Path) -> None:
    found = re.search(r"^ExecStart=/opt/skyfix/current/bin/(.+)$", unit.read_text(), re.MULTILINE)
    if found is None:
        assert unit.name in ("skyfix-access.service", "skyfix-ntrip.service"), "these start programs of others"
        return
    program, command, *rest = found[1].split()
    assert (program, command) in parsers()
    assert rest[0] in options((program, command))

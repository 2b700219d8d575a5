"""Time is tried before it stays, and what is laid is what chronyd reads: each file by a real chronyd."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from tests.places import DEPLOY

CHRONY = DEPLOY / "chrony"


def lay(etc: Path, *words: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run lay.sh on a folder of our own; where systemd runs, it would restart the machine's chronyd."""
    if Path("/run/systemd/system").exists():
        pytest.skip("systemd runs here: the booted machine of the installer's tests is for this")
    variables = os.environ | {"SKYFIX_ETC": str(etc)} | environment
    command = ["bash", str(CHRONY / "lay.sh"), *words]
    return subprocess.run(command, env=variables, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.program("chronyd")
@pytest.mark.parametrize("name", ["box.conf", "base-ntp.conf", "base-pps.conf"])
def test_chronyd_understands_each_file_and_its_step_is_in_force(name: str) -> None:
    told = subprocess.run(["chronyd", "-p", "-f", str(CHRONY / name)], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    lines = told.stdout.splitlines()
    assert [line for line in lines if line.startswith("makestep")] == ["makestep 0.1 3"]
    assert "maxslewrate 1000" in lines


@pytest.mark.program("chronyd")
def test_a_box_has_no_pool_and_believes_its_base() -> None:
    lines = [line for line in (CHRONY / "box.conf").read_text().splitlines() if not line.startswith("#")]
    assert [line.split()[0] for line in lines if re.match("server|pool|peer|refclock", line)] == ["server"]
    (server,) = (line for line in lines if line.startswith("server"))
    assert {"prefer", "trust"} <= set(server.split())


@pytest.mark.program("chronyd")
def test_what_is_laid_is_what_chronyd_is_started_with(tmp_path: Path) -> None:
    done = lay(tmp_path, "box", "192.168.7.1")
    assert done.returncode == 0, done.stderr
    assert "server 192.168.7.1 iburst" in (tmp_path / "chrony/skyfix.conf").read_text()
    drop_in = (tmp_path / "systemd/system/chrony.service.d/skyfix.conf").read_text()
    assert drop_in == f"[Service]\nEnvironmentFile={tmp_path}/chrony/skyfix.env\n"
    assert "-f /etc/chrony/skyfix.conf" in (tmp_path / "chrony/skyfix.env").read_text()
    assert lay(tmp_path, "none").returncode == 0
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


@pytest.mark.program("chronyd")
def test_without_the_pulse_time_is_left_as_it_was_and_the_installation_goes_on(tmp_path: Path) -> None:
    lay(tmp_path, "base-ntp")
    before = (tmp_path / "chrony/skyfix.conf").read_text()
    done = lay(tmp_path, "base-pps", SKYFIX_PPS=str(tmp_path / "pps0"))
    assert done.returncode == 0
    assert "deploy/chrony/PPS.md" in done.stdout
    assert (tmp_path / "chrony/skyfix.conf").read_text() == before
    assert "refclock PPS" in lay_pps(tmp_path)


def lay_pps(etc: Path) -> str:
    lay(etc, "base-pps", SKYFIX_PPS="/dev/null")  # a character device, as /dev/pps0 is
    return (etc / "chrony/skyfix.conf").read_text()


@pytest.mark.program("chronyd")
def test_earlier_versions_file_goes_for_debians_own_came_after_it(tmp_path: Path) -> None:
    (tmp_path / "chrony/conf.d").mkdir(parents=True)
    (tmp_path / "chrony/conf.d/skyfix.conf").write_text("makestep 0.1 3\n")
    lay(tmp_path, "base-ntp")
    assert list((tmp_path / "chrony/conf.d").iterdir()) == []


@pytest.mark.parametrize("words", [(), ("box",), ("box", "a b"), ("pps",)])
def test_wrong_words_are_refused(tmp_path: Path, words: tuple[str, ...]) -> None:
    assert lay(tmp_path, *words).returncode == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.program("chronyd")
def test_a_base_with_certificates_proves_its_time_and_a_box_asks_for_that_only_where_it_can(tmp_path: Path) -> None:
    certs = tmp_path / "skyfix/certs"
    certs.mkdir(parents=True)
    for name in ("key.pem", "certificate.pem", "authority.pem"):
        (certs / name).write_text("x")
    assert "authenticated" in lay(tmp_path, "base-ntp").stdout
    base = (tmp_path / "chrony/skyfix.conf").read_text()
    assert f"ntsserverkey {tmp_path}/chrony/skyfix-key.pem" in base
    assert (tmp_path / "chrony/skyfix-key.pem").stat().st_mode & 0o007 == 0
    silent = lay(tmp_path, "box", "127.0.0.1")  # nobody listens for NTS there
    assert "the base does not prove its time" in silent.stderr
    assert " nts" not in (tmp_path / "chrony/skyfix.conf").read_text()

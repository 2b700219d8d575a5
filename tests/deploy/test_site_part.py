"""A machine's part of a site, made with the base and carried to each box, is what each program then reads."""

import argparse
import os
import shutil
import sys
import tomllib
from pathlib import Path

import pytest

from calib.station import config as station
from calib.station.app import main
from deploy.installer import configuration, machine, site_part, words
from deploy.installer.places import ROLES
from deploy.installer.telling import RefusedError
from edge.common import settings
from edge.config import BoxConfig
from tests.places import DEPLOY, ROOT

EDGE, BASE = ROLES["edge"], ROLES["base"]
BEGIN = "from calib.station.app import main\nsys.exit(main())\n"


@pytest.fixture(autouse=True)
def _owners(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no user skyfix here, and nobody may be root."""
    monkeypatch.setattr(shutil, "chown", lambda *_, **__: None)
    assert machine.USER == "skyfix"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "hill"
    assert main(["init", "hill", "--base", "192.168.7.1", "--certs", "-o", str(folder)]) == 0
    return folder


@pytest.fixture
def etc(tmp_path: Path) -> Path:
    folder = tmp_path / "etc"
    (folder / "certs").mkdir(parents=True)
    return folder


def laid(typed: str, etc: Path) -> argparse.Namespace:
    """As the installer does it, but for the programs."""
    wanted = words.parse(typed.split())
    role = ROLES[wanted.act]
    site_part.check(wanted, role, etc)
    part = wanted.carried
    carried = site_part.configuration_of(part, role, etc) if part else None
    if part:
        site_part.lay_part(part, role, etc)
    configuration.lay_configuration(etc, DEPLOY, role, vars(wanted), carried)
    return wanted


def test_a_box_is_given_its_own(site: Path, etc: Path) -> None:
    (site / "cam1" / "cam1.lens.toml").write_text("model = 'radtan'\n")
    laid(f"edge --from {site}/cam1", etc)
    box = settings.load(etc / "edge.toml", BoxConfig)
    assert (box.site, box.camera[0].id, box.link.connect) == ("hill", "cam1", ("tls/192.168.7.1:7447",))
    assert sorted(file.name for file in (etc / "certs").iterdir()) == sorted(site_part.PEMS)
    assert (etc / "certs/key.pem").stat().st_mode & 0o777 == 0o600
    assert (etc / "certs/certificate.pem").read_text().startswith("hill.cam1.")
    assert (etc / "cam1.lens.toml").exists()
    assert site_part.base_of(site / "cam1", EDGE) == "192.168.7.1"


def test_a_base_that_was_made_elsewhere_is_given_the_list_too_and_no_power_to_make_machines(
    site: Path, etc: Path
) -> None:
    laid(f"base --from {site}", etc)
    assert station.load(etc / "base.toml").link.listen == ("tls/0.0.0.0:7447",)
    assert sorted(file.name for file in (etc / "certs").iterdir()) == sorted([*site_part.PEMS, "access.json"])
    assert (etc / "certs/certificate.pem").read_text().startswith("hill.base.")


def test_a_part_that_lies_where_it_is_typed_is_taken(
    site: Path, etc: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(site.parent)
    laid("edge --site hill --camera cam1 --base 192.168.7.1", etc)
    assert "taking hill/cam1" in capsys.readouterr().out
    assert (etc / "certs/certificate.pem").read_text().startswith("hill.cam1.")


def test_certificates_alone_are_a_part(site: Path, etc: Path) -> None:
    laid(f"edge --from {site}/certs/issued/cam2 --site hill --camera cam2 --base 192.168.7.1", etc)
    read = tomllib.loads((etc / "edge.toml").read_text())
    assert read["link"]["tls"]["key"] == "/etc/skyfix/certs/key.pem"
    assert (etc / "certs/certificate.pem").read_text().startswith("hill.cam2.")


@pytest.mark.parametrize("order", [("base", "edge"), ("edge", "base")])
def test_two_roles_of_one_machine_are_two_to_their_site(order: tuple[str, str], site: Path, etc: Path) -> None:
    parts = {"base": site, "edge": site / "cam0"}
    for _ in range(2):  # the second time is a renewal
        for role in order:
            laid(f"{role} --from {parts[role]}", etc)
    for role, name in (("base", "base"), ("edge", "cam0")):
        key = Path(tomllib.loads((etc / f"{role}.toml").read_text())["link"]["tls"]["key"])
        certificate = etc / key.parent.relative_to("/etc/skyfix") / "certificate.pem"
        assert certificate.read_text().startswith(f"hill.{name}.")


def test_what_is_there_stays_but_for_certificates_that_were_renewed(site: Path, etc: Path) -> None:
    laid(f"edge --from {site}/cam0", etc)
    (etc / "edge.toml").write_text((etc / "edge.toml").read_text() + "# mine\n")
    old = (etc / "certs/certificate.pem").read_text()
    assert main(["certs", "--folder", str(site / "certs"), "renew", "cam0"]) == 0
    laid(f"edge --from {site}/certs/issued/cam0", etc)
    assert (etc / "edge.toml").read_text().endswith("# mine\n")
    assert (etc / "certs/certificate.pem").read_text() != old


def test_the_first_certificates_do_not_replace_later_ones(site: Path, etc: Path) -> None:
    """An upgrade is typed as the installation was, and the folder that was carried then still lies there."""
    assert main(["certs", "--folder", str(site / "certs"), "renew", "cam0", "--days", "800"]) == 0
    laid(f"edge --from {site}/certs/issued/cam0 --site hill --camera cam0 --base 192.168.7.1", etc)
    renewed = (etc / "certs/certificate.pem").read_text()
    laid(f"edge --from {site}/cam0", etc)
    assert (etc / "certs/certificate.pem").read_text() == renewed
    other = site.parent / "valley"
    assert main(["init", "valley", "--base", "10.0.0.1", "--certs", "-o", str(other)]) == 0
    laid(f"edge --from {other}/cam0", etc)
    assert (etc / "certs/certificate.pem").read_text().startswith("valley.cam0.")


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("edge --from nowhere", "has no edge.toml and no certificates"),
        ("edge --from {site}", "has no edge.toml and no certificates"),
        ("edge --from {site}/cam0 --camera cam1", "is of camera cam0, not cam1"),
        ("edge --from {site}/cam0 --site valley", "is of site hill, not valley"),
        ("edge --from {site}/cam0 --base 10.0.0.1", "is of base 192.168.7.1, not 10.0.0.1"),
        ("base --from {site}/cam0", "is a camera's"),
        ("edge --from {site}/certs/issued/base", "is a station's"),
        ("edge --from {site}/certs/issued/cam1 --camera cam2", "is of camera cam1, not cam2"),
        ("base --from {site} --site valley", "is of site hill, not valley"),
        ("router --from {site}", "has no router.toml and no certificates"),
        ("base --site {site} --base 192.168.7.1", "cannot be one"),
    ],
)
def test_another_s_part_is_refused_before_anything_is_laid(typed: str, said: str, site: Path, etc: Path) -> None:
    with pytest.raises(RefusedError, match=said):
        laid(typed.format(site=site), etc)
    assert [*etc.iterdir()] == [etc / "certs"]


def test_a_site_is_not_made_twice(site: Path, etc: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(site.parent)
    with pytest.raises(RefusedError, match="is there already; give --from hill"):
        laid("base --site hill --cameras 3 --base 192.168.7.1", etc)


@pytest.mark.parametrize("address", ["127.0.0.1", "base.local", "203.0.113.77", "2001:db8::77"])
def test_a_new_site_is_made_by_the_version_that_was_laid(
    address: str, tmp_path: Path, etc: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "version/bin").mkdir(parents=True)
    program = tmp_path / "version/bin/base-station"
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(ROOT)!r})\n{BEGIN}")
    program.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SUDO_UID", str(os.getuid()))
    monkeypatch.setenv("SUDO_GID", str(os.getgid()))
    wanted = words.parse(["base", "--site", "valley", "--cameras", "4", "--base", address])
    part = site_part.part_of(wanted, BASE, etc, tmp_path / "version")
    assert part == Path("valley")
    assert sorted(folder.name for folder in part.glob("cam*")) == ["cam0", "cam1", "cam2", "cam3"]
    told = capfd.readouterr()
    assert "(valley/cam0 valley/cam1 valley/cam2 valley/cam3)" in told.out
    elsewhere = address in ("203.0.113.77", "2001:db8::77")
    assert ("is no address of this machine now" in told.err) == elsewhere


def test_a_base_that_boxes_dial_needs_a_name_of_its_site(etc: Path) -> None:
    with pytest.raises(RefusedError, match="give --site NAME as well"):
        site_part.part_of(words.parse(["base", "--base", "10.0.0.1"]), BASE, etc, Path("/nowhere"))


def test_an_upgrade_by_the_same_line_makes_nothing(site: Path, etc: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    laid(f"base --from {site}", etc)
    monkeypatch.chdir(site.parent)
    wanted = laid("base --site hill --cameras 3 --base 192.168.7.1", etc)
    assert site_part.part_of(wanted, BASE, etc, Path("/nowhere")) is None


def test_a_configuration_that_does_not_do_what_is_asked_is_told(etc: Path, capsys: pytest.CaptureFixture[str]) -> None:
    laid("base --site hill", etc)
    laid("base --site hill --base 192.168.7.1", etc)
    assert "stays as it is: tcp/127.0.0.1:7447" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "time"), [("base --base 10.0.0.1", "ntp"), ("base", "none"), ("base --time pps", "pps")]
)
def test_a_base_that_boxes_dial_serves_their_time(typed: str, time: str) -> None:
    assert words.parse(typed.split()).time == time

"""The authority on its command line: four acts, keys that only their owner reads, errors that say what to do."""

import json
import ssl
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from edge.link.heading import read_heading


def certs(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "calib.station.app", "certs", "--folder", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def listed(folder: Path) -> dict[str, dict[str, object]]:
    subjects = json.loads((folder / "access.json").read_text())["subjects"]
    return {subject["common_name"].rpartition(".")[0]: subject for subject in subjects}


def common_names(folder: Path, name: str) -> list[str]:
    subjects = json.loads((folder / "access.json").read_text())["subjects"]
    return [subject["common_name"] for subject in subjects if subject["common_name"].split(".")[1] == name]


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("authority")
    assert certs(folder, "init", "hill").returncode == 0
    assert certs(folder, "issue", "cam0").returncode == 0
    assert certs(folder, "issue", "mast", "--camera", "cam1", "--camera", "cam2").returncode == 0
    return folder


def test_keys_are_for_their_owner_only(authority: Path) -> None:
    keys = [authority / "authority.key", *authority.glob("issued/*/key.pem")]
    assert len(keys) == 3
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}


def test_a_certificate_fits_its_key_and_its_authority(authority: Path) -> None:
    own = authority / "issued" / "cam0"
    context = ssl.create_default_context(cafile=str(own / "authority.pem"))
    context.load_cert_chain(own / "certificate.pem", own / "key.pem")  # raises if they do not fit
    assert listed(authority)["hill.mast"]["cameras"] == ["cam1", "cam2"]


def test_renewing_keeps_the_rights_and_changes_the_key(authority: Path) -> None:
    own = authority / "issued" / "mast"
    before, rights = (own / "key.pem").read_bytes(), listed(authority)["hill.mast"]
    assert certs(authority, "renew", "mast", "--days", "30").returncode == 0
    assert (own / "key.pem").read_bytes() != before
    after = listed(authority)["hill.mast"]
    assert after.pop("not_after") != rights.pop("not_after")
    assert after.pop("common_name") != rights.pop("common_name")
    assert after == rights


def test_renewing_leaves_the_one_before_on_the_list_until_it_ends(authority: Path) -> None:
    certs(authority, "issue", "cam7", "--days", "10")
    certs(authority, "issue", "ended", "--days=-1")
    first = common_names(authority, "cam7")
    certs(authority, "renew", "cam7")
    both = common_names(authority, "cam7")
    assert len(both) == 2
    assert both[0] == first[0]
    assert common_names(authority, "ended") == []
    certs(authority, "revoke", "cam7")
    assert common_names(authority, "cam7") == []


def test_a_name_that_is_issued_again_is_another_certificates(authority: Path) -> None:
    certs(authority, "issue", "cam8")
    stolen = common_names(authority, "cam8")
    certs(authority, "issue", "cam8")  # without a word of revoking
    assert len(common_names(authority, "cam8")) == 1
    assert common_names(authority, "cam8") != stolen


def test_a_list_of_before_is_read_renewed_and_revoked(authority: Path) -> None:
    """Its common names had no fingerprint."""
    certs(authority, "issue", "cam5")
    text = (authority / "access.json").read_text()
    (authority / "access.json").write_text(text.replace(common_names(authority, "cam5")[0], "hill.cam5"))
    assert certs(authority, "renew", "cam5").returncode == 0
    assert common_names(authority, "cam5")[0] == "hill.cam5"
    assert len(common_names(authority, "cam5")) == 2
    assert certs(authority, "revoke", "cam5").returncode == 0
    assert common_names(authority, "cam5") == []


def test_site_role_and_cameras_stand_above_the_certificate_and_nothing_outlives_the_authority(authority: Path) -> None:
    certs(authority, "issue", "east", "--camera", "cam1", "--camera", "cam2", "--site", "lake", "--days", "9999")
    heading = read_heading(authority / "issued" / "east" / "certificate.pem")
    of_all = read_heading(authority / "authority.pem")
    assert heading is not None
    assert of_all is not None
    assert (heading.site, heading.role, heading.cameras) == ("lake", "camera", ("cam1", "cam2"))
    assert heading.ends == of_all.ends


def test_revoking_takes_a_name_off_the_list(authority: Path) -> None:
    certs(authority, "issue", "stolen")
    assert "hill.stolen" in listed(authority)
    assert certs(authority, "revoke", "stolen").returncode == 0
    assert "hill.stolen" not in listed(authority)
    assert "hill.cam0" in listed(authority)


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (("init", "hill"), 2, "there is an authority already"),
        (("issue", "../cam0"), 2, "is no name"),
        (("issue", "c" * 64), 2, "too long for a certificate"),
        (("renew", "nobody"), 2, "known are: "),
        (("issue", "cam9", "--role", "god"), 2, "invalid choice"),
    ],
)
def test_errors_say_what_to_do(authority: Path, arguments: tuple[str, ...], code: int, told: str) -> None:
    verdict = certs(authority, *arguments)
    assert verdict.returncode == code
    assert told in verdict.stderr
    assert "Traceback" not in verdict.stderr


def test_without_an_authority_nothing_is_issued(tmp_path: Path) -> None:
    verdict = certs(tmp_path, "issue", "cam0")
    assert verdict.returncode == 2
    assert "base-station certs" in verdict.stderr

"""The authority on its command line: four acts, keys that only their owner reads, errors that say what to do."""

import json
import ssl
import stat
import subprocess
import sys
from pathlib import Path

import pytest


def certs(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "calib.station.app", "certs", "--folder", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def listed(folder: Path) -> dict[str, dict[str, object]]:
    subjects = json.loads((folder / "access.json").read_text())["subjects"]
    return {subject["common_name"]: subject for subject in subjects}


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
    assert after == rights


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

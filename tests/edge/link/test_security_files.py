"""A machine's own files: a certificate that ends, that is somebody else's, or whose key others read, is named."""

import datetime as dt
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.link.heading import Heading, read_heading
from edge.link.security import Bearer, check_security
from edge.link.settings import LinkSettings, TlsSettings

NOW = dt.datetime(2027, 6, 1, tzinfo=dt.UTC)
LATER = NOW + dt.timedelta(days=300)


@pytest.mark.parametrize(
    ("expires", "level"),
    [
        ("expires 2028-01-01T00:00:00+00:00", "ok"),
        ("expires 2027-06-20T00:00:00+00:00", "warn"),
        ("expires 2027-05-31T23:59:59+00:00", "fail"),
        ("expires tomorrow", "warn"),
        ("", "warn"),
    ],
)
def test_a_certificate_is_spoken_of_a_month_before_it_ends(tmp_path: Path, expires: str, level: str) -> None:
    (tmp_path / "certificate.pem").write_text(f"hill.cam0\n{expires}\n-----BEGIN CERTIFICATE-----\n")
    assert check_security(settings_with(tmp_path), NOW).level == level


def settings_with(folder: Path, *, access: bool = False) -> LinkSettings:
    for name in ("authority.pem", "key.pem"):
        (folder / name).touch(mode=0o600)
    files = {name: str(folder / f"{name}.pem") for name in ("authority", "certificate", "key")}
    tls = TlsSettings(**files, access=str(folder / "access.json") if access else "")
    return LinkSettings(connect=("tls/127.0.0.1:1",), tls=tls)


def test_a_key_that_others_read_and_a_file_that_is_not_there(tmp_path: Path) -> None:
    settings = settings_with(tmp_path)
    assert "certificate.pem cannot be read" in check_security(settings, NOW).reason
    (tmp_path / "certificate.pem").write_text("expires 2030-01-01T00:00:00+00:00\n")
    assert check_security(settings, NOW).level == "ok"
    (tmp_path / "key.pem").chmod(0o640)
    assert check_security(settings, NOW).action.startswith("chmod 600")


def test_the_authoritys_end_and_that_of_others_on_the_list_are_told_too(tmp_path: Path) -> None:
    settings = settings_with(tmp_path, access=True)
    (tmp_path / "certificate.pem").write_bytes(Heading("hill.base.1", LATER).encoded())
    soon, gone = NOW + dt.timedelta(days=9), NOW - dt.timedelta(days=1)
    subjects = [
        {"common_name": f"hill.{name}", "role": "camera", "cameras": ["cam0"], "not_after": end.isoformat()}
        for name, end in (("cam0.1", gone), ("cam0.2", LATER), ("cam1.1", soon), ("old", LATER))
    ]
    (tmp_path / "access.json").write_text(json.dumps({"site": "hill", "subjects": subjects}))
    told = check_security(settings, NOW)
    assert (told.level, told.action) == ("warn", "base-station certs renew cam1")
    assert "cam1 ends on 2027-06-10" in told.reason
    (tmp_path / "authority.pem").write_bytes(Heading("hill authority", NOW + dt.timedelta(days=20)).encoded())
    assert "the authority ends on 2027-06-21" in check_security(settings, NOW).reason


CAM0 = Heading("hill.cam0.1", LATER, "hill", "camera", ("cam0",))
MAST = Heading("hill.mast.1", LATER, "hill", "camera", ("cam1", "cam2"))


@pytest.mark.parametrize(
    ("heading", "bearer", "told"),
    [
        (CAM0, Bearer("hill", "camera", ("cam0",)), ""),
        (MAST, Bearer("hill", "camera", ("cam2", "cam1")), ""),
        (MAST, Bearer("hill", "camera", ("cam2",)), ""),
        (CAM0, Bearer("lake", "camera", ("cam0",)), "for site hill, this is configured for site lake"),
        (CAM0, Bearer("hill", "camera", ("cam1",)), "for cam0, not for cam1"),
        (MAST, Bearer("hill", "camera", ("cam1", "cam3")), "for cam1, cam2, not for cam3"),
        (CAM0, Bearer("hill", "station"), "for a camera, this is a station"),
        (Heading("org.hq.1", LATER, "*", "reader"), Bearer("hq", "router"), ""),
        (Heading("org.router.1", LATER, "hill", "router"), Bearer("lake", "router"), "for site hill"),
        (Heading("hill.cam0", LATER), Bearer("lake", "camera", ("cam7",)), ""),  # made before there was a site in it
    ],
)
def test_a_certificate_of_another_machine_is_named(tmp_path: Path, heading: Heading, bearer: Bearer, told: str) -> None:
    settings = settings_with(tmp_path)
    (tmp_path / "certificate.pem").write_bytes(heading.encoded() + b"-----BEGIN CERTIFICATE-----\nsite lake\n")
    check = check_security(settings, NOW, bearer)
    assert told in check.reason
    assert (check.level == "fail") == bool(told)


@given(st.binary(max_size=300))
def test_whatever_stands_above_a_certificate_is_read_or_is_none(text: bytes) -> None:
    Heading.decoded(text)


NAMES = st.from_regex(r"[A-Za-z0-9_-]{1,64}", fullmatch=True)


@given(st.builds(Heading, NAMES, st.just(LATER), NAMES, st.just("camera"), st.lists(NAMES, min_size=1).map(tuple)))
def test_a_heading_is_read_as_it_was_written(heading: Heading) -> None:
    assert Heading.decoded(heading.encoded() + b"-----BEGIN CERTIFICATE-----\n") == heading


def test_a_certificate_that_is_not_there_has_no_heading(tmp_path: Path) -> None:
    assert read_heading(tmp_path / "none.pem") is None

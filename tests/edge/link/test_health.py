"""The link's health names what is wrong with it, and stops speaking of what is over."""

import datetime as dt
from pathlib import Path

import pytest

from edge.link import zenoh_log
from edge.link.health import LinkHealth, certificate_end, check_security
from edge.link.link import Link
from edge.link.settings import LinkSettings, TlsSettings
from edge.link.zenoh_log import Refusals

NOW = dt.datetime(2027, 6, 1, tzinfo=dt.UTC)


def levels(health: LinkHealth, now_s: float) -> dict[str, str]:
    return {check.name: check.level for check in health.checks(who="the base", now_s=now_s)}


def test_the_development_profile_is_a_warning() -> None:
    health = LinkHealth(Link(LinkSettings(connect=("tcp/127.0.0.1:1",))))
    assert levels(health, 0.0) == {"link": "ok", "security": "warn", "refused": "ok", "network": "ok"}


def test_a_refusal_is_spoken_of_for_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    health = LinkHealth(Link(LinkSettings()))
    told = Refusals(handshakes=2, messages=1, last_reason="peer sent no certificates")
    monkeypatch.setattr(zenoh_log, "refusals", lambda: told)
    (check,) = (check for check in health.checks(who="the base", now_s=100.0) if check.name == "refused")
    assert "2 connections and 1 messages" in check.reason
    assert "peer sent no certificates" in check.reason
    assert levels(health, 159.0)["refused"] == "warn"
    assert levels(health, 160.0)["refused"] == "ok"
    assert health.counters()["link_refused_handshakes"] == 2


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
    file = tmp_path / "certificate.pem"
    file.write_text(f"hill.cam0\n{expires}\n-----BEGIN CERTIFICATE-----\n")
    assert check_security(settings_with(tmp_path), NOW).level == level


def settings_with(folder: Path) -> LinkSettings:
    for name in ("authority.pem", "key.pem"):
        (folder / name).touch(mode=0o600)
    files = {name: str(folder / f"{name}.pem") for name in ("authority", "certificate", "key")}
    return LinkSettings(connect=("tls/127.0.0.1:1",), tls=TlsSettings(**files))


def test_a_key_that_others_read_and_a_file_that_is_not_there(tmp_path: Path) -> None:
    settings = settings_with(tmp_path)
    assert "certificate.pem cannot be read" in check_security(settings, NOW).reason
    (tmp_path / "certificate.pem").write_text("expires 2030-01-01T00:00:00+00:00\n")
    assert check_security(settings, NOW).level == "ok"
    (tmp_path / "key.pem").chmod(0o640)
    assert check_security(settings, NOW).action.startswith("chmod 600")


def test_a_certificate_that_is_not_there_has_no_end(tmp_path: Path) -> None:
    assert certificate_end(tmp_path / "none.pem") is None

"""The access rules allow each role its own keys and not one more."""

from pathlib import Path
from typing import Any

import pytest
import zenoh

from edge.common.errors import ConfigError
from edge.link.access import Access, Subject, access_control, load_access
from edge.link.settings import LinkSettings, TlsSettings, is_loopback
from edge.messages import camera_key, station_key

SUBJECTS = (
    Subject(common_name="hill.cam0", role="camera", cameras=("cam0",), not_after="2030-01-01T00:00+00:00"),
    Subject(common_name="hill.mast", role="camera", cameras=("cam1", "cam2"), not_after="2030-01-01T00:00+00:00"),
    Subject(common_name="hill.base", role="station", not_after="2030-01-01T00:00+00:00"),
    Subject(common_name="hill.map", role="reader", not_after="2030-01-01T00:00+00:00"),
)
RULES = access_control(Access(site="hill", subjects=SUBJECTS))

CAM0 = [camera_key("hill", "cam0"), camera_key("hill", "cam0", "tracks"), camera_key("hill", "cam0", "backlog")]
CAM1 = [camera_key("hill", "cam1"), camera_key("hill", "cam1", "tracks")]
STATION = [station_key("hill"), station_key("hill", "targets")]
WILD = ["**", "skyfix/1/**", "skyfix/1/hill/cam/*/tracks", "skyfix/1/other/cam/cam0/tracks", "skyfix/2/hill/cam/cam0/x"]


def allowed(who: str, flow: str, message: str, key: str) -> bool:
    (policy,) = (policy for policy in RULES["policies"] if policy["subjects"] == [who])
    rules: list[dict[str, Any]] = [rule for rule in RULES["rules"] if rule["id"] in policy["rules"]]
    return any(
        flow in rule["flows"]
        and message in rule["messages"]
        and any(zenoh.KeyExpr(allowed).includes(zenoh.KeyExpr(key)) for allowed in rule["key_exprs"])
        for rule in rules
    )


@pytest.mark.parametrize(
    ("who", "may", "may_not"),
    [
        ("hill.cam0", CAM0, CAM1 + STATION + WILD),
        ("hill.mast", CAM1, CAM0 + STATION + WILD),
        ("hill.base", STATION, CAM0 + CAM1 + WILD),
        ("hill.map", [], CAM0 + CAM1 + STATION + WILD),
    ],
)
def test_who_may_write_what(who: str, may: list[str], may_not: list[str]) -> None:
    for message in ("put", "delete", "liveliness_token", "declare_queryable", "reply"):
        assert [key for key in may if not allowed(who, "ingress", message, key)] == []
        assert [key for key in may_not if allowed(who, "ingress", message, key)] == []


def test_a_camera_hears_the_station_and_no_other_camera() -> None:
    assert allowed("hill.cam0", "egress", "put", station_key("hill", "network"))
    assert allowed("hill.cam0", "ingress", "declare_subscriber", station_key("hill", "network"))
    assert not allowed("hill.cam0", "egress", "put", camera_key("hill", "cam1", "tracks"))
    assert not allowed("hill.cam0", "ingress", "declare_subscriber", camera_key("hill", "*", "tracks"))


def test_everything_else_is_denied() -> None:
    assert RULES["enabled"] is True
    assert RULES["default_permission"] == "deny"
    assert len({rule["id"] for rule in RULES["rules"]}) == len(RULES["rules"])


def test_a_bad_list_is_named(tmp_path: Path) -> None:
    (tmp_path / "access.json").write_text('{"site": "hill", "subjects": [{"role": "god"}]}')
    with pytest.raises(ConfigError, match=r"access\.json.*base-station certs"):
        load_access(tmp_path / "access.json")


FILES = TlsSettings(authority="a", certificate="c", key="k")
WITH_LIST = TlsSettings(authority="a", certificate="c", key="k", access="l")


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"listen": ("tcp/0.0.0.0:7447",)}, "add an aircraft"),
        ({"listen": ("tcp/[::]:7447",)}, "add an aircraft"),
        ({"connect": ("tls/10.0.0.1:7447",)}, r"needs \[link.tls\]"),
        ({"connect": ("tcp/10.0.0.1:7447",), "tls": FILES}, "let anybody in"),
        ({"listen": ("tls/0.0.0.0:7447",), "tls": FILES}, "access.json"),
    ],
)
def test_an_open_door_is_refused(settings: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        LinkSettings(**settings)


def test_the_development_profile_says_so_and_production_does_not() -> None:
    assert "this machine only" in LinkSettings(listen=("tcp/127.0.0.1:7447",)).warning
    assert "0.0.0.0" in LinkSettings(listen=("tcp/0.0.0.0:7447",), insecure=True).warning
    assert LinkSettings(listen=("tls/0.0.0.0:7447",), tls=WITH_LIST).warning == ""


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:1", "tcp/localhost:1", "tls/[::1]:1", "tcp/127.9.9.9:1"])
def test_loopback(endpoint: str) -> None:
    assert is_loopback(endpoint)


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:1", "tcp/10.127.0.1:1", "tls/[::]:1", "tcp/localhost.evil.org:1"])
def test_not_loopback(endpoint: str) -> None:
    assert not is_loopback(endpoint)

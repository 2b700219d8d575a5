"""The link's health names what is wrong with it, and stops speaking of what is over."""

import pytest

from edge.link import zenoh_log
from edge.link.health import LinkHealth
from edge.link.link import Link
from edge.link.security import Bearer
from edge.link.settings import LinkSettings
from edge.link.zenoh_log import Refusals

BASE = Bearer("hill", "station")


def levels(health: LinkHealth, now_s: float) -> dict[str, str]:
    return {check.name: check.level for check in health.checks(who="the base", now_s=now_s)}


def test_the_development_profile_is_a_warning() -> None:
    health = LinkHealth(Link(LinkSettings(listen=("tcp/127.0.0.1:1",))), BASE)
    assert levels(health, 0.0) == {"link": "ok", "security": "warn", "refused": "ok", "network": "ok"}


def test_a_refusal_is_spoken_of_for_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    health = LinkHealth(Link(LinkSettings()), BASE)
    told = Refusals(handshakes=2, messages=1, last_reason="peer sent no certificates")
    monkeypatch.setattr(zenoh_log, "refusals", lambda: told)
    (check,) = (check for check in health.checks(who="the base", now_s=100.0) if check.name == "refused")
    assert "2 connections and 1 messages" in check.reason
    assert "peer sent no certificates" in check.reason
    assert levels(health, 159.0)["refused"] == "warn"
    assert levels(health, 160.0)["refused"] == "ok"
    assert health.counters()["link_refused_handshakes"] == 2

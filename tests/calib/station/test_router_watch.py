"""What a router says of itself reaches the base's own list, and so does its silence."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.router_watch import ROUTER_SILENT_S, RouterWatch
from edge.common.health import Check
from edge.health import HealthBoard
from edge.link.inbox import Inbox, Received
from edge.messages import encode, site_key

NOW_UNIX_NS = 1_700_000_000_000_000_000
KEY = site_key("hill", "router/health")


def heard(*checks: Check) -> tuple[Inbox[Received], RouterWatch]:
    """A watch that was told this a moment ago, at 0."""
    inbox: Inbox[Received] = Inbox(8)
    health = HealthBoard(1).update(NOW_UNIX_NS, list(checks), {}, now_ns=0)
    inbox.put(Received(KEY, encode(health), 0))
    return inbox, RouterWatch(inbox)


def test_where_no_router_was_ever_heard_there_is_nothing_to_say() -> None:
    assert RouterWatch(Inbox(8)).checks(0) == []


def test_a_well_one_is_well_and_its_version_is_told() -> None:
    _, watch = heard(Check("link", "ok", "open"))
    (check,) = watch.checks(1)
    assert (check.name, check.level) == ("router", "ok")
    assert "version 0." in check.reason


@pytest.mark.parametrize("level", ["warn", "fail"])
def test_its_worst_fault_is_told_as_a_warning_with_what_to_do(level: str) -> None:
    worse = Check("security", level, "the certificate ends in 3 days", "renew it")  # type: ignore[arg-type]
    _, watch = heard(Check("link", "warn", "one is gone"), worse, Check("network", "ok", "well"))
    (check,) = watch.checks(1)
    assert check.level == "warn"
    if level == "fail":
        assert (check.reason, check.action) == ("the router's security: the certificate ends in 3 days", "renew it")


def test_its_silence_is_told_and_so_is_that_it_is_back() -> None:
    inbox, watch = heard(Check("link", "ok", "open"))
    late_ns = int((ROUTER_SILENT_S + 1.0) * 1e9)
    assert watch.checks(late_ns)[0].reason == "the router has not been heard for 11 s"
    inbox.put(Received(KEY, encode(HealthBoard(2).update(NOW_UNIX_NS, [], {}, now_ns=0)), late_ns))
    assert watch.checks(late_ns + 1)[0].level == "ok"


@given(st.binary(max_size=200))
def test_whatever_it_says(payload: bytes) -> None:
    inbox: Inbox[Received] = Inbox(8)
    inbox.put(Received(KEY, payload, 0))
    assert RouterWatch(inbox).checks(1)[0].level == "warn"

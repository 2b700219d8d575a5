"""A box names, within seconds, why its base does not hear it: real sessions and real certificates on loopback."""

import datetime as dt
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest

from edge.common.health import Check
from edge.link.counterpart import Counterpart
from edge.link.handshake import shake_hands
from edge.link.health import LinkHealth
from edge.link.link import Link
from edge.link.security import Bearer
from edge.link.settings import LinkSettings, TlsSettings
from edge.messages import station_key

WITHIN_S = 12.0  # seconds: the grace after a start, one handshake, and a busy machine
BOX = Bearer("hill", "camera", ("cam0",))


def certs(folder: Path, *arguments: str) -> None:
    command = [sys.executable, "-m", "calib.station.app", "certs", "--folder", folder, *arguments]
    subprocess.run(command, check=True, capture_output=True)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Certificates of every kind that a box may wrongly carry, and those of two listeners."""
    folder = tmp_path_factory.mktemp("site")
    ours, others = folder / "ours", folder / "others"
    for authority, name in ((ours, "org"), (others, "org"), (folder / "strangers", "stranger")):
        certs(authority, "init", name)
        certs(authority, "issue", "cam0", "--site", "hill")
    certs(ours, "issue", "base", "--role", "station", "--site", "hill", "--address", "127.0.0.1")
    certs(ours, "issue", "router", "--role", "router", "--site", "hill", "--address", "127.0.0.1")
    certs(ours, "issue", "elsewhere", "--role", "station", "--site", "hill", "--address", "10.9.9.9")
    certs(ours, "issue", "lake-base", "--role", "station", "--site", "lake", "--address", "127.0.0.1")
    certs(ours, "issue", "ending", "--role", "station", "--site", "hill", "--address", "127.0.0.1", "--days=9")
    certs(ours, "issue", "lake-cam0", "--camera", "cam0", "--site", "lake")
    certs(ours, "issue", "old", "--camera", "cam0", "--site", "hill", "--days=-1")
    certs(ours, "issue", "gone", "--camera", "cam0", "--site", "hill")
    certs(ours, "revoke", "gone")
    return folder


def tls(site: Path, name: str, authority: str = "ours", key: str = "") -> TlsSettings:
    own, of_key = site / authority / "issued" / name, site / authority / "issued" / (key or name)
    return TlsSettings(
        authority=str(own / "authority.pem"), certificate=str(own / "certificate.pem"), key=str(of_key / "key.pem")
    )


def listening(site: Path, name: str, secure: str, stack: ExitStack, *, mode: str = "peer") -> Link:
    own = site / "ours" / "issued" / name
    files = {each: str(own / f"{each}.pem") for each in ("authority", "certificate", "key")}
    settings = TlsSettings(**files, access=str(site / "ours" / "access.json"))
    link = stack.enter_context(Link(LinkSettings(mode=mode, listen=(secure,), tls=settings), name="base"))  # type: ignore[arg-type]
    assert link.wait_open(10)
    return link


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as resources:
        yield resources


def told(box: LinkHealth, within_s: float = WITHIN_S, level: str = "fail") -> Check:
    """The link's finding, as soon as it is of this level."""
    ends_s = time.monotonic() + within_s
    while True:
        check = box.checks(who="the base station")[0]
        if check.level == level or time.monotonic() > ends_s:
            return check
        time.sleep(0.1)


def box_of(files: TlsSettings, secure: str, stack: ExitStack, bearer: Bearer = BOX, mode: str = "peer") -> LinkHealth:
    link = stack.enter_context(Link(LinkSettings(mode=mode, connect=(secure,), tls=files), name="cam0"))  # type: ignore[arg-type]
    return stack.enter_context(LinkHealth(link, bearer, station_key(bearer.site)))


@pytest.mark.parametrize(
    ("certificate", "cause"),
    [
        ("ours/lake-cam0", "for site lake, this is configured for site hill"),
        ("ours/gone", "its list does not have this certificate"),
        ("ours/old", "this machine's certificate has ended"),
        ("others/cam0", "another authority of the same name made it"),
        ("strangers/cam0", "another authority made it"),
    ],
)
def test_a_wrong_certificate_is_named_on_the_box(
    site: Path, endpoint: str, stack: ExitStack, certificate: str, cause: str
) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, "base", secure, stack, mode="router").declare_presence(station_key("hill"))
    authority, _, name = certificate.partition("/")
    files = msgspec.structs.replace(tls(site, name, authority), authority=str(site / "ours" / "authority.pem"))
    boxes = {mode: box_of(files, secure, stack, mode=mode) for mode in ("peer", "client")}
    for mode, box in boxes.items():
        check = told(box)
        assert check.level == "fail"
        assert cause in check.reason, (mode, check)
        assert check.action


def test_a_box_that_is_heard_says_so_and_no_refusal_is_counted_for_the_handshake(
    site: Path, endpoint: str, stack: ExitStack, until: Callable[..., bool]
) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    base = listening(site, "ending", secure, stack)
    base.declare_presence(station_key("hill"))
    box = box_of(tls(site, "cam0"), secure, stack)
    check = told(box, level="ok")
    assert (check.level, check.reason) == ("ok", "the base station answers")
    assert until(lambda: any(check.name == "listener" for check in box.checks(who="the base station")))
    (ending,) = (check for check in box.checks(who="the base station") if check.name == "listener")
    assert ending.level == "warn"
    assert "the listener at tls/127.0.0.1" in ending.reason
    base.close()
    lost = told(box)
    assert lost.level == "fail"
    assert "nobody answers at 127.0.0.1" in lost.reason


def test_an_authority_that_the_listener_is_not_of(site: Path, endpoint: str, stack: ExitStack) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, "base", secure, stack)
    check = told(box_of(tls(site, "cam0", "strangers"), secure, stack))
    assert "has a certificate that this machine's authority did not make" in check.reason


@pytest.mark.parametrize(
    ("listener", "cause"),
    [("lake-base", "is of site lake, this is configured for site hill"), ("elsewhere", "for another address")],
)
def test_a_wrong_listener_is_named(site: Path, endpoint: str, stack: ExitStack, listener: str, cause: str) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, listener, secure, stack).declare_presence(station_key("lake"))
    assert cause in told(box_of(tls(site, "cam0"), secure, stack)).reason


def test_a_router_without_its_base(site: Path, endpoint: str, stack: ExitStack) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, "router", secure, stack, mode="router")
    check = told(box_of(tls(site, "cam0"), secure, stack, mode="client"))
    assert (check.level, "of site hill is not heard" in check.reason) == ("fail", True)
    # The station itself asks for no more than the router.
    link = stack.enter_context(Link(LinkSettings(mode="client", connect=(secure,), tls=tls(site, "base")), name="base"))
    station = stack.enter_context(LinkHealth(link, Bearer("hill", "station")))
    assert told(station, level="ok").level == "ok"


def test_a_key_of_another_certificate(site: Path, endpoint: str, stack: ExitStack) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, "base", secure, stack)
    check = told(box_of(tls(site, "cam0", key="gone"), secure, stack))
    assert "this machine's certificate cannot be used" in check.reason


def test_a_listener_without_tls(site: Path, endpoint: str, stack: ExitStack) -> None:
    assert stack.enter_context(Link(LinkSettings(listen=(endpoint,)), name="base")).wait_open(10)
    check = told(box_of(tls(site, "cam0"), endpoint.replace("tcp/", "tls/"), stack))
    assert check.level == "fail"
    assert check.reason.startswith(("the listener at", "nobody answers at"))


def test_without_tls_a_missing_base_is_named_too(endpoint: str, stack: ExitStack) -> None:
    link = stack.enter_context(Link(LinkSettings(connect=(endpoint,)), name="cam0"))
    box = stack.enter_context(LinkHealth(link, BOX, station_key("hill")))
    assert told(box, 1.0, level="warn").reason == "the base station is being dialled"
    assert f"nobody answers at {endpoint}" in told(box).reason
    base = stack.enter_context(Link(LinkSettings(listen=(endpoint,)), name="base"))
    base.declare_presence(station_key("lake"))
    assert "the base station of site hill is not heard" in _until_other(box, "nobody answers").reason
    base.declare_presence(station_key("hill"))
    assert told(box, level="ok").level == "ok"


def _until_other(box: LinkHealth, reason: str) -> Check:
    ends_s = time.monotonic() + WITHIN_S
    while reason in (check := box.checks(who="the base station")[0]).reason and time.monotonic() < ends_s:
        time.sleep(0.1)
    return check


def test_it_stops_at_once_with_nobody_at_the_other_end(site: Path) -> None:
    # RFC 5737: an address at which nobody is, so that dialling runs into its time.
    settings = LinkSettings(connect=("tls/192.0.2.1:7447",), tls=tls(site, "cam0"))
    with Counterpart(Link(settings, name="cam0"), BOX, station_key("hill")) as box:
        time.sleep(0.2)
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 2.0
    assert box.ended


def test_a_handshake_tells_until_when_the_listener_is_good(site: Path, endpoint: str, stack: ExitStack) -> None:
    secure = endpoint.replace("tcp/", "tls/")
    listening(site, "ending", secure, stack)
    met = shake_hands(secure, tls(site, "cam0"), threading.Event()).reached
    assert met is not None
    assert (met.site, met.role) == ("hill", "station")
    assert met.common_name.startswith("org.ending.")
    assert abs(met.ends - dt.datetime.now(dt.UTC) - dt.timedelta(days=9)) < dt.timedelta(minutes=10)

"""The production profile over real TLS: who is not on the list, or speaks for another, is heard by nobody."""

import datetime as dt
import json
import shutil
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from edge.link.link import Link
from edge.link.settings import LinkSettings, TlsSettings
from edge.messages import NetworkMessage, Tracks, camera_key, station_key

SITE = "hill"
TRACKS = Tracks(
    t_unix_ns=1_700_000_000_000_000_000,
    seq=1,
    epoch=1,
    clock_bound_s=None,
    size_px=(1, 1),
    readout_s=0.0,
    detections=[],
)
# A process of its own, because the library's log is a process's standard output.
BASE = """
import json, sys, time
from edge.link.link import Link
from edge.link.settings import LinkSettings, TlsSettings
from edge.link.zenoh_log import ZenohLog
endpoint, folder, access = sys.argv[1:]
tls = TlsSettings(authority=folder + "/authority.pem", certificate=folder + "/certificate.pem",
                  key=folder + "/key.pem", access=access)
with ZenohLog() as zenoh_log, Link(LinkSettings(listen=(endpoint,), tls=tls), name="base") as link:
    tracks = link.subscribe("skyfix/1/hill/cam/*/tracks")
    targets = link.subscribe("skyfix/1/hill/station/targets")
    presence = link.watch_presence("skyfix/1/hill/cam/*")
    heard = []
    link.wait_open(5)
    print("ready", flush=True)
    for line in sys.stdin:
        heard += [item.key for inbox in (tracks, targets, presence) for item in inbox.drain()]
        refusals = zenoh_log.refusals
        print(json.dumps([heard, refusals.handshakes, refusals.messages, refusals.last_reason]), flush=True)
"""


def certs(folder: Path, *arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "calib.station.app", "certs", "--folder", folder, *arguments],
        check=True,
        capture_output=True,
    )


@pytest.fixture(scope="module")
def authorities(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Our authority, and somebody else's with the same names."""
    ours, theirs = tmp_path_factory.mktemp("ours"), tmp_path_factory.mktemp("theirs")
    for folder in (ours, theirs):
        certs(folder, "init", SITE)
        certs(folder, "issue", "cam0")
        certs(folder, "issue", "base", "--role", "station", "--address", "127.0.0.1")
    certs(ours, "issue", "cam1")
    certs(ours, "issue", "old", "--days=-1")
    certs(ours, "issue", "stolen")
    certs(ours, "revoke", "stolen")
    # Of a box that was stolen, and whose name its successor got; of one that is being renewed.
    for name, act in (("cam2", "issue"), ("cam3", "renew")):
        certs(ours, "issue", name)
        shutil.copytree(ours / "issued" / name, ours / "issued" / f"{name}-before")
        if act == "issue":
            certs(ours, "revoke", name)
        certs(ours, act, name)
    return ours, theirs


def tls(authority: Path, folder: Path, name: str) -> TlsSettings:
    own = folder / "issued" / name
    return TlsSettings(
        authority=str(authority / "authority.pem"), certificate=str(own / "certificate.pem"), key=str(own / "key.pem")
    )


class Base:
    """The listening process; `report()` is what it heard and whom it turned away."""

    def __init__(self, process: "subprocess.Popen[str]", endpoint: str) -> None:
        self.process = process
        self.endpoint = endpoint

    def report(self) -> tuple[set[str], int, int, str]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        heard, handshakes, messages, reason = json.loads(self.process.stdout.readline())
        return set(heard), handshakes, messages, reason


@pytest.fixture
def base(endpoint: str, authorities: tuple[Path, Path]) -> Iterator[Base]:
    ours, _ = authorities
    secure = endpoint.replace("tcp/", "tls/")
    command = [sys.executable, "-c", BASE, secure, str(ours / "issued" / "base"), str(ours / "access.json")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield Base(process, secure)
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(timeout=5) == 0


def speak(link: Link, *keys: str, times: int = 10) -> None:
    for _ in range(times):
        for key in keys:
            link.publish(key, TRACKS)
        time.sleep(0.03)


def test_each_camera_speaks_for_itself_only(
    base: Base, authorities: tuple[Path, Path], until: Callable[..., bool]
) -> None:
    ours, _ = authorities
    own, foreign = camera_key(SITE, "cam0", "tracks"), camera_key(SITE, "cam1", "tracks")
    with Link(LinkSettings(connect=(base.endpoint,), tls=tls(ours, ours, "cam0")), name="cam0") as box:
        assert box.warning == ""
        box.declare_presence(camera_key(SITE, "cam0"))
        assert until(lambda: speak(box, own, times=1) or own in base.report()[0])
        healthy = base.report()
        assert healthy[1:3] == (0, 0), "a healthy box is turned away for nothing"
        box.declare_presence(camera_key(SITE, "cam1"))
        speak(box, foreign, station_key(SITE, "targets"), times=10)
        assert until(lambda: base.report()[2] >= 20)
    heard, handshakes, _, _ = base.report()
    assert heard == {own, camera_key(SITE, "cam0")}
    assert handshakes == 0


def test_a_camera_cannot_listen_to_another(
    base: Base, authorities: tuple[Path, Path], until: Callable[..., bool]
) -> None:
    ours, _ = authorities
    own = camera_key(SITE, "cam0", "tracks")
    with (
        Link(LinkSettings(connect=(base.endpoint,), tls=tls(ours, ours, "cam1")), name="spy") as spy,
        Link(LinkSettings(connect=(base.endpoint,), tls=tls(ours, ours, "cam0")), name="cam0") as box,
    ):
        ears = [spy.subscribe("**"), spy.subscribe("skyfix/1/hill/cam/*/tracks")]
        assert until(lambda: speak(box, own, times=1) or own in base.report()[0])
        speak(box, own)
        assert [len(ear) for ear in ears] == [0, 0]


@pytest.mark.parametrize(
    ("certificate", "reason"),
    [("theirs/cam0", "invalid peer certificate"), ("ours/old", "expired"), ("ours/stolen", "")],
)
def test_wrong_authority_expired_and_revoked_are_heard_by_nobody(
    base: Base, authorities: tuple[Path, Path], until: Callable[..., bool], certificate: str, reason: str
) -> None:
    ours, theirs = authorities
    whose, _, name = certificate.partition("/")
    settings = tls(ours, ours if whose == "ours" else theirs, name)
    with Link(LinkSettings(connect=(base.endpoint,), tls=settings), name="intruder") as intruder:
        keys = [camera_key(SITE, camera, "tracks") for camera in ("cam0", "old", "stolen")]
        intruder.declare_presence(camera_key(SITE, "cam0"))
        assert until(lambda: speak(intruder, *keys, times=1) or sum(base.report()[1:3]) > 0)
        speak(intruder, *keys)
    heard, handshakes, _, said = base.report()
    assert heard == set()
    assert reason in said
    assert (handshakes > 0) == bool(reason), "a revoked certificate connects and is denied everything"


@pytest.mark.parametrize(
    ("certificate", "heard"),
    [("cam2-before", False), ("cam2", True), ("cam3-before", True), ("cam3", True)],
)
def test_a_stolen_box_stays_out_when_its_name_is_issued_again_and_a_renewed_one_is_never_silent(
    base: Base, authorities: tuple[Path, Path], until: Callable[..., bool], certificate: str, heard: bool
) -> None:
    ours, _ = authorities
    key = camera_key(SITE, certificate.partition("-")[0], "tracks")
    with Link(LinkSettings(connect=(base.endpoint,), tls=tls(ours, ours, certificate)), name=certificate) as box:
        until(lambda: speak(box, key, times=1) or key in base.report()[0] or base.report()[2] > 9)
        assert (key in base.report()[0]) is heard


def test_without_a_certificate_nobody_gets_in(
    base: Base, authorities: tuple[Path, Path], until: Callable[..., bool]
) -> None:
    ours, _ = authorities
    address = ("127.0.0.1", int(base.endpoint.rpartition(":")[2]))
    context = ssl.create_default_context(cafile=str(ours / "authority.pem"))
    with (
        pytest.raises(ssl.SSLError, match="CERTIFICATE_REQUIRED"),
        socket.create_connection(address) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as secure,
    ):
        secure.recv(10)
    assert until(lambda: base.report()[1] == 1)
    assert base.report()[3] == "peer sent no certificates"
    with Link(LinkSettings(connect=(base.endpoint.replace("tls/", "tcp/"),)), name="plain") as intruder:
        assert until(lambda: speak(intruder, camera_key(SITE, "cam0", "tracks"), times=1) or base.report()[1] > 2)
    assert base.report()[0] == set()


def test_a_box_does_not_talk_to_a_false_base(
    endpoint: str, authorities: tuple[Path, Path], until: Callable[..., bool]
) -> None:
    ours, theirs = authorities
    secure = endpoint.replace("tcp/", "tls/")
    own = camera_key(SITE, "cam0", "tracks")
    listed: dict[str, Any] = {"access": str(theirs / "access.json")}
    own_files = tls(ours, ours, "cam0")
    their_files = tls(theirs, theirs, "base")
    false_base = TlsSettings(
        authority=their_files.authority, certificate=their_files.certificate, key=their_files.key, **listed
    )
    with (
        Link(LinkSettings(listen=(secure,), tls=false_base), name="false base") as thief,
        Link(LinkSettings(connect=(secure,), tls=own_files), name="cam0") as box,
    ):
        inbox = thief.subscribe(camera_key(SITE, "*", "tracks"))
        order = box.watch_state(station_key(SITE, "network"))
        now = round(dt.datetime.now(dt.UTC).timestamp() * 1e9)
        thief.set_state(
            station_key(SITE, "network"), NetworkMessage(t_unix_ns=now, state="calibrated", reason="", action="")
        )
        assert thief.wait_open(5)
        assert not until(lambda: speak(box, own, times=1) or len(inbox) or len(order), within_s=2.0)

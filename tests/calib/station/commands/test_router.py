"""Federation by configuration alone: two routers as processes, TLS throughout, and only what is asked for goes up."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from calib.station.router_watch import RouterWatch
from edge.link.link import Link
from edge.link.settings import LinkSettings, TlsSettings
from edge.messages import Targets, Tracks, camera_key, site_key, station_key
from tests.places import ROOT

NOW_NS = 1_700_000_000_000_000_000


class Federation(NamedTuple):
    """A headquarters' router and a site's that dials it."""

    certificates: Path
    hq: str
    hill: str
    processes: "dict[str, subprocess.Popen[bytes]]"
    start: Callable[[str], None]

    def link(self, name: str, endpoint: str) -> Link:
        return Link(LinkSettings(mode="client", connect=(endpoint,), tls=tls(self.certificates, name)), name=name)


def tls(folder: Path, name: str) -> TlsSettings:
    own = folder / "issued" / name
    return TlsSettings(
        authority=str(own / "authority.pem"), certificate=str(own / "certificate.pem"), key=str(own / "key.pem")
    )


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tls/127.0.0.1:{probe.getsockname()[1]}"


def router_toml(folder: Path, name: str, site: str, listen: str, connect: str) -> str:
    own = folder / "issued" / name
    return (
        f'site = "{site}"\n[link]\nlisten = ["{listen}"]\nconnect = [{connect}]\n[link.tls]\n'
        f'authority = "{own}/authority.pem"\ncertificate = "{own}/certificate.pem"\nkey = "{own}/key.pem"\n'
        f'access = "{folder}/access.json"\n'
    )


@pytest.fixture(scope="module")
def federation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Federation]:
    folder = tmp_path_factory.mktemp("federation")

    def certs(*arguments: str) -> None:
        command = [sys.executable, "-m", "calib.station.app", "certs", "--folder", folder, *arguments]
        subprocess.run(command, check=True, capture_output=True)

    hq, hill = free_endpoint(), free_endpoint()
    certs("init", "org")
    certs("issue", "hq-router", "--role", "reader", "--site", "*", "--address", "127.0.0.1")
    certs("issue", "hq-map", "--role", "reader", "--site", "*")
    certs("issue", "hill-router", "--role", "router", "--site", "hill", "--address", "127.0.0.1")
    certs("issue", "hill-base", "--role", "station", "--site", "hill")
    certs("issue", "hill-cam0", "--camera", "cam0", "--site", "hill")
    (folder / "hq.toml").write_text(router_toml(folder, "hq-router", "hq", hq, ""))
    (folder / "hill.toml").write_text(router_toml(folder, "hill-router", "hill", hill, f'"{hq}"'))
    processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(name: str) -> None:
        command = [sys.executable, "-m", "calib.station.app", "router", "--config", str(folder / f"{name}.toml")]
        processes[name] = subprocess.Popen(command, cwd=ROOT)

    for name in ("hq", "hill"):
        start(name)
    yield Federation(folder, hq, hill, processes, start)
    for process in processes.values():
        process.kill()
        process.wait(timeout=5)


def targets() -> Targets:
    return Targets(t_unix_ns=NOW_NS, targets=[])


def tracks(seq: int) -> Tracks:
    return Tracks(t_unix_ns=NOW_NS, seq=seq, epoch=1, clock_bound_s=None, size_px=(1, 1), readout_s=0.0, detections=[])


def test_targets_reach_the_headquarters_and_tracks_do_not(federation: Federation) -> None:
    with (
        federation.link("hq-map", federation.hq) as map_link,
        federation.link("hill-base", federation.hill) as base,
        federation.link("hill-cam0", federation.hill) as box,
    ):
        shown = map_link.subscribe(site_key("*", "station/targets"))
        present = map_link.watch_presence(station_key("*"))
        heard = base.subscribe(camera_key("hill", "*", "tracks"))
        base.declare_presence(station_key("hill"))
        deadline = time.monotonic() + 20
        while not (len(shown) and len(heard) and len(present)) and time.monotonic() < deadline:
            base.publish(station_key("hill", "targets"), targets())
            box.publish(camera_key("hill", "cam0", "tracks"), tracks(1))
            box.publish(station_key("hill", "targets"), targets())  # a box may not
            time.sleep(0.05)
        assert {item.key for item in heard.drain()} == {camera_key("hill", "cam0", "tracks")}
        assert {item.key for item in shown.drain()} == {station_key("hill", "targets")}
        assert [item.key for item in present.drain()] == [station_key("hill")]


def test_the_base_shows_what_its_router_says_of_itself(federation: Federation) -> None:
    with federation.link("hill-base", federation.hill) as base:
        watch = RouterWatch(base.subscribe(site_key("hill", "router/health"), 8))
        deadline = time.monotonic() + 20
        while not (found := watch.checks()) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert [check.name for check in found] == ["router"]
        assert "cannot be read" not in found[0].reason


def test_a_killed_router_is_back_within_seconds(federation: Federation) -> None:
    with federation.link("hill-base", federation.hill) as base, federation.link("hill-cam0", federation.hill) as box:
        heard = base.subscribe(camera_key("hill", "*", "tracks"))

        def silence_s(within_s: float) -> float:
            began = time.monotonic()
            heard.drain()
            while not len(heard):
                assert time.monotonic() - began < within_s, "box and base do not meet"
                box.publish(camera_key("hill", "cam0", "tracks"), tracks(1))
                time.sleep(0.05)
            return time.monotonic() - began

        silence_s(20)
        federation.processes["hill"].kill()
        federation.processes["hill"].wait(timeout=5)
        federation.start("hill")
        silence_s(20)


def test_a_router_stops_in_order(federation: Federation) -> None:
    process = federation.processes["hq"]
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=5) == 0

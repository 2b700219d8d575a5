"""The page and the status over HTTPS, with the site's own authority: for who knows it, and for nobody else."""

import datetime as dt
import http.client
import socket
import ssl
from pathlib import Path
from typing import Any, Final

import msgspec
import pytest

from calib.station.certs.authority import Authority
from calib.station.config import BaseConfig, CameraSection, SiteSection, StatusSection, checked
from calib.station.page.process import PageProcess, available
from calib.station.status.asking import running_station
from calib.station.status.https import check_page, https_of
from calib.station.status.server import StatusServer
from edge.common.errors import ConfigError
from edge.link.settings import LinkSettings, TlsSettings
from tests.calib.station.page.test_page import status
from tools.doubles.ports import free_port

SLOW: Final = 30  # who connect and say nothing


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> TlsSettings:
    """A base's own files, good for this machine's number."""
    folder, now = tmp_path_factory.mktemp("authority"), dt.datetime.now(dt.UTC)
    authority = Authority.create(folder, "hill", now)
    own = authority.issue("base", "station", cameras=(), addresses=("127.0.0.1",), days=30, now=now).folder
    files = {"certificate": own / "certificate.pem", "key": own / "key.pem", "authority": own / "authority.pem"}
    return TlsSettings(access=str(folder / "access.json"), **{name: str(file) for name, file in files.items()})


def config(files: TlsSettings | None, **section: Any) -> BaseConfig:
    cameras = [CameraSection(id=f"cam{k}") for k in range(3)]
    link = LinkSettings(listen=("tls/127.0.0.1:7447" if files else "tcp/127.0.0.1:7447",), tls=files)
    return BaseConfig(site=SiteSection(name="hill"), camera=cameras, link=link, status=StatusSection(**section))


def test_who_knows_the_authority_reads_it_and_nobody_else_does(tls: TlsSettings, tmp_path: Path) -> None:
    """A browser looks at the name it dialled; whoever asks in clear, or knows other authorities, gets nothing."""
    with StatusServer(StatusSection(port=0), tmp_path, tls) as server:
        server.show(status())
        trusting = ssl.create_default_context(cafile=tls.authority)
        connection = http.client.HTTPSConnection("127.0.0.1", server.port, timeout=20, context=trusting)
        connection.request("GET", "/status.json")
        assert connection.getresponse().status == 200
        connection.close()
        stranger = http.client.HTTPSConnection("127.0.0.1", server.port, timeout=20)
        with pytest.raises(ssl.SSLCertVerificationError):
            stranger.request("GET", "/status.json")
        stranger.close()


def test_who_never_shakes_hands_holds_nobody_up(tls: TlsSettings, tmp_path: Path) -> None:
    with StatusServer(StatusSection(port=0), tmp_path, tls) as server:
        server.show(status())
        slow = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(SLOW)]
        found = running_station(config(tls, port=server.port, tls=True), tmp_path)
        assert found is not None
        assert found.site == "hill"
        for one in slow:
            one.close()


def test_this_machines_own_programs_ask_over_it(tls: TlsSettings, tmp_path: Path) -> None:
    with StatusServer(StatusSection(port=0), tmp_path, tls) as server:
        server.show(status())
        assert running_station(config(tls, port=server.port, tls=True), tmp_path) is not None
        assert running_station(config(tls, port=server.port), tmp_path) is None, "in clear nobody answers"


def test_the_page_is_served_over_it(tls: TlsSettings, tmp_path: Path, until: Any) -> None:
    if not available():
        pytest.skip("the extra `page` is not installed")
    options = StatusSection(port=free_port())
    with PageProcess(options, tmp_path, "hill", recordings=None, report=tmp_path / "r.html", tls=tls) as page:
        page.show(status())
        trusting = ssl.create_default_context(cafile=tls.authority)
        raw = socket.create_connection(("127.0.0.1", page.port), timeout=60)
        assert until(lambda: page.commands() == [] and page.pid is not None, within_s=20)
        with trusting.wrap_socket(raw, server_hostname="127.0.0.1") as encrypted:
            encrypted.sendall(b"GET /status.json HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n")
            answer = b"".join(iter(lambda: encrypted.recv(1 << 16), b""))
        head, _, body = answer.partition(b"\r\n\r\n")
        assert head.split()[1] == b"200"
        assert msgspec.json.decode(body)["site"] == "hill"


def test_it_needs_the_links_files_and_they_must_be_some(tls: TlsSettings, tmp_path: Path) -> None:
    checked(config(tls, tls=True), tmp_path)
    assert https_of(config(tls, tls=True)) is tls
    assert https_of(config(tls)) is None
    with pytest.raises(ConfigError, match=r"status\.tls is served with the files of \[link\.tls\]"):
        checked(config(None, tls=True), tmp_path)
    with pytest.raises(ConfigError, match="no certificate to serve the page with"):
        StatusServer(StatusSection(port=0), tmp_path, msgspec.structs.replace(tls, key=str(tmp_path / "none")))


@pytest.mark.parametrize(
    ("section", "level"),
    [
        ({"host": "127.0.0.1"}, None),
        ({"host": "0.0.0.0", "port": None}, None),
        ({"host": "0.0.0.0", "token_file": "t"}, "warn"),
        ({"host": "0.0.0.0", "token_file": "t", "tls": True}, "ok"),
    ],
)
def test_a_page_for_others_in_clear_is_said(section: dict[str, Any], level: str | None, tls: TlsSettings) -> None:
    found = check_page(config(tls, **section))
    assert (None if found is None else found.level) == level

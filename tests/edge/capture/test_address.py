"""A password is shown nowhere, and why a camera does not open is told apart."""

import socket
import threading

import numpy as np
import pytest

from edge.capture import open_source
from edge.capture.address import shown, why_not
from edge.commands.check import resolved
from edge.common.errors import LoginError, SourceError
from edge.config import BoxConfig, CameraConfig, LensConfig, SourceConfig
from tests.edge.capture.sources import SIZE, undoubted

LENS = LensConfig(model="radtan", intrinsics=(100.0, 100.0, 80.0, 60.0), distortion=(0.0, 0.0, 0.0, 0.0), size_px=SIZE)


def addresses(seed: int) -> list[tuple[str, str]]:
    """Addresses as cameras have them, with a password drawn from all that people type."""
    rng = np.random.default_rng(seed)
    password = "S3" + "".join(rng.choice(list("abzAZ09-.~!$'()*+,;%:@/?#[] äß"), 12)) + "9x"
    plain = password.replace("&", "").replace("/", "").replace("?", "").replace("#", "")
    return [
        (f"rtsp://admin:{password}@10.0.0.7:554/Streaming/Channels/101", password),
        (f"http://{password}@cam.local/video", password),
        (f"rtsp://10.0.0.7/user=admin&password={plain}&channel=1&stream=0.sdp", plain),
        (f"rtsp://10.0.0.7/user=admin_password={plain}_channel=1_stream=0.sdp", plain),
        (f"http://10.0.0.7/mjpg?user=admin&pwd={plain}", plain),
        (f"http://10.0.0.7/mjpg?token={plain}&x=1", plain),
    ]


@pytest.mark.parametrize("seed", range(20))
def test_no_password_is_shown(seed: int) -> None:
    for address, password in addresses(seed):
        assert password not in shown(address)
        camera = CameraConfig(id="cam1", lens=LENS, source=SourceConfig(path=address))
        assert password not in resolved(BoxConfig(site="s", camera=(camera,)))


SECRET = "Geh3im.x7Q"
ODD = [
    *(f"http://10.0.0.7/v?{key}={SECRET}&channel=1" for key in ("loginpas", "psw", "sid", "session", "accessToken")),
    *(
        f"http://10.0.0.7/v?{key}={SECRET}"
        for key in ("apikey", "X-Amz-Signature", "jwt", "passcode", "credential", "p")
    ),
    f"http://10.0.0.7/v?a[password]={SECRET}",
    f"http://10.0.0.7/v?password%3D{SECRET}",
    f"srt://10.0.0.7:9000?passphrase={SECRET}&mode=caller",
    f"srt://10.0.0.7:9000?streamid={SECRET}",
    f"rtsp://10.0.0.7/live?authbasic={SECRET}",
    f"rtsp://:{SECRET}@10.0.0.7/live",
    f"admin:{SECRET}@10.0.0.7:554/live",
    f"//admin:{SECRET}@10.0.0.7/live",
    f"rtsp:/admin:{SECRET}@10.0.0.7/live",
    f"rtsp//admin:{SECRET}@10.0.0.7/live",
]


@pytest.mark.parametrize("address", ODD)
def test_no_secret_of_an_odd_address_is_shown(address: str) -> None:
    assert SECRET not in shown(address)
    assert "10.0.0.7" in shown(address)


@pytest.mark.parametrize("address", [one for one in ODD if "://" not in one])
def test_an_address_typed_wrongly_is_no_file_and_shows_nothing(address: str) -> None:
    camera = CameraConfig(id="cam1", lens=LENS, source=SourceConfig(path=address))
    with pytest.raises(SourceError) as error:
        open_source(camera, colour=False, stop=threading.Event(), date=undoubted)
    assert SECRET not in str(error.value)


def test_keys_in_paths_are_not_shown() -> None:
    assert shown("rtsps://10.0.0.7:7441/AbC9dEf2gHi4jKlM?enableSrtp") == "rtsps://10.0.0.7:7441/***?enableSrtp"
    assert "0f1e2d3c" not in shown("http://10.0.0.7/hls/0f1e2d3c-4b5a-6978-8796-a5b4c3d2e1f0/index.m3u8")


@pytest.mark.parametrize(
    "path",
    [
        "/data/a@b/clip.mp4", "/data/2026-05-01T10:00:00/x@y.mp4", "/dev/video0", "rtsp://10.0.0.7:554/live",
        "rtsp://10.0.0.7/h264Preview_01_main", "rtsp://10.0.0.7/cam/realmonitor?channel=1&subtype=0",
        "rtsp://10.0.0.7:554/Streaming/Channels/101", "http://10.0.0.7:8080/?action=stream",
    ],
)  # fmt: skip
def test_what_holds_no_password_is_shown_as_it_is(path: str) -> None:
    assert shown(path) == path


def answering(answer: bytes) -> tuple[socket.socket, int]:
    """A camera that answers everything so."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            with client:
                client.recv(4096)
                client.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    return listener, listener.getsockname()[1]


@pytest.mark.parametrize(
    ("answer", "kind", "said"),
    [
        (b"RTSP/1.0 401 Unauthorized\r\nCSeq: 1\r\n\r\n", LoginError, "user name or password"),
        (b"RTSP/1.0 404 Not Found\r\nCSeq: 1\r\n\r\n", SourceError, "no such stream"),
        (b"HTTP/1.0 403 Forbidden\r\n\r\n", LoginError, "user name or password"),
        (b"SSH-2.0\r\n", SourceError, "does not open"),
    ],
)
def test_why_a_camera_does_not_open(answer: bytes, kind: type[SourceError], said: str) -> None:
    listener, port = answering(answer)
    scheme = "http" if answer.startswith(b"HTTP") else "rtsp"
    error = why_not(f"{scheme}://admin:Secret99@127.0.0.1:{port}/live")
    listener.close()
    assert type(error) is kind
    assert said in error.what
    assert "Secret99" not in str(error)


def test_nobody_there_and_a_password_to_be_encoded() -> None:
    assert "nobody answers" in why_not("rtsp://admin:Secret99@127.0.0.1:1/live").what
    error = why_not("rtsp://admin:p@ss:w/rd#1?@127.0.0.1:1/live")
    assert isinstance(error, LoginError)
    assert "percent-encode" in error.action
    assert "ss:w" not in str(error)


def test_opening_says_why_and_hides_who() -> None:
    camera = CameraConfig(id="cam1", lens=LENS, source=SourceConfig(path="rtsp://admin:Secret99@127.0.0.1:1/x"))
    with pytest.raises(SourceError, match="nobody answers") as caught:
        open_source(camera, colour=False, stop=threading.Event(), date=undoubted)
    assert "Secret99" not in str(caught.value)

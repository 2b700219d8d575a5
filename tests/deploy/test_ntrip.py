"""Corrections reach the receiver and its position the caster, by the real str2str; no command line has the password.

The caster is a socket that says what a real one says to str2str, which speaks Ntrip 1.
"""

import base64
import contextlib
import os
import random
import shlex
import socket
import string
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.ntrip.corrections import Caster, asked_of, parse
from tests.places import DEPLOY, ROOT

PASSWORD = "s3cret:with@signs/and space"
CORRECTIONS = b"\xd3\x00\x13" + bytes(range(19)) + b"\x01\x02\x03"
POSITION = b"$GNGGA,120000.00,4723.0,N,00833.0,E,4,12,0.6,408.0,M,47.0,M,1.0,0000*5B\r\n"
ANSWERS = [b"ICY 200 OK\r\n", b"ICY 200 OK\r\n\r\n"]
PATIENCE_S = 15.0  # limit of every wait: str2str starts slowly on a busy machine


@contextmanager
def started(caster: socket.socket, to: str) -> Iterator["subprocess.Popen[str]"]:
    """The service's program, as its unit starts it."""
    source = f"ntrip://rover:{PASSWORD}@127.0.0.1:{caster.getsockname()[1]}/HILL"
    environment = os.environ | {"NTRIP_SOURCE": source, "NTRIP_TO": to}
    command = [sys.executable, str(DEPLOY / "ntrip/corrections.py")]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as one:
        try:
            yield one
        finally:
            one.terminate()
            one.wait(PATIENCE_S)


def asked(connection: socket.socket) -> bytes:
    """The request that arrived."""
    head = b""
    while b"\r\n\r\n" not in head:
        head += connection.recv(4096)
    return head


def command_lines() -> str:
    """What anybody sees of all processes."""
    files = Path("/proc").glob("[0-9]*/cmdline")
    seen = []
    for file in files:
        try:
            seen.append(file.read_bytes().replace(b"\0", b" ").decode("latin-1"))
        except OSError:
            continue  # it ended meanwhile
    return "\n".join(seen)


@pytest.mark.program("str2str")
@pytest.mark.parametrize("answer", ANSWERS)
def test_corrections_arrive_and_nobody_sees_the_password(answer: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as caster, socket.create_server(("127.0.0.1", 0)) as receiver:
        caster.settimeout(PATIENCE_S)
        receiver.settimeout(PATIENCE_S)
        with started(caster, f"tcpcli://127.0.0.1:{receiver.getsockname()[1]}"):
            connection, _ = caster.accept()
            there, _ = receiver.accept()
            with connection, there:
                there.settimeout(PATIENCE_S)
                connection.settimeout(PATIENCE_S)
                head = asked(connection)
                assert head.startswith(b"GET /HILL HTTP/1.")
                assert b"Authorization: Basic " + base64.b64encode(f"rover:{PASSWORD}".encode()) in head
                seen = command_lines()
                assert "str2str" in seen
                assert PASSWORD not in seen
                connection.sendall(answer + CORRECTIONS)
                assert there.recv(4096).endswith(CORRECTIONS)
                there.sendall(POSITION)
                assert POSITION.strip() in connection.recv(4096)


@pytest.mark.program("str2str")
@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (b"HTTP/1.1 401 Unauthorized\r\n\r\n", "says: HTTP/1.1 401"),
        (b"SOURCETABLE 200 OK\r\n\r\n", "no mountpoint HILL"),
    ],
)
def test_a_refusal_is_told_with_the_casters_own_words(answer: bytes, told: str, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as caster:
        caster.settimeout(PATIENCE_S)
        with started(caster, f"file://{tmp_path}/out") as program:
            connection, _ = caster.accept()
            with connection:
                asked(connection)
                connection.sendall(answer)
            assert program.stdout is not None
            said = next(line for line in program.stdout if "skyfix-ntrip:" in line)
            assert told in said
            assert "s3cret" not in said


@pytest.mark.program("str2str")
@pytest.mark.parametrize("host", ["127.0.0.1:1", "a..b", "nobody.invalid"])
def test_a_caster_that_cannot_be_reached_is_told_and_tried_again(host: str, tmp_path: Path) -> None:
    environment = os.environ | {"NTRIP_SOURCE": f"ntrip://{host}/HILL", "NTRIP_TO": f"file://{tmp_path}/out"}
    command = [sys.executable, str(DEPLOY / "ntrip/corrections.py")]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as one:
        assert one.stdout is not None
        said = next(line for line in one.stdout if "skyfix-ntrip:" in line)
        alive = one.poll() is None
        one.terminate()
        one.wait(PATIENCE_S)
    assert "cannot be reached" in said
    assert alive


def test_what_the_program_ends_with_is_its_own(tmp_path: Path) -> None:
    """A str2str that ends, as it does where its port is gone: the service ends too, and is started anew by systemd."""
    (tmp_path / "str2str").write_text("#!/bin/sh\nexit 3\n")
    (tmp_path / "str2str").chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "NTRIP_SOURCE": "ntrip://a/B", "NTRIP_TO": "file://x"}
    command = [sys.executable, str(DEPLOY / "ntrip/corrections.py")]
    assert subprocess.run(command, env=environment, check=False, timeout=PATIENCE_S).returncode == 3


def test_sources_are_read_as_str2str_reads_them() -> None:
    """Twenty drawn ones, of names, passwords with every sign, ports and mountpoints."""
    chance = random.Random(15)
    signs = string.ascii_letters + string.digits + "@:/#!$%&' "
    for _ in range(20):
        user = "".join(chance.choices(string.ascii_letters, k=6))
        password = "".join(chance.choices(signs, k=12))
        host = chance.choice(("caster.example.org", "192.168.7.1", "[fd00::1]"))
        port = chance.choice((2101, 80, 65535))
        found = parse(f"ntrip://{user}:{password}@{host}:{port}/VRS_3")
        assert found == Caster(host.strip("[]"), port, "VRS_3", f"{user}:{password}")
    assert parse("ntrip://caster/M") == Caster("caster", 2101, "M", "")


@pytest.mark.parametrize(
    "source",
    [
        "",
        "ntrip://u:geheim@caster",
        "http://u:geheim@caster/M",
        "ntrip://u:geheim@/M",
        "ntrip://u:geheim@c:65536/M",
    ],
)
def test_what_is_no_source_is_refused_without_its_password(source: str) -> None:
    with pytest.raises(ValueError, match="NTRIP_SOURCE") as refusal:
        parse(source)
    assert "geheim" not in str(refusal.value)


@given(st.text(max_size=60))
def test_whatever_stands_for_a_source_is_one_or_is_refused(text: str) -> None:
    with contextlib.suppress(ValueError):
        found = parse(f"ntrip://{text}")
        assert 0 <= found.port <= 65535
        assert found.host
        assert found.mount


@given(st.binary(max_size=300))
def test_whatever_is_asked_is_asked_of_the_caster_in_one_request(head: bytes) -> None:
    asked = asked_of(Caster("c", 2101, "M", "u:p"), head)
    assert asked.count(b"\r\n\r\n") == 1
    assert asked.endswith(b"Authorization: Basic dTpw\r\n\r\n")


def test_a_caster_without_a_user_is_asked_without_one() -> None:
    head = asked_of(Caster("c", 2101, "M", ""), b"GET /M HTTP/1.0\r\nUser-Agent: NTRIP RTKLIB/2.4.3")
    assert head == b"GET /M HTTP/1.0\r\nUser-Agent: NTRIP RTKLIB/2.4.3\r\nHost: c:2101\r\n\r\n"


def test_the_unit_gives_str2str_nothing_and_the_example_is_read() -> None:
    unit = (ROOT / "systemd/skyfix-ntrip.service").read_text()
    assert "${NTRIP" not in unit
    assert "deploy/ntrip/corrections.py" in unit
    lines = (DEPLOY / "ntrip/ntrip.example.env").read_text().splitlines()
    values = dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))
    assert parse(shlex.split(values["NTRIP_SOURCE"])[0]).user == "USER:PASSWORD"

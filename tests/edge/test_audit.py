"""What `check` says of the machine: open ports, files, time sources."""

import os
import socket
from pathlib import Path

import pytest

from edge.audit import OpenPort, check_files, check_ports, check_program, check_time_sources, open_ports


def test_what_this_process_hears_is_found_as_it_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as one, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("0.0.0.0", 0))
        port = one.getsockname()[1]
        found = open_ports([port])
        assert OpenPort("tcp", "127.0.0.1", port) in found
        assert OpenPort("udp", "0.0.0.0", other.getsockname()[1]) in found
    assert OpenPort("tcp", "127.0.0.1", port) not in open_ports([port])


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6 here")
def test_an_address_of_ipv6_is_read_right() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as one:
        assert OpenPort("tcp", "::1", one.getsockname()[1]) in open_ports([one.getsockname()[1]])


@pytest.mark.parametrize(
    ("found", "configured", "level"),
    [
        (OpenPort("tcp", "127.0.0.1", 8080), [], "ok"),
        (OpenPort("tcp", "0.0.0.0", 7447), [("0.0.0.0", 7447)], "ok"),
        (OpenPort("tcp", "192.168.7.1", 7447), [("0.0.0.0", 7447)], "ok"),
        (OpenPort("tcp", "192.168.7.1", 7447), [("base.local", 7447)], "ok"),
        (OpenPort("tcp", "0.0.0.0", 8080), [("127.0.0.1", 8080)], "fail"),
        (OpenPort("tcp", "::", 8080), [("127.0.0.1", 8080)], "fail"),
        (OpenPort("tcp", "0.0.0.0", 9999), [("0.0.0.0", 7447)], "fail"),
        (OpenPort("udp", "0.0.0.0", 40_000), [], "ok"),  # what a datagram is sent from
    ],
)
def test_a_port_open_to_others_has_to_be_configured(
    found: OpenPort, configured: list[tuple[str, int]], level: str
) -> None:
    check = check_ports([found], configured)
    assert check.level == level
    assert (str(found) in check.reason) == (level == "fail" or (found.protocol == "tcp" and "127" not in found.host))


def test_files_that_others_may_change_or_read_are_named(tmp_path: Path) -> None:
    for name, mode in (("key", 0o600), ("list", 0o644), ("recording", 0o640)):
        (tmp_path / name).touch()
        (tmp_path / name).chmod(mode)
    private, shared = [tmp_path / "key", tmp_path / "recording", tmp_path / "none"], [tmp_path / "list"]
    assert check_files(private, shared).level == "ok"
    (tmp_path / "recording").chmod(0o644)
    check = check_files(private, shared)
    assert (check.level, check.action) == ("warn", f"chmod o= {tmp_path / 'recording'}")
    assert os.system(check.action) == 0
    assert check_files(private, shared).level == "ok"
    (tmp_path / "list").chmod(0o666)
    check = check_files(private, shared)
    assert (check.level, check.action) == ("fail", f"chmod o-w {tmp_path / 'list'}")
    assert check_files([], [Path("/tmp")]).level == "ok", "a folder where each may only remove his own"


@pytest.mark.parametrize(
    ("said", "level"),
    [
        ("192.168.7.1,NTS,1,15,256,135,0,0,8,100\n", "ok"),
        ("192.168.7.1,SK,30,13,128,-,0,0,0,0\n10.0.0.1,NTS,1,15,256,135,0,0,8,100\n", "ok"),
        ("192.168.7.1,NTS,1,15,256,135,0,0,8,100\npool.example,-,0,0,0,-,0,0,0,0\n", "warn"),
        ("", None),
        ("506 Cannot talk to daemon\n", None),
    ],
)
def test_time_from_whoever_answers_is_told(said: str, level: str | None) -> None:
    check = check_time_sources(said)
    assert (check.level if check else None) == level


def test_versions_are_told() -> None:
    assert "zenoh" in check_program().reason

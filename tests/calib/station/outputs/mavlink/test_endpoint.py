"""Sockets that never block the loop: UDP, TCP both ways, a serial line; peers that vanish, come back or do not read."""

import contextlib
import os
import pty
import socket
import time
import tty
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from calib.station.outputs.mavlink.endpoint import (
    BACKLOG_BYTES,
    BYTES_A_POLL,
    CLIENTS_OF_ONE,
    LINK_READ_BYTES,
    REDIAL_NS,
    Endpoint,
    open_endpoint,
)
from edge.common.errors import ConfigError
from tests.calib.station.running import udp_ear
from tests.conftest import Until

FRAMES = [b"\xfd one", b"\xfd two"]


@contextmanager
def opened(url: str) -> Iterator[Endpoint]:
    with closing(open_endpoint(url)) as endpoint:
        yield endpoint


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("url", ["", "udp:", "udp:host", "udp::1", "http:host:80", "serial:/dev/ttyUSB0:fast"])
def test_what_is_no_endpoint_is_refused_with_the_forms_there_are(url: str) -> None:
    with pytest.raises(ConfigError, match="is no MAVLink endpoint") as refused:
        open_endpoint(url)
    assert "tcpin:HOST:PORT" in refused.value.action


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder, pytest.raises(ConfigError, match="cannot be opened"):
        open_endpoint(f"tcpin:127.0.0.1:{holder.getsockname()[1]}")


def test_udp_sends_a_frame_a_datagram_and_hears_the_answer(until: Until) -> None:
    with udp_ear() as ear, opened(f"udp:127.0.0.1:{ear.port}") as endpoint:
        endpoint.send(FRAMES, 0)
        came: list[bytes] = []
        assert until(lambda: came.extend(ear.datagrams()) or came == FRAMES)
        assert endpoint.sent_bytes == sum(map(len, FRAMES))
        sender = endpoint._socket.getsockname()  # type: ignore[attr-defined]
        ear.socket.sendto(b"answer", sender)
        answers: list[bytes] = []
        assert until(lambda: answers.extend(data for _, data in endpoint.receive(0)) or answers == [b"answer"])
        assert endpoint.errors == 0


def test_a_flood_over_udp_is_read_a_little_a_call_and_whole_datagrams_of_it(until: Until) -> None:
    """64 kB of `FE 00 ..` took 200 to 400 ms to parse in one turn of the loop that sends targets."""
    with udp_ear() as ear, opened(f"udp:127.0.0.1:{ear.port}") as endpoint:
        sender = endpoint._socket.getsockname()  # type: ignore[attr-defined]
        for _ in range(20):
            ear.socket.sendto(b"\xfe" + bytes(1399), sender)
        calls: list[int] = []
        assert until(lambda: calls.append(sum(len(d) for _, d in endpoint.receive(0))) or sum(calls) == 20 * 1400)
        assert max(calls) <= BYTES_A_POLL + LINK_READ_BYTES
        assert all(call % 1400 == 0 for call in calls)


def test_of_many_clients_that_shout_each_has_its_turn(until: Until) -> None:
    port = free_port()
    with opened(f"tcpin:127.0.0.1:{port}") as endpoint, contextlib.ExitStack() as stack:
        clients = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(4)]
        assert until(lambda: (endpoint.receive(0), len(endpoint._streams) == 4)[1])  # type: ignore[attr-defined]
        for client in clients:
            client.sendall(bytes(5 * LINK_READ_BYTES))
        heard: dict[int, int] = {}

        def one_call() -> bool:
            came = endpoint.receive(0)
            assert sum(len(data) for _, data in came) < BYTES_A_POLL + LINK_READ_BYTES
            for number, data in came:
                heard[number] = heard.get(number, 0) + len(data)
            return len(heard) == 4

        assert until(one_call)
        assert max(heard.values()) <= 3 * LINK_READ_BYTES, "no one was read to its end before the others"


@pytest.mark.parametrize(("host", "bound"), [("127.0.0.1", "127.0.0.1"), ("localhost", "127.0.0.1"), ("[::1]", "::1")])
def test_what_sends_to_this_machine_hears_only_this_machine(host: str, bound: str) -> None:
    endpoint = open_endpoint(f"udp:{host}:14999")
    endpoint.send([b"x"], 0)
    assert endpoint._socket.getsockname()[0] == bound  # type: ignore[attr-defined]
    endpoint.close()


def test_udp_counts_what_can_t_be_sent_and_goes_on() -> None:
    with udp_ear() as ear, opened(f"udp:127.0.0.1:{ear.port}") as endpoint:
        endpoint.send([b"x" * 70_000, *FRAMES], 0)  # longer than a datagram can be
        assert endpoint.errors == 1
        assert "too long" in endpoint.last_error
        assert endpoint.sent_bytes == sum(map(len, FRAMES))


def test_a_listener_serves_many_and_drops_the_one_that_does_not_read(until: Until) -> None:
    port = free_port()
    with opened(f"tcpin:127.0.0.1:{port}") as endpoint:
        endpoint.send(FRAMES, 0)  # nobody there: nothing to do
        with (
            socket.create_connection(("127.0.0.1", port)) as good,
            socket.create_connection(("127.0.0.1", port)) as bad,
        ):
            good.setblocking(False)
            bad.sendall(b"hello")
            heard: list[bytes] = []
            assert until(lambda: heard.extend(data for _, data in endpoint.receive(0)) or heard == [b"hello"])
            assert until(lambda: (endpoint.receive(0), len(endpoint._streams) == 2)[1])  # type: ignore[attr-defined]
            received = bytearray()
            sent = 0
            while endpoint.errors == 0:
                endpoint.send([b"x" * 10_000], 0)
                sent += 10_000
                assert sent < 50 * BACKLOG_BYTES, "it should have been dropped by now"
                received += _read(good)
            assert endpoint.last_error.endswith("peer does not read")
            assert until(lambda: received.extend(_read(good)) or (endpoint.send([], 0), len(received) == sent)[1])


def _read(one: socket.socket) -> bytes:
    try:
        return one.recv(1 << 20)
    except BlockingIOError:
        return b""


def test_a_thousand_silent_clients_hold_no_more_than_their_share(until: Until) -> None:
    port = free_port()
    with opened(f"tcpin:127.0.0.1:{port}") as endpoint, contextlib.ExitStack() as stack:
        clients = []
        for _ in range(300):
            clients.append(stack.enter_context(socket.create_connection(("127.0.0.1", port))))
            endpoint.send([], 0)
        assert until(lambda: (endpoint.send([], 0), endpoint.errors >= 300 - CLIENTS_OF_ONE)[1])
        assert len(endpoint._streams) == CLIENTS_OF_ONE  # type: ignore[attr-defined]
        assert "turned away" in endpoint.last_error
        assert not endpoint.hopeless
        endpoint.send(FRAMES, 0)
        assert clients[0].recv(100) == b"".join(FRAMES), "who was there first goes on"


def test_a_server_that_comes_later_and_again_is_dialled_again(until: Until) -> None:
    port, now_ns = free_port(), 0
    with opened(f"tcp:127.0.0.1:{port}") as endpoint:

        def dialled() -> bool:
            nonlocal now_ns
            now_ns += REDIAL_NS
            endpoint.send(FRAMES, now_ns)
            return endpoint.sent_bytes > 0

        endpoint.send(FRAMES, now_ns)
        assert until(lambda: (endpoint.send(FRAMES, now_ns), endpoint.errors > 0)[1])
        for _ in range(2):
            endpoint.sent_bytes = 0
            with socket.create_server(("127.0.0.1", port)) as server:
                assert until(dialled)
                peer, _ = server.accept()
                with peer:
                    assert peer.recv(100).startswith(FRAMES[0])
            assert until(lambda: (endpoint.receive(now_ns), endpoint.errors > 1)[1])


def test_a_serial_line_speaks_and_is_opened_again_when_it_was_unplugged(tmp_path: Path, until: Until) -> None:
    device = tmp_path / "radio"
    with opened(f"serial:{device}:57600") as endpoint:
        endpoint.send(FRAMES, 0)
        assert endpoint.errors == 1  # not there yet
        for turn in (1, 2):
            ours, theirs = pty.openpty()
            tty.setraw(theirs)
            device.symlink_to(os.ttyname(theirs))
            endpoint.send(FRAMES, 2 * turn * REDIAL_NS)
            assert os.read(ours, 100) == b"".join(FRAMES)
            os.write(ours, b"answer")
            answers: list[bytes] = []
            assert until(lambda: answers.extend(data for _, data in endpoint.receive(0)) or answers == [b"answer"])  # noqa: B023
            os.close(ours)
            os.close(theirs)
            device.unlink()
            before = endpoint.errors
            assert until(lambda: (endpoint.receive(0), endpoint.errors > before)[1])  # noqa: B023


def whole_frames(data: bytes) -> list[int]:
    """The numbers of frames in a stream, each of eight bytes; raises ValueError where one is cut."""
    return [int(data[k : k + 8].decode("ascii").removeprefix("#")) for k in range(0, len(data), 8)]


def test_a_serial_peer_that_stops_reading_holds_up_nobody_and_loses_only_the_oldest() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    with opened(f"serial:{os.ttyname(theirs)}:57600") as endpoint:
        slowest_s = 0.0
        for number in range(20_000):
            began_s = time.perf_counter()
            endpoint.send([b"#%07d" % number], 0)
            endpoint.receive(0)
            slowest_s = max(slowest_s, time.perf_counter() - began_s)
        assert slowest_s < 0.5  # a busy machine's scheduling; a write that waits is without end
        assert endpoint.errors > 1000
        assert "does not take" in endpoint.last_error
        assert not endpoint.hopeless
        came = b""
        for _ in range(200):  # it reads again
            with contextlib.suppress(BlockingIOError):
                came += os.read(ours, 65536)
            endpoint.send([], 0)
        numbers = whole_frames(came)
        assert numbers == sorted(set(numbers))
        assert numbers[-1] == 19_999
        before = endpoint.errors
        endpoint.send([b"#%07d" % 20_000], 0)
        assert endpoint.errors == before
        began_s = time.perf_counter()
    assert time.perf_counter() - began_s < 1.0
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]", "[::]", "::", "0.0.0.0"])
def test_what_people_write_for_listening_listens(host: str) -> None:
    port = free_port()
    with opened(f"tcpin:{host}:{port}") as endpoint:
        reached = "::1" if ":" in host and host != "0.0.0.0" else "127.0.0.1"
        with socket.create_connection((reached, port), timeout=5):
            endpoint.receive(0)
            assert endpoint.errors == 0


def test_a_broadcast_address_may_be_sent_to() -> None:
    with opened("udp:127.255.255.255:14555") as endpoint:
        endpoint.send(FRAMES, 0)
        assert (endpoint.errors, endpoint.sent_bytes) == (0, sum(map(len, FRAMES)))


def test_a_name_with_both_addresses_is_reached_where_receivers_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    both = [(socket.AF_INET6, 2, 17, "", ("::1", 5, 0, 0)), (socket.AF_INET, 2, 17, "", ("127.0.0.1", 5))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: both)
    with opened("udp:localhost:5") as endpoint:
        assert endpoint._address == ("127.0.0.1", 5)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("url", "remedy"),
    [
        ("udp://127.0.0.1:14550", "write udp:127.0.0.1:14550"),
        ("udpout:127.0.0.1:14550", "write udp:127.0.0.1:14550"),
        ("udpin:0.0.0.0:14550", "a receiver's address"),
        ("tcp://host:5760", "write tcp:host:5760"),
    ],
)
def test_what_other_programs_call_an_endpoint_is_translated(url: str, remedy: str) -> None:
    with pytest.raises(ConfigError) as refused:
        open_endpoint(url)
    assert remedy in refused.value.action

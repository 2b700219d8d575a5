"""The reader against other people's programs: gpsd's decoder, RTKLIB's str2str, socat. Skipped where not installed."""

import datetime as dt
import json
import os
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from edge.config import GnssConfig
from edge.gnss.diagnosis import ReceiverState
from edge.gnss.gates import Position, offset_m
from edge.gnss.receiver import Receiver
from edge.gnss.session import StaticSession
from tests.conftest import Until
from tests.places import DATA
from tools.doubles.receiver import Place, gga, rmc, rtk_error

RECORDINGS = DATA / "nmea"
PLACE = Place()
PATIENCE_S = 15.0  # limit of every wait: other people's programs start slowly on a busy machine


def decoded_by_gpsd(stream: bytes) -> dict[str, Position]:
    """Positions by time as gpsd's own decoder reads a stream."""
    done = subprocess.run(["gpsdecode"], input=stream, capture_output=True, timeout=60, check=True)
    reports = [json.loads(line) for line in done.stdout.decode("latin-1").splitlines() if line.startswith("{")]
    return {
        report["time"][11:23]: Position(0, None, report["lat"], report["lon"], report["altHAE"], (0.0, 0.0), "gpsd")
        for report in reports
        if report["class"] == "TPV" and "altHAE" in report and "time" in report
    }


def accepted_by_us(stream: bytes) -> dict[str, Position]:
    """Positions by time as we read it."""
    session = StaticSession()
    accepted = session.feed(stream, 0.0) + session.interrupt(1.0)
    midnight = dt.datetime(2000, 1, 1, tzinfo=dt.UTC)
    return {(midnight + dt.timedelta(milliseconds=p.t_day_ms)).strftime("%H:%M:%S.%f")[:12]: p for p in accepted}


def assert_same(stream: bytes, least: int) -> None:
    """Both decoders agree about every epoch that both give."""
    ours, theirs = accepted_by_us(stream), decoded_by_gpsd(stream)
    common = ours.keys() & theirs.keys()
    assert len(common) >= least
    # gpsd prints 1e-9 degree and 0.1 mm.
    worst = max(float(np.linalg.norm(offset_m(ours[t], theirs[t]))) for t in common)
    assert worst < 5e-4


@pytest.mark.program("gpsdecode")
def test_gpsd_reads_our_simulator_as_we_do() -> None:
    times = [dt.datetime(2026, 6, 1, 12, 0, i, tzinfo=dt.UTC) for i in range(60)]
    error = rtk_error(np.arange(60.0), np.random.default_rng(1))
    assert_same(b"".join(gga(t, PLACE, e) + rmc(t) for t, e in zip(times, error, strict=True)), least=55)


@pytest.mark.program("gpsdecode")
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"the recordings are not at {RECORDINGS}")
@pytest.mark.parametrize("name", ["x5_static_1m_baseline_rtklib.nmea", "f9p_static_q4_2hz.nmea"])
def test_gpsd_reads_recordings_as_we_do(name: str) -> None:
    assert_same((RECORDINGS / name).read_bytes(), least=100)


@pytest.fixture
def receivers() -> Iterator[Callable[[str], Receiver]]:
    """Start receivers that are stopped at the end."""
    started: list[Receiver] = []

    def start(device: str) -> Receiver:
        started.append(Receiver(GnssConfig(device=device)))
        started[-1].start()
        return started[-1]

    yield start
    for receiver in started:
        receiver.close()


class Sentences:
    """A thread that writes a sentence a few times a second, each a second later by its own time."""

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        t = dt.datetime.now(dt.UTC).replace(microsecond=0)
        while not self._stopping.wait(0.05):
            t += dt.timedelta(seconds=1)
            try:
                self._write(gga(t, PLACE) + rmc(t))
            except OSError:
                continue


@pytest.mark.program("socat")
def test_a_cable_of_socat_is_pulled_and_put_back(
    tmp_path: Path, receivers: Callable[[str], Receiver], until: Until
) -> None:
    ends = [tmp_path / "receiver", tmp_path / "box"]
    command = ["socat", *(f"pty,raw,echo=0,link={end}" for end in ends)]
    receiver = receivers(str(ends[1]))
    for _ in range(2):
        with subprocess.Popen(command) as cable:
            try:
                assert until(lambda: all(end.exists() for end in ends), within_s=PATIENCE_S)
                descriptor = os.open(ends[0], os.O_WRONLY | os.O_NONBLOCK)
                with Sentences(lambda piece, to=descriptor: os.write(to, piece)):  # type: ignore[misc]
                    assert until(receiver.fix, within_s=PATIENCE_S)
                os.close(descriptor)
            finally:
                cable.terminate()
        assert until(lambda: receiver.status().state in (ReceiverState.LOST, ReceiverState.ABSENT), within_s=PATIENCE_S)
        assert receiver.fix() is None


@pytest.mark.program("str2str")
def test_a_stream_through_str2str(receivers: Callable[[str], Receiver], until: Until) -> None:
    with socket.create_server(("127.0.0.1", 0)) as source, socket.create_server(("127.0.0.1", 0)) as probe:
        out = probe.getsockname()[1]
        probe.close()
        command = ["str2str", "-in", f"tcpcli://127.0.0.1:{source.getsockname()[1]}", "-out", f"tcpsvr://:{out}"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as player:
            try:
                connection, _ = source.accept()
                with connection, Sentences(connection.sendall):
                    receiver = receivers(f"socket://127.0.0.1:{out}")
                    assert until(receiver.fix, within_s=PATIENCE_S)
                    surveyed = receiver.surveyed()
            finally:
                player.terminate()
    assert surveyed is not None
    assert surveyed.lat_deg == pytest.approx(PLACE.lat_deg, abs=1e-8)

"""The clock's bound, from each source, and from a real chronyd that follows a reference clock of ours."""

import ctypes
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge.clock.chrony import of_chrony, read_chrony
from edge.clock.kernel import STA_NANO, STA_UNSYNC, TIME_ERROR, Timex, of_kernel, read_kernel
from edge.clock.monitor import ClockMonitor, read_clock
from edge.clock.ptp import of_ptp
from edge.clock.settings import ClockConfig
from edge.clock.state import ClockState, check_clock
from tests.conftest import Until
from tests.edge import shm_clock

# As chronyc -c -n tracking prints it: refid, name, stratum, reference time, offset, last, RMS, frequency, residual,
# skew, root delay, root dispersion, interval, leap.
TRACKING = "C0A80101,192.168.1.1,2,1700000000.1,-0.000200,0.0,0.0,1.2,0.0,0.1,0.001000,0.000300,16.2,Normal\n"

PTP = """sending: GET TIME_STATUS_NP
\t001122.fffe.334455-0 seq 0 RESPONSE MANAGEMENT TIME_STATUS_NP
\t\tmaster_offset              -120
\t\tingress_time               1700000000000000000
\t\tgmPresent                  true
\t\tgmIdentity                 001122.fffe.000001
sending: GET CURRENT_DATA_SET
\t001122.fffe.334455-0 seq 1 RESPONSE MANAGEMENT CURRENT_DATA_SET
\t\tstepsRemoved     1
\t\toffsetFromMaster -120.0
\t\tmeanPathDelay    4000.0
"""


def test_chronys_bound_is_offset_and_dispersion_and_half_the_delay() -> None:
    state = of_chrony(TRACKING)
    assert state.bound_s == pytest.approx(0.0002 + 0.0003 + 0.0005)
    assert (state.source, state.synced) == ("chrony", True)


@pytest.mark.parametrize(
    "line",
    [
        TRACKING.replace("Normal", "Not synchronised"),
        "",
        "506 Cannot talk to daemon",
        TRACKING.replace("0.000300", "x"),
    ],
)
def test_a_chrony_without_a_source_has_no_bound(line: str) -> None:
    state = of_chrony(line)
    assert state.bound_s is None
    assert not state.synced
    assert state.action


def test_the_kernels_bound() -> None:
    assert ctypes.sizeof(Timex) == 208
    timex = Timex(maxerror=1500, offset=-200_000, status=STA_NANO)
    assert of_kernel(timex, 0).bound_s == pytest.approx(0.0017)
    assert of_kernel(timex, TIME_ERROR).bound_s is None
    assert of_kernel(Timex(maxerror=1500, status=STA_UNSYNC), 0).bound_s is None


def test_the_real_kernel_answers() -> None:
    state = read_kernel()
    assert state.source == "kernel"
    assert state.synced == (state.bound_s is not None)


def test_ptp() -> None:
    state = of_ptp(PTP)
    assert state.bound_s == pytest.approx(120e-9 + 2e-6 + 1e-5)
    assert of_ptp(PTP.replace("true", "false")).bound_s is None
    assert of_ptp("").bound_s is None


def test_a_grandmaster_that_was_chosen_and_not_yet_asked_bounds_nothing() -> None:
    """ptp4l shows an offset and a delay of zero until the first answer has come."""
    chosen = PTP.replace("offsetFromMaster -120.0", "offsetFromMaster 0.0").replace("4000.0", "0.0")
    state = of_ptp(chosen)
    assert (state.bound_s, state.reason) == (None, "ptp4l has measured nothing yet")
    assert of_ptp(PTP.replace("4000.0", "0.0")).bound_s is not None


@given(st.text(max_size=200))
def test_whatever_a_daemon_prints(text: str) -> None:
    for state in (of_chrony(text), of_ptp(text)):
        assert state.bound_s is None or state.bound_s >= 0
        assert state.reason


def test_an_infinite_or_negative_bound_is_none() -> None:
    for number in ("nan", "inf", "1e400", "-5"):
        assert of_chrony(TRACKING.replace("0.000300", number)).bound_s is None


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (ClockState(None, "kernel", False, "nobody disciplines it", "install chrony"), "fail"),
        (ClockState(0.02, "chrony", True, "within 20 ms"), "fail"),
        (ClockState(0.002, "chrony", True, "within 2 ms"), "ok"),
        (ClockState(0.002, "assumed", True, "assumed"), "warn"),
    ],
)
def test_the_check_fails_over_the_limit_and_without_a_bound(state: ClockState, level: str) -> None:
    check = check_clock(state, 0.01)
    assert check.level == level
    assert check.level != "fail" or check.action


def test_an_assumed_clock() -> None:
    state = read_clock(ClockConfig(source="assumed", assumed_bound_s=0.004))
    assert (state.bound_s, state.source) == (0.004, "assumed")


def test_the_monitor_starts_and_stops_at_once() -> None:
    monitor = ClockMonitor(ClockConfig(source="assumed", assumed_bound_s=0.004))
    monitor.start()
    assert monitor.bound_s() == 0.004
    assert monitor.state().steps == 0
    monitor.close()
    assert monitor.ended


@pytest.fixture
def reference() -> Iterator[int]:
    """The unit of a reference clock in shared memory that is 12 ms ahead of this machine."""
    unit = 64 + os.getpid() % 64
    memory, segment = shm_clock.attach(unit)
    stopping = threading.Event()

    def run() -> None:
        while not stopping.wait(0.2):
            shm_clock.tick(memory, 0.012)

    thread = threading.Thread(target=run)
    thread.start()
    yield unit
    stopping.set()
    thread.join()
    shm_clock.remove(segment)


@pytest.mark.program("chronyd")
def test_a_real_chronyd_that_follows_a_reference(reference: int, tmp_path: Path, until: Until) -> None:
    port = 20_000 + os.getpid() % 10_000
    configuration = tmp_path / "chrony.conf"
    configuration.write_text(
        f"refclock SHM {reference} poll 0 refid FAKE precision 1e-4\ncmdport {port}\nbindcmdaddress /\n"
        f"bindcmdaddress 127.0.0.1\nport 0\npidfile {tmp_path}/chrony.pid\n"
    )
    command = [str(shutil.which("chronyd")), "-x", "-d", "-u", "root", "-f", str(configuration)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as daemon:
        try:
            options = ("-h", "127.0.0.1", "-p", str(port))
            assert until(lambda: (state := read_chrony(*options)) and state.synced, within_s=20.0)
            state = read_chrony(*options)
        finally:
            daemon.terminate()
    assert state is not None
    assert state.bound_s is not None
    # -x leaves the clock alone, so the 12 ms stay; dispersion and delay are of the order of the precision.
    assert 0.011 < state.bound_s < 0.020
    assert check_clock(state, 0.01).level == "fail"


def test_without_chrony_the_kernel_is_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert read_chrony() is None
    assert read_clock(ClockConfig()).source == "kernel"
    assert sys.platform == "linux"

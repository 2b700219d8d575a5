"""Refusals are counted from Zenoh's own log lines, in whatever pieces they come."""

import subprocess
import sys

from hypothesis import given
from hypothesis import strategies as st

from edge.link.zenoh_log import LOG_CLOSE_S, MAX_REASONS, LogReader

# As Zenoh 1.10.2 writes them; the live test in test_link_security.py notices if that changes.
LINES = (
    b"\x1b[2m2026-11-22T07:06:28.04Z\x1b[0m TRACE rx-1 zenoh::net::routing::interceptor: Msg intercepted!\n"
    b"2026-11-22T07:06:29.24Z  WARN acc-0 \x1b[2mzenoh_link_tls::unicast\x1b[0m\x1b[2m:\x1b[0m invalid peer"
    b" certificate: BadSignature. Hint: increase the system open file limit.\n"
    b"2026-11-22T07:06:32.28Z  WARN acc-0 zenoh_link_tls::unicast: peer sent no certificates. Hint: increase it.\n"
    b"2026-11-22T07:06:28.02Z  WARN ThreadId(04) zenoh::net::routing::hat::peer: Gossip is disabled: cannot\n"
    b"2026-11-22T07:06:28.02Z  WARN ThreadId(04) zenoh_transport: something new\n"
)


@given(st.lists(st.integers(0, len(LINES)), max_size=8).map(sorted))
def test_counts_whatever_the_pieces(cuts: list[int]) -> None:
    reader, said = LogReader(), []
    for start, stop in zip([0, *cuts], [*cuts, len(LINES)], strict=True):
        said += reader.read(LINES[start:stop], now_s=0.0)
    assert (reader.refusals.messages, reader.refusals.handshakes) == (1, 2)
    assert reader.refusals.last_reason == "peer sent no certificates"
    assert len(said) == 3
    assert sum("something new" in line for line in said) == 1


def test_says_each_reason_once_a_minute_and_forgets_when_there_are_too_many() -> None:
    reader = LogReader()
    line = b"WARN zenoh_link_tls::unicast: certificate expired %d seconds ago. Hint: x\n"
    assert len(reader.read(line % 1, now_s=0.0)) == 1
    assert reader.read(line % 2, now_s=59.0) == []
    assert len(reader.read(line % 3, now_s=60.0)) == 1
    for number in range(MAX_REASONS * 3):
        word = "".join(chr(97 + int(digit)) for digit in str(number)).encode()
        reader.read(b"WARN zenoh_link_tls::unicast: " + word + b"\n", now_s=0.0)
    assert len(reader._reported_s) <= MAX_REASONS


@given(st.binary(max_size=300))
def test_reads_anything(garbage: bytes) -> None:
    LogReader().read(garbage + b"\n", now_s=0.0)


HEIR = """
import subprocess, sys, time
from edge.link.zenoh_log import ZenohLog
with ZenohLog() as log:
    heir = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    with open(1, "wb", closefd=False) as out:
        out.write(b"WARN zenoh_link_tls::unicast: late. Hint: x\\n")
    began_s = time.monotonic()
took_s = time.monotonic() - began_s
heir.stdin.close()
heir.wait()
print(took_s, log.ended, log.refusals.handshakes)
"""


def test_a_process_that_has_inherited_the_pipe_is_not_waited_for() -> None:
    told = subprocess.run([sys.executable, "-c", HEIR], capture_output=True, text=True, check=True)
    took_s, ended, handshakes = told.stdout.split()
    assert float(took_s) < LOG_CLOSE_S / 2, told.stderr
    assert (ended, handshakes) == ("True", "1"), "what was in the pipe is read to its end"

"""A receiver on a pty: heard by whoever opens it, lost on whoever does not, gone when it is pulled."""

import itertools
import os
import select
from pathlib import Path

import pytest

from tools.doubles.serial_receiver import SerialReceiver


def heard(device: str, enough: int) -> bytes:
    port = os.open(device, os.O_RDONLY | os.O_NOCTTY)
    try:
        said = b""
        while len(said) < enough and select.select([port], [], [], 5.0)[0]:
            said += os.read(port, 4096)
        return said
    finally:
        os.close(port)


def test_each_epoch_is_so_much_later_than_the_last_however_soon_it_comes() -> None:
    with SerialReceiver(lambda t: f"{t:%S} ".encode(), period_s=0.01, step_s=1.0) as receiver:
        seconds = [int(word) for word in heard(receiver.device, 60).split()[:-1]]
    assert all((after - before) % 60 == 1 for before, after in itertools.pairwise(seconds))


def test_a_line_that_nobody_reads_loses_what_it_says_and_goes_on() -> None:
    said = []

    def flood(_: object) -> bytes:
        said.append(1)
        return b"x" * 4096

    with SerialReceiver(flood, period_s=0.001, step_s=1.0) as receiver:
        assert receiver.device
        while len(said) < 20:  # a pty holds 4 KiB: all but the first are lost
            select.select([], [], [], 0.001)


def test_pulled_and_put_back_under_one_name(tmp_path: Path) -> None:
    receiver = SerialReceiver(lambda _: b"here ", period_s=0.01, link=tmp_path / "receiver")
    with pytest.raises(RuntimeError, match="not plugged in"):
        receiver.device  # noqa: B018
    for _ in range(2):
        receiver.plug()
        assert heard(str(tmp_path / "receiver"), 5).startswith(b"here")
        receiver.unplug()
        assert not (tmp_path / "receiver").exists()
    receiver.unplug()

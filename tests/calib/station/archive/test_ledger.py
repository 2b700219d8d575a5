"""The ledger never forgets a number it has, never asks for one on its way, and asks for every other."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.archive.ledger import Gap, Ledger
from calib.station.core.ranges import Ranges
from edge.messages import SpooledEpoch

pairs = st.tuples(st.integers(0, 60), st.integers(0, 12)).map(lambda pair: (pair[0], pair[0] + pair[1]))


def numbers(ranges: object) -> set[int]:
    return {n for first, last in ranges for n in range(first, last + 1)}  # type: ignore[attr-defined]


@given(st.lists(pairs, max_size=20), pairs)
def test_ranges_are_the_set_they_stand_for(added: list[tuple[int, int]], asked: tuple[int, int]) -> None:
    ranges = Ranges(added)
    assert numbers(ranges) == numbers(added)
    edges = [edge for pair in ranges for edge in pair]
    assert edges == sorted(edges)
    assert all(after - before > 1 for before, after in zip(edges[1::2], edges[2::2], strict=False)), "not merged"
    assert numbers(ranges.missing(*asked)) == numbers([asked]) - numbers(added)


def kept(epoch: int, first: int, last: int) -> SpooledEpoch:
    return SpooledEpoch(epoch=epoch, first_seq=first, last_seq=last, rows=last - first + 1)


def test_a_number_is_lacking_only_once_the_box_said_so_twice() -> None:
    ledger = Ledger()
    ledger.have("cam0", 7, 0, 9)
    assert ledger.gaps("cam0", [kept(7, 0, 20)]) == []
    assert ledger.gaps("cam0", [kept(7, 0, 25)]) == [Gap(7, 10, 20)]
    ledger.have("cam0", 7, 10, 18)
    assert ledger.gaps("cam0", [kept(7, 0, 25)]) == [Gap(7, 19, 25)]


def test_newest_run_first_and_every_camera_by_itself() -> None:
    ledger = Ledger()
    said = [kept(3, 0, 4), kept(9, 0, 2)]
    ledger.gaps("cam0", said)
    assert ledger.gaps("cam0", said) == [Gap(9, 0, 2), Gap(3, 0, 4)]
    assert ledger.gaps("cam1", said) == []


@given(st.lists(st.tuples(st.sampled_from(["a", "b"]), st.integers(0, 3), pairs), max_size=20))
def test_survives_being_saved(entries: list[tuple[str, int, tuple[int, int]]]) -> None:
    ledger = Ledger()
    for camera, epoch, (first, last) in entries:
        ledger.have(camera, epoch, first, last)
    assert Ledger.from_json(ledger.to_json()).to_json() == ledger.to_json()


def test_refuses_what_is_no_ledger() -> None:
    with pytest.raises(ValueError, match="invalid"):
        Ledger.from_json(b'{"cameras": {"cam0": {"x": []}}}')

"""Joining by time: whatever the order of arrival, whatever two talkers say at once."""

import datetime as dt

from hypothesis import given
from hypothesis import strategies as st

from edge.gnss.decoders import nmea, ubx
from edge.gnss.decoders.nmea import Gga, Gsa, Gst, Rmc, Zda
from edge.gnss.decoders.ubx import HighPrecision, Pvt
from edge.gnss.epoch import SILENCE_S, Epoch, EpochAssembler, Part


def gga(t_day_ms: int, quality: int = 4) -> Part:
    """A position sentence of that time."""
    return nmea.part(Gga(t_day_ms, 48.0, 11.0, quality, 12, 500.0, 47.0, 1.0, "", 7, 3))


def pvt(t_day_ms: int, itow_ms: int, *, resolved: bool = True) -> Part:
    """A navigation solution of that time."""
    return ubx.part(Pvt(t_day_ms, itow_ms, dt.date(2026, 6, 1), resolved, 4, 20, 48.0, 11.0, 547.0, 1.0))


def gst(t_day_ms: int) -> Part:
    """The receiver's own sigmas of that time."""
    return nmea.part(Gst(t_day_ms, (0.01, 0.01, 0.02)))


def high_precision(itow_ms: int) -> Part:
    """A precise position of that time of week."""
    return ubx.part(HighPrecision(itow_ms, 48.0, 11.0, 547.0, (0.01, 0.02)))


def test_a_sigma_that_comes_after_the_next_position_belongs_to_its_own() -> None:
    assembler = EpochAssembler()
    assert assembler.add(gga(1000), 0.0) == []
    assert assembler.add(gga(2000), 0.1) == []
    assert assembler.add(gst(1000), 0.2) == []
    (first,) = assembler.add(gga(3000), 0.3)
    assert (first.t_day_ms, first.parts["GST"].sigma_m) == (1000, (0.01, 0.01, 0.02))


def test_silence_closes_what_is_open() -> None:
    assembler = EpochAssembler()
    assembler.add(gga(1000), 5.0)
    assert assembler.idle(5.0 + 0.9 * SILENCE_S) == []
    assert [epoch.t_day_ms for epoch in assembler.idle(5.0 + 1.1 * SILENCE_S)] == [1000]
    assert assembler.idle(9.0) == []


def test_gps_time_finds_its_epoch_whichever_comes_first() -> None:
    precise = high_precision(77_000)
    for order in ((pvt(1000, 77_000), precise), (precise, pvt(1000, 77_000))):
        assembler = EpochAssembler()
        for record in order:
            assembler.add(record, 0.0)
        (epoch,) = assembler.flush()
        assert epoch.parts["NAV-HPPOSLLH"] == precise


def test_another_epochs_high_precision_is_not_taken() -> None:
    assembler = EpochAssembler()
    assembler.add(high_precision(76_000), 0.0)
    assembler.add(pvt(1000, 77_000), 0.0)
    assert set(assembler.flush()[0].parts) == {"NAV-PVT"}


def test_of_two_talkers_the_worse_counts() -> None:
    for order in ((gga(1000, 4), gga(1000, 5)), (gga(1000, 5), gga(1000, 4))):
        epoch = Epoch(1000)
        for record in order:
            epoch.add(record)
        assert epoch.parts["GGA"].quality == 5


def test_hundredths_and_thousandths_are_one_instant() -> None:
    assembler = EpochAssembler()
    assembler.add(gga(1250), 0.0)
    assembler.add(pvt(1250, 77_250), 0.0)
    assembler.add(gst(1249), 0.0)
    (epoch,) = assembler.flush()
    assert set(epoch.parts) == {"GGA", "NAV-PVT", "GST"}


def test_the_date_is_the_best_that_was_said() -> None:
    epoch = Epoch(1000)
    assert epoch.date is None
    epoch.add(nmea.part(Rmc(1000, True, dt.date(2026, 6, 3), "R")))
    assert epoch.date == dt.date(2026, 6, 3)
    epoch.add(nmea.part(Zda(1000, dt.date(2026, 6, 2))))
    assert epoch.date == dt.date(2026, 6, 2)
    epoch.add(pvt(1000, 77_000, resolved=False))
    assert epoch.date == dt.date(2026, 6, 2)
    epoch.add(pvt(1000, 77_000))
    assert epoch.date == dt.date(2026, 6, 1)


def test_dilution_has_no_time_and_goes_to_the_newest() -> None:
    assembler = EpochAssembler()
    assembler.add(nmea.part(Gsa(1.0)), 0.0)
    assembler.add(gga(1000), 0.0)
    assembler.add(gga(2000), 0.0)
    assembler.add(nmea.part(Gsa(1.5)), 0.0)
    assert [epoch.pdops for epoch in assembler.flush()] == [[], [1.5]]


@given(st.lists(st.tuples(st.integers(0, 20), st.booleans()), max_size=60))
def test_every_position_comes_out_once_and_no_more_than_two_stay(records: list[tuple[int, bool]]) -> None:
    assembler = EpochAssembler()
    closed: list[Epoch] = []
    for second, is_gga in records:
        record = gga(second * 1000) if is_gga else gst(second * 1000)
        closed += assembler.add(record, 0.0)
        assert len(assembler._open) <= 2
    closed += assembler.flush()
    said = {second * 1000 for second, is_gga in records if is_gga}
    assert {epoch.t_day_ms for epoch in closed if epoch.solutions} == said

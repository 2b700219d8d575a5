"""The reading thread: nothing of a recording is lost, the newest of a camera wins, the dead are opened again."""

from typing import Any

import numpy as np

from edge.capture.frame import Picture
from edge.capture.reader import Reader
from edge.common.errors import SourceError
from tests.edge.capture.sources import T0


class Scripted:
    """A source that follows a script of frames and errors."""

    live = True
    skipped = 0
    remarks = ()

    def __init__(self, script: list[Any]) -> None:
        self.script = list(script)

    def read(self) -> Picture | None:
        if not self.script:
            return None
        item = self.script.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def close(self) -> None:
        pass


def frame(k: int) -> Picture:
    return Picture(T0 + k, np.zeros((4, 4), np.uint8), "file")


DEAD = SourceError("dead", where="cam", action="look")


class TestReader:
    def test_recording_loses_nothing(self) -> None:
        reader = Reader("r", lambda: Scripted([frame(k) for k in range(50)]), live=False, lossless=True)
        reader.start()
        got = []
        while not reader.finished:
            if (one := reader.get(1.0)) is not None:
                got.append(one.t_unix_ns - T0)
        assert got == list(range(50))
        assert reader.state.dropped == 0

    def test_live_keeps_the_newest_and_counts_the_rest(self, until) -> None:
        reader = Reader("r", lambda: Scripted([frame(k) for k in range(50)]), live=False, lossless=False)
        reader.start()
        assert until(lambda: reader.state.ended)
        assert [reader.get(0).t_unix_ns - T0 for _ in range(2)] == [48, 49]
        assert (reader.state.frames, reader.state.dropped) == (50, 48)

    def test_dead_source_is_opened_again_as_another_segment(self) -> None:
        scripts = iter([[frame(0), DEAD], [frame(1)]])
        reader = Reader("r", lambda: Scripted(next(scripts, [])), live=True, lossless=False)
        reader.start()
        first, second = reader.get(5.0), reader.get(5.0)
        assert (first.segment, second.segment) == (0, 1)
        assert reader.state.reopened >= 1
        reader.ask_to_stop()
        assert reader.join(2.0)

    def test_recording_that_does_not_open_ends_with_its_error(self) -> None:
        def fail() -> Scripted:
            raise DEAD

        reader = Reader("r", fail, live=False, lossless=True)
        reader.start()
        assert reader.get(2.0) is None
        assert reader.finished
        assert reader.state.error is DEAD

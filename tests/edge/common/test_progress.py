"""How far a long command is: a line on a terminal, nothing elsewhere."""

import io

from edge.common.progress import Progress, bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_bar_says_how_far_and_how_fast() -> None:
    assert bar("cam0", 50, 200, 2.0) == f"cam0: [{'#' * 8}{'.' * 22}]  25%, 50 of 200, 25 a second"
    assert bar("cam0", 300, 200, 2.0).startswith(f"cam0: [{'#' * 30}] 100%")  # the file said less than it has
    assert bar("cam0", 50, 0, 2.0) == "cam0: 50, 25 a second"


def test_it_is_drawn_on_a_terminal_alone_and_gone_at_the_end(monkeypatch) -> None:
    seconds = iter(range(100))
    monkeypatch.setattr("time.monotonic", lambda: float(next(seconds)))
    for out, drawn in ((Terminal(), True), (io.StringIO(), False)):
        with Progress("pictures", 10, out) as progress:
            progress.at(3)
            assert ("3 of 10" in out.getvalue()) == drawn
        assert out.getvalue().endswith("\r\x1b[K") == drawn

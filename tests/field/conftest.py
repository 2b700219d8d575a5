"""One bad day of a site in namespaces, lived through once, for all the tests that look at it."""

import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tools.doubles.air import Air, possible
from tools.doubles.heard import Row, live_again_after
from tools.doubles.site import CAMERAS, PATIENCE_S, Made, Site, demo_flight, wait

CUT_S = 5.0
FETCHED_WITHIN_S = 30.0  # two inventories and ten answers, each with its rest, take about 5 s, longer on a busy machine


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's flight as a track folder."""
    return demo_flight(tmp_path_factory.mktemp("flight") / "demo")


@dataclass
class BadDay:
    """When what happened, in UTC seconds, and what was there in the evening."""

    settled_unix_s: float = 0.0
    restored_unix_s: float = 0.0  # cam1 had been cut off for 5 s
    made_in_cut: Made = field(default_factory=set)  # what it saw meanwhile
    storm_unix_s: tuple[float, float] = (0.0, 0.0)  # 5 % loss, 50 ms +- 20 ms
    thawed_unix_s: float = 0.0  # the base had been frozen for 5 s
    killed_unix_s: float = 0.0  # cam2 and the base: kill -9, started again
    shutdown_s: dict[str, float] | None = None
    made: Made | None = None
    rows: tuple[Row, ...] = ()

    lost_inside: Made = field(default_factory=set)  # what no recording has, but for the ends of runs


@pytest.fixture(scope="session")
def bad_day(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> BadDay:
    """The day. Skips where this machine does not allow namespaces."""
    if reason := possible():
        pytest.skip(reason)
    day = BadDay()
    with Air("base", *CAMERAS) as air:
        site = Site(air, tmp_path_factory.mktemp("site"), flight)
        try:
            site.settle()
            _live(day, site)
            day.shutdown_s = site.stop()
        finally:
            site.bury()
        day.made, day.rows = site.made(), tuple(site.recorded())
        day.lost_inside = site.lost_inside(day.made)
    return day


def _live(day: BadDay, site: Site) -> None:
    day.settled_unix_s = time.time()
    site.air.set(cut=("cam1",))
    time.sleep(CUT_S)
    day.restored_unix_s = time.time()
    site.air.set()
    wait(lambda: live_again_after(site.recorded(), "cam1", day.restored_unix_s) < float("inf"), 10.0)
    time.sleep(1.0)
    site.air.set(loss=0.05, delay_s=0.05, jitter_s=0.02)
    begun = time.time()
    time.sleep(5.0)
    day.storm_unix_s = (begun + 0.5, time.time() - 0.5)
    site.air.set()
    site.send("base", signal.SIGSTOP)
    time.sleep(5.0)
    day.thawed_unix_s = time.time()
    site.send("base", signal.SIGCONT)
    time.sleep(2.0)
    # How much of the cut has come by now is chance: it hangs on when the base asked for inventories, and a question
    # that was open when the base froze costs two seconds of rest. What is judged is that all of it comes.
    day.made_in_cut = site.made_between(day.settled_unix_s, day.restored_unix_s, "cam1")
    wait(lambda: not site.lost(day.made_in_cut), FETCHED_WITHIN_S)
    day.killed_unix_s = time.time()
    for host in ("cam2", "base"):
        site.kill(host)
        time.sleep(0.3)
        site.start(host)
    started_ns = time.time_ns()
    wait(lambda: set(CAMERAS) <= site.heard.live_since(started_ns), PATIENCE_S)
    time.sleep(1.0)  # what was made until the base heard again is no end of a run now
    made = site.made()
    wait(lambda: not site.lost_inside(made), 60.0)

"""What makes a station itself be at fault, and what does not."""

import pytest

from calib.station.standing import STALLED_NS, LoopWatch, disk_checks, fault_of
from edge.common.health import Check


def test_a_loop_that_stood_still_is_a_fault_until_it_was_asked_once() -> None:
    loop = LoopWatch(0)
    for now_ns in range(0, 10**9, 2 * 10**7):
        loop.turned(now_ns)
    assert loop.check().level == "ok"
    loop.turned(10**9 + STALLED_NS)
    loop.turned(10**9 + STALLED_NS + 1)
    found = loop.check()
    assert (found.level, found.reason) == ("fail", "stood still for 1.0 s")
    assert fault_of([found]) == "loop: stood still for 1.0 s"
    assert loop.check().level == "ok"


@pytest.mark.parametrize(("name", "level"), [("camera cam0", "fail"), ("security", "fail"), ("link", "warn")])
def test_what_does_not_keep_the_station_from_its_work_is_no_fault_of_it(name: str, level: str) -> None:
    assert fault_of([Check(name, level, "why")]) == ""  # type: ignore[arg-type]


def test_a_link_that_is_not_open_is() -> None:
    assert fault_of([Check("disk", "warn", "full"), Check("link", "fail", "no port")]) == "link: no port"


def test_only_disks_that_fail_are_named() -> None:
    assert [check.name for check in disk_checks(disk="", recording="full")] == ["recording"]

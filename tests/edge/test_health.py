"""A fault shows at once, goes only when it has stayed away, and says since when."""

from edge import __version__
from edge.common.health import Check
from edge.health import HealthBoard

SECOND = 10**9
T0 = 1_700_000_000 * SECOND


def test_worst_level_wins_and_empty_is_ok() -> None:
    board = HealthBoard(epoch=1)
    assert board.update(T0, [], {}).level == "ok"
    checks = [Check("a", "ok", "fine"), Check("b", "fail", "gone", "plug it in"), Check("c", "warn", "slow")]
    health = board.update(T0, checks, {"n": 3})
    assert health.level == "fail"
    assert health.counters == {"n": 3}
    assert next(item for item in health.items if item.name == "b").action == "plug it in"


def test_fault_keeps_the_instant_it_began_while_its_reason_changes() -> None:
    board = HealthBoard(epoch=1)
    board.update(T0, [Check("a", "fail", "no frame for 2 s")], {})
    item = board.update(T0 + 5 * SECOND, [Check("a", "fail", "no frame for 7 s")], {}).items[0]
    assert (item.since_unix_ns, item.reason) == (T0, "no frame for 7 s")


def test_flicker_does_not_clear_a_fault() -> None:
    board = HealthBoard(epoch=1)
    good, bad = Check("a", "ok", "fine"), Check("a", "warn", "late")
    levels = []
    for k, check in enumerate([bad, good, bad, good, good, good, good]):
        levels.append(board.update(T0 + k * SECOND, [check], {}).items[0].level)
    assert levels == ["warn"] * 6 + ["ok"]


def test_worsening_is_shown_at_once_and_dated_anew() -> None:
    board = HealthBoard(epoch=1)
    board.update(T0, [Check("a", "warn", "late")], {})
    item = board.update(T0 + SECOND, [Check("a", "fail", "dead")], {}).items[0]
    assert (item.level, item.since_unix_ns) == ("fail", T0 + SECOND)


def test_a_box_that_is_told_the_time_dates_its_faults_by_it() -> None:
    """It started in 1970, the fault began 5 s later, and 10 s after that UTC came."""
    board, fault = HealthBoard(epoch=1), [Check("clock", "fail", "no time daemon")]
    board.update(5 * SECOND, fault, {}, now_ns=105 * SECOND)
    item = board.update(T0, fault, {}, now_ns=115 * SECOND).items[0]
    assert item.since_unix_ns == T0 - 10 * SECOND


def test_a_step_of_utc_neither_clears_a_fault_nor_keeps_one() -> None:
    for step in (-100 * SECOND, 100 * SECOND):
        board = HealthBoard(epoch=1)
        board.update(T0, [Check("a", "fail", "gone")], {}, now_ns=0)
        good = [Check("a", "ok", "fine")]
        assert board.update(T0 + SECOND, good, {}, now_ns=SECOND).items[0].level == "fail"
        assert board.update(T0 + step + 2 * SECOND, good, {}, now_ns=2 * SECOND).items[0].level == "fail"
        assert board.update(T0 + step + 9 * SECOND, good, {}, now_ns=9 * SECOND).items[0].level == "ok"


def test_every_health_says_which_version_it_is_of() -> None:
    assert HealthBoard(epoch=1).update(T0, [], {}).version == __version__

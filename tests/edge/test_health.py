"""A fault shows at once, goes only when it has stayed away, and says since when."""

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

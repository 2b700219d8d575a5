"""The page's door: who stands there without asking makes room, and everybody's time ends."""

import random

from calib.station.page.door import ANSWERED_S, ASKS_S, MOST_AT_DOOR, MOST_OF_ONE, Door


class Connection:
    """A transport that knows whether it was ended."""

    def __init__(self) -> None:
        self.ended = False

    def is_closing(self) -> bool:
        return self.ended

    def abort(self) -> None:
        self.ended = True


def test_slow_ones_of_one_address_do_not_keep_an_honest_one_out() -> None:
    door = Door()
    slow = [Connection() for _ in range(1100)]
    for k, one in enumerate(slow):
        door.came(("10.0.0.1", k), one, 0.0)
    assert len(door) == MOST_OF_ONE
    honest, elsewhere = Connection(), Connection()
    door.came(("10.0.0.1", 5000), honest, 1.0)
    door.came(("10.0.0.2", 5000), elsewhere, 1.0)
    door.asked(("10.0.0.1", 5000), "watching", 1.1)
    for k in range(1100):
        door.came(("10.0.0.1", 6000 + k), Connection(), 2.0)
    assert not honest.ended, "it has asked: the silent ones go first"
    assert not elsewhere.ended


def test_of_many_addresses_so_many_at_most() -> None:
    door = Door()
    for k in range(5000):
        door.came((f"10.0.{k >> 8}.{k & 255}", 1), Connection(), 0.0)
    assert len(door) == MOST_AT_DOOR
    assert door.turned_away == 5000 - MOST_AT_DOOR


def test_each_stage_has_its_time() -> None:
    door = Door()
    silent, asking, watching, again = (Connection() for _ in range(4))
    for k, one in enumerate((silent, asking, watching, again)):
        door.came(("10.0.0.1", k), one, 0.0)
    door.asked(("10.0.0.1", 1), "asking", 1.0)
    door.asked(("10.0.0.1", 2), "watching", 1.0)
    door.asked(("10.0.0.1", 3), "asking", 1.0)
    door.answered(("10.0.0.1", 3), 4.0)
    door.sweep(ASKS_S + 1.5)
    assert (silent.ended, asking.ended, watching.ended, again.ended) == (True, False, False, False)
    door.sweep(4.0 + ASKS_S + 0.1)
    assert again.ended
    door.sweep(ANSWERED_S + 1.5)
    assert (asking.ended, watching.ended) == (True, False)


def test_whatever_happens_it_holds_no_more_than_it_may_and_forgets_who_is_gone() -> None:
    draw = random.Random(7)
    door, known = Door(), list[tuple[tuple[str, int], Connection]]()
    for k in range(4000):
        client, one = (f"10.0.0.{draw.randrange(6)}", k), Connection()
        door.came(client, one, k / 50)
        known.append((client, one))
        other, connection = draw.choice(known)
        draw.choice(
            [
                connection.abort,
                lambda other=other, k=k: door.asked(other, draw.choice(["asking", "watching"]), k / 50),
                lambda other=other, k=k: door.answered(other, k / 50),
                lambda k=k: door.sweep(k / 50),
            ]
        )()
        assert len(door) <= MOST_AT_DOOR
    assert len(door) == sum(not one.ended for _, one in known)

"""MAVLink at a real base: forged, replayed and future-dated commands do nothing; a radio that hangs holds up nobody.

The long versions, with every attack and the figures, are tools.bench.mavlink_forgery and mavlink_stuck.
"""

import random
import time
from contextlib import ExitStack
from pathlib import Path

from tests.conftest import Until
from tools.doubles.base import TrackingBase
from tools.doubles.forger import attacks, trial
from tools.doubles.listener import Listener
from tools.doubles.radio import Radio

ATTACK = "another key, 50 years ahead"  # the others: the bench, and tests/calib/station/outputs
STOPS_WITHIN_S = 2.5  # half a second, and what a busy machine takes to end a program; promised are 3


def test_no_forged_or_replayed_command_is_acted_on_and_the_operator_is_still_obeyed(tmp_path: Path) -> None:
    chance = random.Random(4)
    with trial(tmp_path) as one:
        one.attack(ATTACK, 10, attacks(chance)[ATTACK])
        one.restart()
        one.attack("replayed after a restart", 10, lambda _: chance.choice(one.obeyed))
        items = {item["name"]: item for item in one.base.status()["health"]["items"]}
        assert one.failures == 0, "see the table above"
        assert items["mavlink commands"]["level"] == "warn"


def test_a_radio_that_hangs_costs_others_nothing_and_does_not_hold_up_the_end(tmp_path: Path, until: Until) -> None:
    with ExitStack() as stack:
        radio, ear = stack.enter_context(Radio()), stack.enter_context(Listener())
        urls = [f"serial:{radio.device}:57600", ear.url]
        base = TrackingBase(tmp_path, [{"url": url, "profile": ["gcs", "ecef"]} for url in urls])
        stack.callback(base.kill)
        base.start()
        base.wait_until_up()
        stack.enter_context(base.boxes())
        assert ear.wait(10, 60.0), base.log()
        radio.stick()
        assert until(lambda: "does not take" in base.health()[f"mavlink {urls[0]}"][1], 20.0)
        assert ear.wait(len(ear.positions) + 20, 20.0), "the other one hears all the time"
        assert ear.missing == 0
        began_s = time.monotonic()
        assert base.stop() == 0, base.log()
        assert time.monotonic() - began_s < STOPS_WITHIN_S
        assert "left to the process's end" not in base.log()

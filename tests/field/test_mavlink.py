"""MAVLink at a real base: forged, replayed and future-dated commands do nothing; who comes an hour late is heard; a
radio that hangs holds up nobody.

The long versions, with every attack and the peers' figures, are tools.bench.mavlink_forgery, _peers and _stuck.
"""

import random
import shutil
import time
from contextlib import ExitStack
from pathlib import Path

from tests.conftest import Until
from tests.foreign import required
from tools.doubles.base import TrackingBase
from tools.doubles.forger import attacks, trial
from tools.doubles.listener import Listener
from tools.doubles.peers import Peers, dissected, has_wireshark
from tools.doubles.peers_at_base import KINDS, Hour
from tools.doubles.radio import Radio

ATTACK = "another key, 50 years ahead"  # the others: the bench, and tests/calib/station/outputs
STOPS_WITHIN_S = 2.5  # half a second, and what a busy machine takes to end a program; promised are 3
TOLD_TWICE = 2  # what is on its way when the counting begins and ends


def test_no_forged_or_replayed_command_is_acted_on_and_the_operator_is_still_obeyed(tmp_path: Path) -> None:
    chance = random.Random(4)
    with trial(tmp_path) as one:
        one.attack(ATTACK, 10, attacks(chance)[ATTACK])
        one.restart()
        one.attack("replayed after a restart", 10, lambda _: chance.choice(one.obeyed))
        items = {item["name"]: item for item in one.base.status()["health"]["items"]}
        assert one.failures == 0, "see the table above"
        assert items["mavlink commands"]["level"] == "warn"


def test_who_starts_an_hour_after_the_base_takes_what_it_signs(tmp_path: Path) -> None:
    found = shutil.which("mavproxy.py")  # counted too where it is installed; stock pymavlink always
    peers = Peers(Path(found).parents[1] if found else Path("nowhere"), tmp_path)
    with ExitStack() as stack:
        hour = Hour(stack, peers, tmp_path)
        taken, stock = hour.measure(5.0)
        sent = taken["sent"]
        assert sent["TARGET_TRACK_ECEF"] > 40, "the base tracks"
        assert taken["pymavlink, stock"]["BAD_DATA"] == 0
        for kind in KINDS:
            assert abs(taken["pymavlink, stock"][kind] - sent[kind]) <= TOLD_TWICE, kind
        if found:
            for kind in KINDS[:3]:
                assert abs(taken["MAVProxy"][kind] - sent[kind]) <= TOLD_TWICE, kind
                assert taken["stranger"][kind] == 0, "MAVProxy with another key"
            assert taken["MAVProxy"]["others"] == 0 < stock, "a sender that does not refresh its time"
        datagrams = hour.tap.datagrams
    if has_wireshark() or required():
        shown = dissected(datagrams, tmp_path)
        assert shown["45000"] >= 20
        assert sum(shown.values()) == len(datagrams), "Wireshark reads every frame"


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

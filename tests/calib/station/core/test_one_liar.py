"""One camera of a site that lies: what is sent stays within what it claims, and nobody honest is named.

All lies, and three and six cameras, are `python -m tools.bench.liars`.
"""

import msgspec
import pytest

from edge.messages import Fix, Lens, Tracks
from tools.doubles.box_messages import messages
from tools.doubles.flight import Spec, make
from tools.doubles.liars import LIAR, LIES, Liar, Lie
from tools.doubles.lying_site import run

TYPES = {"tracks": Tracks, "lens": Lens, "fix": Fix}
BY_NAME = {lie.name: lie for lie in LIES}
# Of positions in a row few are independent: beyond one in a hundred it is no chance.
BEYOND = 0.01


@pytest.mark.parametrize("name", ["u_px + 20, clock_bound_s 1e6", "fix 3 m too high"])
def test_a_site_of_four_stays_honest(name: str) -> None:
    """In a square a height that is off looks like any other three: nothing is sent then, and all are named."""
    out = run(BY_NAME[name], cameras=4, seed=0)
    assert out.nees or "these cannot be told apart" in out.said
    assert out.beyond < BEYOND, out.said
    assert out.innocents == []


def test_of_three_nobody_else_knows_where_one_stands_and_that_is_said() -> None:
    """Three metres of two hundred are within a lens file's one per cent: positions are sent, and none as verified."""
    out = run(BY_NAME["fix 3 m too far north, sigma_m 0.001"], cameras=3, seed=0, flight_s=30.0)
    assert len(out.nees) > 100
    assert out.whole == []
    assert "nobody checks the word of cam0, cam1, cam2" in out.said


@pytest.mark.parametrize("lie", LIES, ids=lambda lie: lie.name)
def test_every_lie_is_a_valid_message_and_one_cameras_own(lie: Lie) -> None:
    scene, liar = make(Spec(cameras=3, uavs=1, rate_hz=2.0, duration_s=50.0)), Liar(lie)
    told = changed = 0
    for sent in messages(scene):
        for said in liar(sent):
            message = msgspec.json.decode(said.payload, type=TYPES[said.key.rpartition("/")[2]])
            told += 1
            if f"/{LIAR}/" not in said.key:
                assert said == sent
            # A lie that grows is said again each second, beside the frames.
            changed += said.key != sent.key or message != msgspec.json.decode(sent.payload, type=type(message))
    assert told > 100
    assert (changed > 0) == (lie.name != LIES[0].name)

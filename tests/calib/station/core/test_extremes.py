"""Valid messages with extreme values, of one camera among four: nothing ends, and the others' positions go on."""

import random
import re
from collections.abc import Iterator

import msgspec
import pytest

from edge.messages import Fix, Health, HealthItem, Lens, Tracks, camera_key, encode
from tests.calib.station.core.test_bad_input import SHORT, Feed, still_works
from tools.doubles.box_messages import SITE, Sent
from tools.doubles.extremes import Extremes

TYPES: dict[str, type[msgspec.Struct]] = {"tracks": Tracks, "lens": Lens, "fix": Fix}
# Kept honest most of the time: what leaps in them is refused as a whole, and nothing behind it would be tried.
NUMBERS = ("epoch", "seq", "t_unix_ns")
HEALTH = Health(
    t_unix_ns=0,
    epoch=1,
    level="ok",
    items=[HealthItem(name="camera", level="ok", since_unix_ns=0, reason="sends frames")],
    counters={"frames": 1.0},
)


@pytest.mark.parametrize("seed", range(6))
def test_one_camera_says_what_it_likes(feed: Feed, seed: int) -> None:
    extremes = Extremes(random.Random(seed))
    draw = extremes.draw

    def changed(sent: Sent) -> Iterator[Sent]:
        topic = sent.key.rpartition("/")[2]
        if sent.key != camera_key(SITE, "cam3", topic) or draw.random() < 0.3:
            yield sent
            return
        honest = msgspec.json.decode(sent.payload, type=TYPES[topic])
        said = extremes.of(honest, draw.choice([1, 2, 4]))
        if topic == "tracks" and draw.random() < 0.99:
            said = msgspec.structs.replace(said, **{name: getattr(honest, name) for name in NUMBERS})
        yield sent._replace(payload=encode(said))
        if draw.random() < 0.02:
            yield sent._replace(key=camera_key(SITE, "cam3", "health"), payload=encode(extremes.of(HEALTH)))

    still_works(feed(SHORT, changed))


@pytest.mark.parametrize("kind", [Tracks, Lens, Fix, Health])
def test_every_field_of_every_type_is_drawn_at_its_ends(kind: type[msgspec.Struct]) -> None:
    """The generator reaches what it says it does, and what it makes is valid."""
    honest: dict[type[msgspec.Struct], msgspec.Struct] = {
        Health: HEALTH,
        Fix: Fix(
            t_unix_ns=1_800_000_000 * 10**9,
            lat_deg=47.0,
            lon_deg=8.0,
            height_m=500.0,
            quality=4,
            sigma_m=(0.01, 0.01, 0.02),
            frame="WGS 84",
            samples=100,
        ),
        Lens: Lens(
            model="radtan",
            intrinsics=(1300.0, 1300.0, 959.5, 539.5),
            distortion=[-0.1, 0.02, 0.0, 0.0],
            rms_px=0.3,
            size_px=(1920, 1080),
        ),
        Tracks: Tracks(
            t_unix_ns=1_800_000_000 * 10**9,
            seq=1,
            epoch=1,
            clock_bound_s=0.001,
            size_px=(1920, 1080),
            readout_s=0.0,
            detections=[],
        ),
    }
    extremes = Extremes(random.Random(1))
    seen: dict[str, set[object]] = {}
    for _ in range(600):
        said = extremes.of(honest[kind], 1)
        assert msgspec.json.decode(encode(said), type=kind) == said
        for field in kind.__struct_fields__:
            seen.setdefault(field, set()).add(repr(getattr(said, field)))
    unchanging = {field for field, values in seen.items() if len(values) < 2}
    assert unchanging <= {"detections", "model"}, "a list of nothing stays empty; a lens's name is checked by its lens"
    assert any(re.search("e-3[0-9]{2}", value) for value in seen.get("rms_px", {"1e-300"}) if isinstance(value, str))

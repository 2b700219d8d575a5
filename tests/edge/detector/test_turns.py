"""Where more moves than can be looked at, each place has its turn, and who waits too long is counted."""

import numpy as np
import pytest

from edge.detector.turns import Turns

FRAME_NS = 33_000_000


@pytest.mark.parametrize("seed", range(20))
def test_every_place_is_looked_at_within_half_a_second(seed: int) -> None:
    rng = np.random.default_rng(seed)
    room, count = int(rng.integers(2, 5)), int(rng.integers(9, 31))
    regions = np.column_stack([np.arange(count) * 40.0 + 16, rng.uniform(0, 700, count), np.full(count, 6.0)])
    turns, looked = Turns(), {}
    for frame in range(60):
        t_ns = frame * FRAME_NS + 10**18
        shown = regions[rng.permutation(count)] if frame % 2 else regions  # strength changes the order they come in
        ordered = turns.order(shown, t_ns)
        assert sorted(ordered[:, 0].tolist()) == regions[:, 0].tolist()
        turns.look(ordered, room, t_ns)
        for u in ordered[:room, 0].tolist():
            looked.setdefault(u, []).append(frame)
    assert len(looked) == count, f"seed {seed}"
    longest = max(int(np.diff([0, *frames, 60]).max()) for frames in looked.values())
    assert longest <= -(-count // room) + 1, f"seed {seed}"
    if count / room * FRAME_NS < 450_000_000:
        assert turns.late == 0


def test_who_waits_too_long_is_counted() -> None:
    regions = np.column_stack([np.arange(100) * 40.0, np.zeros(100), np.full(100, 6.0)])
    turns = Turns()
    for frame in range(60):
        turns.look(turns.order(regions, frame * FRAME_NS + 10**18), 1, frame * FRAME_NS + 10**18)
    assert turns.late > 0

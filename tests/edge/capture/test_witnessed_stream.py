"""No stamp of a stream lies outside its stated bound, however the stream, its sender or the network lie."""

import numpy as np
import pytest

from edge.capture.witnessed_stream import StreamStamp, WitnessedStream
from edge.common.utc import Dated
from tools.doubles.streams import UTC_NS, StreamScene, mixtures, scenes, uneven

SECONDS = 45.0


def dated(monotonic_ns: int) -> Dated:
    return Dated(monotonic_ns + UTC_NS, 0.0)


def run(scene: StreamScene, seed: int) -> tuple[WitnessedStream, list[tuple[float, StreamStamp]]]:
    """The clock after it, and the error, s, of each stamp."""
    clock, stamps = WitnessedStream(), []
    for frame in scene.frames(SECONDS, np.random.default_rng(seed)):
        stamp = clock.stamp(frame.stream_ns, frame.arrival_ns, frame.sent_unix_ns, dated)
        stamps.append(((stamp.t_unix_ns - frame.true_unix_ns) / 1e9, stamp))
    return clock, stamps


@pytest.mark.parametrize("seed", range(20))
def test_no_stamp_is_outside_its_bound(seed: int) -> None:
    twice = mixtures(seed) | uneven(seed) if seed < 8 else {}
    for name, scene in (scenes(seed) | twice).items():
        _, stamps = run(scene, seed)
        outside = [error for error, stamp in stamps if stamp.bound_s is not None and abs(error) > stamp.bound_s]
        assert not outside, f"seed {seed}, {name}: {len(outside)} of {len(stamps)}, {max(outside, key=abs):.3f} s"
        assert sum(stamp.bound_s is not None for _, stamp in stamps) > len(stamps) * (0.7 if name in twice else 0.8), (
            f"seed {seed}, {name}"
        )


@pytest.mark.parametrize("seed", range(5))
def test_a_healthy_sender_keeps_its_five_milliseconds(seed: int) -> None:
    for name in ("true, reports", "drifting, reports"):
        clock, stamps = run(scenes(seed)[name], seed)
        bounds = [stamp.bound_s for _, stamp in stamps if stamp.bound_s is not None]
        assert np.median(bounds) == 0.005
        assert np.percentile(bounds, 95) < 0.02
        assert clock.remarks == []


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("counted", "runs at"),
        ("fallen", "jumped by -"),
        ("risen", r"jumped by \+"),
        ("strays, reports", "dated"),
        ("clock ahead", "after they arrive"),
        ("clock behind", "before they arrive"),
        ("clock a little behind", "before frames arrive"),
    ],
)
def test_what_contradicts_is_said_with_its_number(name: str, said: str) -> None:
    scene = next(scenes(seed)[name] for seed in range(9) if abs(scenes(seed)["counted"].stream_s(25, 0.0) - 1) > 0.3)
    clock, stamps = run(scene, 3)
    assert any(np.array([said.replace("\\", "") in remark.what for remark in clock.remarks])), clock.remarks
    assert stamps[-1][1].bound_s is not None
    assert all(remark.action for remark in clock.remarks)


def test_after_the_lie_is_known_stamps_are_good_again() -> None:
    for name in ("counted", "fallen", "risen, reports", "clock ahead", "clock behind"):
        _, stamps = run(scenes(1)[name], 1)
        assert max(abs(error) for error, _ in stamps[len(stamps) * 3 // 4 :]) < 0.15, name

"""A day of traffic through the station's core, as fast as it goes: memory, false alarms, false targets.

    python -m tools.bench.station_day --hours 24 --cameras 4 --rate 6

One seeded scene is flown over and over, its time moved on each round, its track numbers new each round. Where one
round ends and the next begins all objects jump, so that targets are lost and born all day. The cameras are as exact as
the network says and nothing happens to them: every accusation is a false alarm, and every confirmed target far from
all objects for longer than a second is a false one. StoredState is the process's own, once a simulated hour.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from calib.station.core.calibration import reduced
from calib.station.core.jobs import Solved, SolveResult
from calib.station.core.station import Station, Tick
from edge.messages import camera_key, encode
from tools.bench.station_tracking import Watch
from tools.doubles.box_messages import EPOCH, SITE, Sent, seen_frames, state_messages
from tools.doubles.core_station import station_for
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make
from tools.doubles.tracks import tracks_message

ROUND_S = 300.0
WARM_H = 1.0  # hours until the window is full and every buffer has its size
LABELS = 1_000_000  # track numbers a round
NS = 10**9


@dataclass
class Day:
    """What was seen of a station in a day."""

    station: Station
    scene: Scene
    accused: list[tuple[float, str]] = field(default_factory=list)
    false: int = 0
    births: int = 0
    resident_mb: list[float] = field(default_factory=list)


def stream(scene: Scene, rounds: int) -> Iterator[tuple[int, Sent]]:
    """(round, message) in the order of arrival."""
    yield from ((0, sent) for sent in state_messages(scene))
    once = list(seen_frames(scene, frames(scene)))
    for number in range(rounds):
        later_ns = round(number * ROUND_S * NS)
        for k, (arrival_ns, name, camera, seen) in enumerate(once):
            moved = replace(seen, t_unix_ns=seen.t_unix_ns + later_ns, labels=seen.labels + number * LABELS)
            seq = number * len(once) + k  # gaps in a camera's numbers are counted, and no more
            message = tracks_message(camera, EPOCH, seq, moved)
            yield number, Sent(arrival_ns + later_ns, camera_key(SITE, name, "tracks"), encode(message))


def play(spec: Spec, hours: float) -> Day:
    """Feed a calibrated station with hours of a scene."""
    scene = make(spec)
    day = Day(station_for(scene), scene)
    day.station.adopt(scene.network)
    rounds, hour, watch = round(hours * 3600 / ROUND_S), -1, Watch(scene)
    for number, sent in stream(scene, rounds):
        day.station.handle(sent.key, sent.payload, sent.arrival_ns)
        tick = day.station.tick(sent.arrival_ns)
        if tick.publish:
            watch = _look(day, watch, number, sent.arrival_ns)
            _answer(day, tick, (sent.arrival_ns - T0_UNIX_NS) / NS)
        if number * ROUND_S // 3600 > hour:
            hour += 1
            day.resident_mb.append(resident_mb())
            print(
                f"{hour:4d} h  {day.resident_mb[-1]:.1f} MB, accused {len(day.accused)}, false {day.false}", flush=True
            )
    day.false += len(watch.false)
    day.resident_mb.append(resident_mb())
    return day


def _look(day: Day, watch: Watch, number: int, now_ns: int) -> Watch:
    """Compare all targets with the truth; at the seam of two rounds with nothing."""
    tracker, at_s = day.station.tracker, (now_ns - T0_UNIX_NS) / NS - number * ROUND_S
    if at_s < 4.0:  # targets of the last round are still coasting
        day.false += len(watch.false)
        return Watch(day.scene)
    if tracker is not None:
        shift_ns = round(number * ROUND_S * NS)
        found = [replace(e, t_unix_ns=e.t_unix_ns - shift_ns) for e in tracker.estimates(tracker.newest_s)]
        watch.look(found, at_s)
    return watch


def _answer(day: Day, tick: Tick, at_s: float) -> None:
    """Note accusations, and answer a wish for solving as the solver would, with what is true."""
    named = {camera for _, camera in day.accused if camera}
    day.accused += [(at_s, camera) for camera in day.station.calibration.suspects.keys() - named]
    if tick.job is not None:
        known = {camera.id for camera in tick.job.scene.cameras}
        day.station.solved(SolveResult(tick.job.number, Solved(reduced(day.scene.network, known), 0.1), None, 1.0))


def resident_mb() -> float:
    """Memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    """One line an hour, then the day."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--rate", type=float, default=6.0)
    parser.add_argument("--uavs", type=int, default=2)
    parser.add_argument("--birds", type=int, default=2)
    parser.add_argument("--clutter", type=float, default=0.3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    spec = Spec(
        cameras=options.cameras,
        rate_hz=options.rate,
        uavs=options.uavs,
        birds=options.birds,
        duration_s=ROUND_S,
        dropout=0.1,
        clutter=options.clutter,
        seed=options.seed,
    )
    began = time.monotonic()
    day = play(spec, options.hours)
    settled = np.array(day.resident_mb[int(WARM_H) :])
    print(f"seed {options.seed}, {options.hours:g} simulated hours in {(time.monotonic() - began) / 60:.1f} min")
    growth = settled[-1] / settled[0] - 1
    print(f"memory {settled[0]:.1f} MB after {WARM_H:g} h, {settled[-1]:.1f} at the end: {growth:+.1%}")
    print(f"false alarms of the guard {len(day.accused)}: {day.accused[:5]}")
    counted = day.station.tracker.counters if day.station.tracker is not None else {}
    print(f"false confirmed targets {day.false}; {dict(counted)}; {msgspec.json.encode(day.station.counters).decode()}")


if __name__ == "__main__":
    main()

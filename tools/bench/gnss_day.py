"""A day of receivers that are carried, switched and set wrongly: is a wrong position ever claimed at too small a sigma?

`python -m tools.bench.gnss_day --hours 24`: in virtual time, an hour a receiver, one epoch a second with the correlated
error of real network RTK. Each hour has one kind of trouble at an instant of its own. Every three seconds what the box
claims (which `survey boxes` stores) and what the base uses of it are held against the truth: an error beyond four of
the 3-D sigma claimed is a wrong position. The program is seeded; --seed makes another day.
"""

import argparse
import datetime as dt
import itertools
import math
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from calib.station.core.intake import Intake
from calib.station.core.positions import lens_position
from edge.common.arrays import Array
from edge.common.units import NS
from edge.config import GnssConfig
from edge.gnss.diagnosis import Watch
from edge.gnss.gates import metres_per_degree
from edge.gnss.receiver import Receiver
from edge.messages import Fix, Health, encode
from tools.doubles.receiver import Place, gga, rmc, rtk_error

HOUR_S: Final = 3600
PLACE: Final = Place()
START: Final = dt.datetime(2026, 6, 1, 6, tzinfo=dt.UTC)
LOOK_S: Final = 3  # between two looks at what is claimed
WITNESSED_S: Final = 40  # at rest, with the seconds in which a receiver that was carried is found to be
PAUSE_S: Final = 0.5
WRONG_SIGMAS: Final = 4.0
CAMERA: Final = "cam0"


@dataclass
class Hour:
    """What one receiver goes through, second by second: (N, 3) where it is, what is added to it, (N,) its quality."""

    truth_m: Array
    added_m: Array
    quality: Array
    separation: str | None = None
    unplugged: set[int] = field(default_factory=set)
    restarted: dict[int, tuple[str, ...]] = field(default_factory=dict)  # in which second: "box", "base"


def _still() -> Hour:
    return Hour(np.zeros((HOUR_S, 3)), np.zeros((HOUR_S, 3)), np.full(HOUR_S, 4))


def _away(rng: np.random.Generator, least_m: float, most_m: float) -> Array:
    bearing, distance_m = rng.uniform(0, 2 * math.pi), math.exp(rng.uniform(math.log(least_m), math.log(most_m)))
    return np.array([distance_m * math.sin(bearing), distance_m * math.cos(bearing), rng.normal(0, 0.3 * distance_m)])


def _switched(rng: np.random.Generator, at: int) -> Hour:
    hour = _still()
    hour.added_m[at:] = _away(rng, 0.15, 5.0)
    return hour


def _switched_through_float(rng: np.random.Generator, at: int) -> Hour:
    hour = _switched(rng, at)
    hour.quality[at - int(rng.integers(3, 60)) : at] = 5
    return hour


def _switched_and_back(rng: np.random.Generator, at: int) -> Hour:
    hour = _switched(rng, at)
    hour.added_m[at + int(rng.integers(5, 900)) :] = 0.0
    return hour


def _carried(rng: np.random.Generator, at: int) -> Hour:
    hour, to_m = _still(), _away(rng, 3.0, 80.0)
    seconds = max(6, int(np.linalg.norm(to_m) / rng.uniform(0.4, 1.5)))
    hour.truth_m[at : at + seconds] = np.linspace(0, 1, seconds)[:, None] * to_m
    hour.truth_m[at + seconds :] = to_m
    return hour


def _carried_in_float(rng: np.random.Generator, at: int) -> Hour:
    hour = _carried(rng, at)
    moving = np.flatnonzero(np.any(np.diff(hour.truth_m, axis=0), axis=1))
    hour.quality[moving[0] - 3 : moving[-1] + 5] = 5
    return hour


def _carried_unplugged(rng: np.random.Generator, at: int) -> Hour:
    hour = _carried(rng, at)
    moving = np.flatnonzero(np.any(np.diff(hour.truth_m, axis=0), axis=1))
    hour.unplugged = set(range(int(moving[0]) - 3, int(moving[-1]) + 5))
    return hour


def _false_fix(rng: np.random.Generator, at: int) -> Hour:
    hour = _still()
    hour.quality[at - 20 : at] = 5
    hour.added_m[at : at + int(rng.integers(10, 1200))] = _away(rng, 0.15, 0.6)
    return hour


def _pushed(rng: np.random.Generator, at: int) -> Hour:
    hour = _still()
    hour.truth_m[at:] = _away(rng, 0.15, 0.5)
    return hour


def _restarted(
    made: Callable[[np.random.Generator, int], Hour], *what: tuple[str, ...], after_s: tuple[int, int] = (2, 500)
) -> Callable[[np.random.Generator, int], Hour]:
    """The same, and then box, base or both start anew, each of `what` some time after the one before it."""

    def hour(rng: np.random.Generator, at: int) -> Hour:
        found, second = made(rng, at), at
        for each in what:
            second += int(rng.integers(*after_s))
            found.restarted[min(second, HOUR_S - 1)] = each
        return found

    return hour


def _switched_in_steps(rng: np.random.Generator, at: int) -> Hour:
    hour = _still()
    for step in range(int(rng.integers(2, 6))):
        hour.added_m[at + step * int(rng.integers(20, 400)) :] += _away(rng, 0.1, 1.5)
    return hour


def _carried_and_back(rng: np.random.Generator, at: int) -> Hour:
    hour = _carried(rng, at)
    back = _carried(rng, min(at + int(rng.integers(100, 900)), HOUR_S - 300))
    first = int(np.flatnonzero(back.truth_m.any(axis=1))[0])
    hour.truth_m[first:] = (
        hour.truth_m[first - 1] * np.linspace(1, 0, 60).clip(0)[np.minimum(np.arange(HOUR_S - first), 59)][:, None]
    )
    return hour


def _carried_and_switched(rng: np.random.Generator, at: int) -> Hour:
    """Half a minute after it arrived or later: of a base that is switched on the way nothing is a witness."""
    hour = _carried(rng, at)
    arrived = int(np.flatnonzero(np.any(np.diff(hour.truth_m, axis=0), axis=1))[-1]) + 1
    hour.added_m[arrived + int(rng.integers(WITNESSED_S, 900)) :] = _away(rng, 0.2, 5.0)
    return hour


def _separation(text: str) -> Callable[[np.random.Generator, int], Hour]:
    def hour(_: np.random.Generator, __: int) -> Hour:
        made = _still()
        made.separation = text
        return made

    return hour


KINDS: Final[dict[str, Callable[[np.random.Generator, int], Hour]]] = {
    "base switched": _switched,
    "base switched through float": _switched_through_float,
    "base switched and back": _switched_and_back,
    "carried, fixed": _carried,
    "carried in float": _carried_in_float,
    "carried unplugged": _carried_unplugged,
    "false fix": _false_fix,
    "pushed": _pushed,
    "separation 0": _separation("0.0"),
    "separation of the wrong sign": _separation(f"{-PLACE.separation_m}"),
    "base switched, box restarted": _restarted(_switched, ("box",)),
    "base switched, box restarted twice": _restarted(_switched, ("box",), ("box",)),
    "base switched, base restarted, box restarted": _restarted(_switched, ("base",), after_s=(650, 900)),
    "base switched and back, box restarted": _restarted(_switched_and_back, ("box",)),
    "base switched through float, box restarted": _restarted(_switched_through_float, ("box",)),
    "base switched in steps": _switched_in_steps,
    "carried, box restarted": _restarted(_carried, ("box",), after_s=(2, 300)),
    "carried, both restarted": _restarted(_carried, ("box",), ("base",), after_s=(2, 300)),
    "carried, base restarted": _restarted(_carried, ("base",), after_s=(2, 300)),
    "carried and back": _carried_and_back,
    "carried and switched": _carried_and_switched,
    "pushed, box restarted": _restarted(_pushed, ("box",)),
    "quiet, both restarted": _restarted(lambda rng, at: _still(), ("box",), ("base",)),
    "quiet": lambda rng, at: _still(),
}


class Witness:
    """The receiver's box and its base, in virtual time."""

    def __init__(self) -> None:
        self._second, self._runs = 0.0, 0
        self.restart(("box", "base"))

    def restart(self, what: tuple[str, ...]) -> None:
        """Box, base or both begin anew, and remember nothing."""
        if "base" in what:
            self.base = Intake([CAMERA])
        if "box" in what:
            self._runs += 1
            config = GnssConfig(device="/dev/null/none", lever_arm_m=(0.0, 0.0, 0.0))
            self._receiver = Receiver(config, monotonic_s=lambda: self._second, unix_ns=self._unix_ns)
            self._watch = Watch(self._second, 115200, 0)

    def _unix_ns(self) -> int:
        return int(START.timestamp()) * NS + round(self._second * NS)

    def hear(self, second: int, data: bytes) -> Fix | None:
        """One second; what the box says."""
        # The pause after an epoch, in which a live receiver's last one is closed; one snapshot for both.
        self._second = self._watch.last_snapshot_s = second - PAUSE_S
        self._receiver._take(data, self._watch)
        self._second = float(second)
        self._receiver._take(b"", self._watch)
        said = self._receiver.said()
        health = Health(t_unix_ns=self._unix_ns(), epoch=self._runs, level="ok", items=[], counters={})
        self.base.health(self.base.cameras[CAMERA], encode(health), second * NS)
        if said is not None:
            self.base.fix(self.base.cameras[CAMERA], encode(said), second * NS)
        return said

    def unplug(self) -> None:
        """The port is lost, as the receiver's thread has it."""
        self._receiver._session.interrupt(self._second)
        self._receiver._session.restart()
        self._receiver._kept.forget()


def error_sigmas(fix: Fix, truth_m: Array) -> float:
    """3-D error of a position as the base uses it, in its 3-D sigma."""
    (lat_deg, lon_deg, height_m), sigma_m = lens_position(fix)
    per_lon_m, per_lat_m = metres_per_degree(PLACE.lat_deg)
    off = (
        (lon_deg - PLACE.lon_deg) * per_lon_m - truth_m[0],
        (lat_deg - PLACE.lat_deg) * per_lat_m - truth_m[1],
        height_m - PLACE.altitude_m - PLACE.separation_m - truth_m[2],
    )
    return math.hypot(*off) / math.hypot(*sigma_m)


def tried(hour: Hour, rng: np.random.Generator) -> tuple[Counter[str], float]:
    """Seconds by what was claimed in them, and the largest error in sigmas."""
    witness, seconds, worst = Witness(), Counter[str](), 0.0
    noise_m = rtk_error(np.arange(float(HOUR_S)), rng)
    heard = b""
    for second in range(HOUR_S):
        witness.restart(hour.restarted.get(second, ()))
        if second in hour.unplugged:
            witness.unplug()
            heard = b""
            continue
        t = START + dt.timedelta(seconds=second)
        offset_m = hour.truth_m[second] + hour.added_m[second] + noise_m[second]
        heard += gga(t, PLACE, offset_m, quality=int(hour.quality[second]), separation=hour.separation) + rmc(t)
        if second % LOOK_S:
            continue
        said, heard = witness.hear(second, heard), b""
        used = witness.base.cameras[CAMERA].fix
        seconds[said.standing if said is not None else "nothing said"] += LOOK_S
        # What nobody confirms any more is not stood by; a moving antenna has no position.
        if said is None or said.standing != "held":
            continue
        # `survey boxes` asks the station that runs, and takes nothing that it doubts.
        claims = {} if witness.base.cameras[CAMERA].fix_doubt else {"stored": said}
        claims |= {"used": used} if used is not None else {}
        for name, fix in claims.items():
            off = error_sigmas(fix, hour.truth_m[second])
            worst = max(worst, off)
            seconds[f"{name} wrong"] += LOOK_S * (off > WRONG_SIGMAS)
    return seconds, worst


def main() -> None:
    """Print a line an hour, and the sum; 1 if a wrong position was claimed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=24)
    parser.add_argument("--seed", type=int, default=19)
    parser.add_argument(
        "--kinds", nargs="*", choices=KINDS, default=list(KINDS), help="of trouble (default: all in turn)"
    )
    arguments = parser.parse_args()
    rng, total = np.random.default_rng(arguments.seed), Counter[str]()
    for hour, kind in zip(range(arguments.hours), itertools.cycle(arguments.kinds), strict=False):
        at = int(rng.integers(400, 2400))
        seconds, worst = tried(KINDS[kind](rng, at), rng)
        total += seconds
        print(f"{hour:3} {kind:30} at {at:4} s: {dict(seconds)}, at most {worst:.1f} sigma off", flush=True)
    wrong = total["stored wrong"] + total["used wrong"]
    print(f"seed {arguments.seed}, {arguments.hours} h: {dict(total)}; wrong positions claimed in {wrong} seconds")
    sys.exit(int(wrong > 0))


if __name__ == "__main__":
    main()

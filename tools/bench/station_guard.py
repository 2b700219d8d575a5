"""How soon and how rightly the guard speaks: random faults in random scenes, through the station's own core.

`python -m tools.bench.station_guard --scenes 200 --cameras 3 4 6 --first 0 --jobs 2`. Each scene
(tools/doubles/guard_scenes.py) has one fault, or none, or a detector whose boxes are off by up to half their width.
Printed are: innocent cameras named, right names and how soon, kinds of cause, alarms where nothing happened, and
positions sent that are confidently wrong: farther from every true object than four times their own sigma. Delays are in
seconds of flight that the camera and enough others saw, of a tilt since it has reached the least of knocks. A fault is
detectable if it moves the camera's pixels, in the mean over the first five of those seconds, by more than DETECTABLE
sigma of the mean of a second's rows, the calibration's own sigma of that camera included (guard_scenes.shift_sigma).
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from calib.station.core.station import Station
from tools.doubles.box_messages import state_messages, tracks_messages
from tools.doubles.core_station import station_for
from tools.doubles.flight import T0_UNIX_NS
from tools.doubles.guard_scenes import EVENT_S, QUIET, GuardScene, draw, shift_sigma, visible_s

WRONG_SIGMA: Final = 4.0  # of a position's own 3D sigma: farther off it is confidently wrong
SOON_S: Final = 5.0  # of flight that the camera and enough others see
NAMEABLE: Final = 4  # cameras
CAUSES: Final = {"knock": "it was knocked", "tilt": "it was knocked", "clock": "its clock has stepped"}
EITHER: Final = "it was knocked, or its clock has stepped"
DETECTABLE: Final = 5.5  # sigma: what the guard itself asks of a contradiction, the root of its ASTRAY
SETTLED_S: Final = 2.0  # after the start, before positions are looked at


@dataclass
class Outcome:
    """What came of one scene. delays in seconds of flight that the victim and others saw."""

    name: str
    kind: str
    cameras: int
    said: list[tuple[float, str, str]] = field(default_factory=list)  # s, camera or "", reason
    delay_s: float | None = None  # until the right camera was named, or positions were held back
    visible_s: float = 0.0
    shift_sigma: float = 0.0  # by how many sigma the fault moves the victim's pixels
    innocent: int = 0
    right: bool = False
    cause: str = ""  # right, wrong, either
    sent: int = 0
    wrong_before: int = 0
    wrong_soon: int = 0
    wrong_late: int = 0
    worst: float = 0.0
    cpu_s: float = 0.0

    @property
    def soon(self) -> bool:
        """Whether the right camera was named in time."""
        return self.right and self.delay_s is not None and self.delay_s <= SOON_S


def run(number: int, cameras: tuple[int, ...]) -> Outcome:
    """One scene through a station that is calibrated."""
    drawn = draw(number, cameras)
    began = time.process_time()
    out = Outcome(drawn.name, drawn.kind, drawn.scene.spec.cameras)
    station = station_for(drawn.scene)
    for message in state_messages(drawn.scene):
        station.handle(message.key, message.payload, message.arrival_ns)
    station.adopt(drawn.scene.network)
    visible = visible_s(drawn)
    out.shift_sigma = 0.0 if drawn.kind in QUIET else shift_sigma(drawn)
    out.visible_s = visible(T0_UNIX_NS + round(drawn.scene.spec.duration_s * 1e9))
    for message in tracks_messages(drawn.scene, drawn.stream(), clock_bound_s=drawn.bound_s):
        targets = station.handle(message.key, message.payload, message.arrival_ns)
        targets += station.tick(message.arrival_ns).targets
        at_s = (message.arrival_ns - T0_UNIX_NS) * 1e-9
        if station.calibration.network is None:  # dropped: nothing is sent, nothing more to learn here
            break
        _hear(out, drawn, station, at_s, visible(message.arrival_ns))
        for target in targets:
            if target.state != "lost" and at_s > SETTLED_S:
                off_m = np.linalg.norm(drawn.scene.positions(target.t_unix_ns) - target.position_enu, axis=1).min()
                sigma = float(off_m / np.sqrt(np.trace(target.position_covariance_enu)))
                _score(out, sigma, at_s, visible(message.arrival_ns))
    out.cpu_s = time.process_time() - began
    return out


def _hear(out: Outcome, drawn: GuardScene, station: Station, at_s: float, seen_s: float) -> None:
    """What the guard says that it did not say before."""
    said = [(camera, why) for camera, why in station.calibration.suspects.items()]
    if station.calibration.contradiction:
        said.append(("", station.calibration.contradiction))
    for camera, why in said:
        if any(camera == before for _, before, _ in out.said):
            continue
        out.said.append((at_s - EVENT_S, camera, why))
        guilty = drawn.kind not in QUIET and at_s > EVENT_S
        if camera and not (guilty and camera == drawn.victim):
            out.innocent += 1
        elif camera and guilty:
            out.right, out.delay_s = True, seen_s
            right = CAUSES[drawn.kind] in why and EITHER not in why
            out.cause = "right" if right else "either" if EITHER in why else "wrong"
        elif guilty and out.delay_s is None:
            out.delay_s = seen_s


def _score(out: Outcome, sigma: float, at_s: float, seen_s: float) -> None:
    out.sent += 1
    if sigma <= WRONG_SIGMA:
        return
    if at_s < EVENT_S:
        out.wrong_before += 1
    elif seen_s < SOON_S:
        out.wrong_soon += 1
    else:
        out.wrong_late += 1
        out.worst = max(out.worst, sigma)


def report(outcomes: Iterable[Outcome]) -> None:
    """Print the figures."""
    every = list(outcomes)
    quiet = [one for one in every if one.kind in QUIET]
    faulty = [one for one in every if one.kind not in QUIET]
    seen = [one for one in faulty if one.visible_s >= SOON_S]
    four = [one for one in seen if one.cameras >= NAMEABLE]
    three = [one for one in seen if one.cameras < NAMEABLE]
    soon = sum(one.soon for one in four)
    held = [one.delay_s for one in three if one.delay_s is not None]
    print(
        f"scenes {len(every)}: {len(quiet)} with no fault, {len(faulty)} with one, of which {len(seen)} visible for 5 s"
    )
    print(f"innocent cameras named: {sum(one.innocent for one in every)}")
    print(f"alarms in scenes with no fault: {sum(bool(one.said) for one in quiet)}")
    print(f"four cameras and more: right camera within 5 s {soon} of {len(four)}, ever {sum(o.right for o in four)}")
    clear = [one for one in four if one.shift_sigma > DETECTABLE]
    print(f"    of those detectable, more than {DETECTABLE:g} sigma: {sum(one.soon for one in clear)} of {len(clear)}")
    for kind in CAUSES:
        own = [one for one in four if one.kind == kind]
        in_time = sum(one.soon for one in own)
        delays = sorted(one.delay_s for one in own if one.right and one.delay_s is not None)
        median = f", median {np.median(delays):.1f} s" if delays else ""
        print(f"    {kind}: {in_time} of {len(own)}{median}; cause {dict(Counter(o.cause for o in own if o.right))}")
    named = sum(any(camera for _, camera, _ in one.said) for one in three)
    late = sum(delay > SOON_S for delay in held)
    hard = sum(one.delay_s is None and one.shift_sigma <= DETECTABLE for one in three)
    print(
        f"three cameras: named {named}, held back {len(held)} of {len(three)}, {late} of them later than 5 s; of those "
        f"not held {hard} are not detectable"
    )
    sent, wrong = sum(one.sent for one in every), [one for one in every if one.wrong_late]
    before = sum(one.wrong_before for one in every if one.kind != "box")
    print(
        f"positions {sent}: confidently wrong before the fault {before}, "
        f"in its first 5 s {sum(o.wrong_soon for o in faulty)}, later {sum(o.wrong_late for o in faulty)} "
        f"in {sum(o.kind not in QUIET for o in wrong)} scenes; boxes off centre {sum(o.wrong_late for o in quiet)}"
    )


def main() -> None:
    """Run the scenes and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene: each number is a scene")
    parser.add_argument("--cameras", type=int, nargs="+", default=[3, 4, 6])
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--each", action="store_true", help="print each scene")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.scenes)
    print(f"scenes {numbers.start} to {numbers.stop - 1}", flush=True)
    outcomes = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for one in pool.map(partial(run, cameras=tuple(options.cameras)), numbers):
            outcomes.append(one)
            if options.each:
                said = "; ".join(f"{at_s:.1f} s {camera or '-'} {why}" for at_s, camera, why in one.said)
                delay = "-" if one.delay_s is None else f"{one.delay_s:.1f}"
                print(
                    f"{one.name} | seen {one.visible_s:.1f} s, {one.shift_sigma:.1f} sigma, delay {delay}, "
                    f"innocent {one.innocent}, wrong "
                    f"{one.wrong_before}/{one.wrong_soon}/{one.wrong_late} of {one.sent}, worst {one.worst:.0f}, "
                    f"{one.cpu_s:.1f} CPU s | {said}",
                    flush=True,
                )
    report(outcomes)


if __name__ == "__main__":
    main()

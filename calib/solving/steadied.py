"""Clocks that may not run evenly, looked into: told as a rate, cut where they stepped, or left out as not steady.

The hazard is to keep both sides of a step by moving one by what was found: that is good to a hundredth of a second,
which nothing in the adjustment knows. So the rows of one side go, and which and when is said.
"""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Final

import numpy as np

from calib.adjustment.priors import ALIGNED_TO_S, CONTRADICTING_RATE
from calib.observations import SiteCamera
from calib.solving.clock_consensus import Clock
from calib.solving.clock_steps import LEAST_WITNESSES, PIECE_S, Partners, Stretch, steadiness
from calib.solving.clocks import FASTEST_RATE
from calib.solving.found import Cause, Found
from calib.solving.inputs import Inputs
from calib.solving.series import SHORTEST_TRACK, TrackSeries
from calib.solving.site_clocks import CameraClock, Origin

PARTNERS: Final = 3  # cameras with known clocks that pieces are placed by: the longest tracks, more say the same
POOR_GAIN: Final = 3.5  # log ratio of misfits: one clock for a minute of flight makes thirty times as good a fit
NOT_STEADY: Final = (
    "its clock is not steady: parts of its track fit the others' at different times; it lost frames and counted its "
    "stamps, or was set or restarted more than once: stamp each frame when it is taken"
)
NO_STEADY: Final = (
    "no pose explains its track, and no steady clock makes it fit the others': check its clock and its frames first, "
    "then what it detects and its lens file"
)


@dataclass(frozen=True)
class SteadiedClocks:
    """The clocks after that. rows: of cameras that stepped, those of its observations that are used. found: a sentence
    for each step. confirmed: cameras whose clocks others confirm.
    """

    clocks: dict[str, CameraClock]
    rows: dict[str, frozenset[int]]
    found: tuple[Found, ...]
    confirmed: frozenset[str]

    def if_left_out(self) -> dict[str, str]:
        """What to say of cameras if no pose of them is found, because it is the clock's fault first."""
        return {name: NO_STEADY for name in self.clocks if name not in self.confirmed} | self.unknown

    @property
    def unknown(self) -> dict[str, str]:
        """Cameras without a clock that can be used, and what was tested."""
        return {name: own.tested for name, own in self.clocks.items() if own.origin is Origin.UNKNOWN}

    def cut(self, name: str, tracks: list[TrackSeries]) -> list[TrackSeries]:
        """The rows of the stretch that is used."""
        if name not in self.rows:
            return tracks
        kept = [(track, np.isin(track.row, list(self.rows[name]))) for track in tracks]
        return [track.rows(which) for track, which in kept if which.sum() >= SHORTEST_TRACK]


def steadied_clocks(inputs: Inputs, clocks: dict[str, CameraClock]) -> SteadiedClocks:
    """Look into every clock that no other camera confirms as it is, by the cameras whose clocks are beyond doubt."""
    long_enough = {name for name, own in inputs.tracks.items() if sum(track.duration_s for track in own) > 2 * PIECE_S}
    doubtful = {name for name, own in clocks.items() if name in long_enough and _doubtful(own)}
    sure = [name for name in sorted(clocks) if name not in doubtful and clocks[name].origin is not Origin.UNKNOWN]
    sure.sort(key=lambda name: -sum(track.duration_s for track in inputs.tracks[name]))
    partners: Partners = {name: (inputs.tracks[name], clocks[name].clock) for name in sure[:PARTNERS]}
    told, rows, found = dict(clocks), {}, []
    settled: set[str] = set()
    for name in sorted(doubtful) if partners else ():
        result = steadiness(inputs.tracks[name], _about(clocks[name].clock), partners)
        site = inputs.sites[name]
        if result.stretches:
            settled.add(name)
        elif _refuted(clocks[name], partners):
            told[name] = CameraClock(Clock(), Origin.UNKNOWN, (), NO_STEADY)
        if result.unsteady:
            told[name] = CameraClock(Clock(), Origin.UNKNOWN, (), NOT_STEADY)
        elif len(result.stretches) == 1:
            told[name] = _even(clocks[name], result.stretches[0], site, tuple(partners))
        elif result.stretches:
            stretch = _used(result.stretches, site)
            told[name] = _even(clocks[name], stretch, site, tuple(partners))
            rows[name] = frozenset(
                int(row)
                for track in inputs.tracks[name]
                for row in track.row[(track.t_s >= stretch.from_s) & (track.t_s <= stretch.to_s)]
            )
            found.append(Found(Cause.CLOCK, (name,), _words(name, result.stretches, stretch, inputs.t_mid_unix_ns)))
    return SteadiedClocks(told, rows, tuple(found), frozenset(clocks) - (doubtful - settled))


def _doubtful(clock: CameraClock) -> bool:
    """Unknown, against its box's word, or fitting poorly; a pace of its own that fits well is a clock's."""
    if clock.origin is Origin.ASSUMED:
        return False
    return clock.origin is Origin.UNKNOWN or clock.contradicts or clock.gain < POOR_GAIN


def _refuted(clock: CameraClock, partners: Partners) -> bool:
    """Whether a clock that the whole track fits poorly, and that no part of it confirms, is not to be used."""
    strange = clock.contradicts or abs(clock.clock.rate) > CONTRADICTING_RATE
    return strange and clock.gain < POOR_GAIN and len(partners) >= LEAST_WITNESSES


def _about(clock: Clock) -> Clock:
    """Where a piece is looked for: a rate that no clock has is a step's."""
    return clock if abs(clock.rate) <= FASTEST_RATE else Clock(clock.offset_s, 0.0)


def _even(before: CameraClock, stretch: Stretch, site: SiteCamera, agreeing: tuple[str, ...]) -> CameraClock:
    """A camera's clock as its pieces have it; the whole track's, which is finer, where the two agree."""
    ends = (stretch.from_s, stretch.to_s)
    if before.origin is Origin.FOUND and all(
        abs(before.clock.site(t) - stretch.clock.site(t)) < 2 * ALIGNED_TO_S for t in ends
    ):
        return replace(before, agreeing=agreeing)
    if site.clock_bound_s is not None and all(abs(stretch.clock.site(t) - t) <= _bound_s(site) for t in ends):
        return CameraClock(Clock(), Origin.STATED, agreeing)
    return CameraClock(stretch.clock, Origin.FOUND, agreeing)


def _bound_s(site: SiteCamera) -> float:
    return max(3 * (site.clock_bound_s or 0.0), ALIGNED_TO_S)


def _used(stretches: tuple[Stretch, ...], site: SiteCamera) -> Stretch:
    """The stretch during which the clock was what its box says, if it is long enough; else the longest."""
    stated = [
        one
        for one in stretches
        if site.clock_bound_s is not None
        and abs(one.clock.offset_s) <= _bound_s(site)
        and one.to_s - one.from_s >= PIECE_S
    ]
    return max(stated or stretches, key=lambda one: one.to_s - one.from_s)


def _words(name: str, stretches: tuple[Stretch, ...], used: Stretch, t_mid_unix_ns: int) -> str:
    before, after = stretches
    step_s = before.clock.site(before.to_s) - after.clock.site(before.to_s)
    at = datetime.fromtimestamp(t_mid_unix_ns * 1e-9 + before.clock.site(before.to_s), UTC)
    which = "after" if used is before else "before"
    return (
        f"the clock of {name} stepped by {step_s:+.2f} s at {at:%Y-%m-%d %H:%M:%S} UTC: its rows {which} that were not "
        "used; look whether it was restarted or set"
    )

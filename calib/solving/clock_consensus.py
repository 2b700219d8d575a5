"""One set of clocks from many pairs: offsets that close loops, of which most of what the pairs say is true.

The hazard is the chain. Each pair of cameras has several offsets at which its tracks fit, a flight that repeats itself
fits one round later, and whichever pair is taken first drags all others along. Around a loop of three cameras the right
offsets add up to nothing; wrong ones do so by chance in one case of a hundred. So candidates are joined by what
confirms them, each camera is then tried everywhere else that any pair proposes, and a camera for which another place
does nearly as well has no certain clock.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from calib.solving.clocks import CONTRAST, CONVINCING, LEAST_GAIN, NEARNESS, Alignment, Candidate, free_rows

CLOSES_S: Final = (
    0.25  # around a loop: each candidate is good to some hundredths, at the ends of its overlap to a tenth
)
CONTRAST_NEAR: Final = 1.15  # times the next best place, if the clock stays near: nobody else proposed that it should
CONTRAST_LEVEL: Final = 1.3  # times a place as near at which the tracks fit nearly as well: the flight repeats itself
PLACED: Final = "?"  # no camera's name: one that is placed among others
CLEAR_SCORE: Final = 10.0  # score by which a near place must exceed what is typical: twice the log of 150 to 1
ROUNDS: Final = 10  # of trying each camera elsewhere; two or three settle it


@dataclass(frozen=True)
class Clock:
    """Site time of a stamp t is t + offset_s + rate t, all in seconds from t_mid."""

    offset_s: float = 0.0
    rate: float = 0.0

    def site(self, t_s: float) -> float:
        """Site time of a stamp."""
        return t_s + self.offset_s + self.rate * t_s

    def stamp(self, site_s: float) -> float:
        """The stamp of a site time."""
        return (site_s - self.offset_s) / (1 + self.rate)

    def after(self, candidate: Candidate) -> "Clock":
        """The clock of a pair's second camera, if this is the first's."""
        rate = (1 + self.rate) * (1 + candidate.rate) - 1
        return Clock((1 + self.rate) * candidate.offset_s + self.offset_s, rate)

    def seen_from(self, reference: "Clock") -> "Clock":
        """The same clock against the reference's stamps in place of site time."""
        rate = (1 + self.rate) / (1 + reference.rate) - 1
        return Clock((self.offset_s - reference.offset_s) / (1 + reference.rate), rate)


@dataclass(frozen=True)
class Tied:
    """What a camera's clock hangs on. agreeing: the cameras whose pair with it says so. score: of those pairs together.

    elsewhere: the score of its next best place. gain: the largest of a pair's, log ratio of misfits. certain: whether
    it may be believed without the word of its box.
    """

    clock: Clock
    agreeing: tuple[str, ...]
    score: float
    elsewhere: float
    gain: float
    certain: bool


Pairs = dict[tuple[str, str], Alignment]


def consensus(pairs: Pairs, near_s: float) -> dict[str, Tied]:
    """The clocks of the cameras that pairs (in alphabetical order within) tie together, the largest set of them.

    All against one of them, which is not the site's time yet.
    """
    links = {pair: _directed(alignment.candidates) for pair, alignment in pairs.items()}
    links |= {(two, one): tuple(map(_turned, there)) for (one, two), there in links.items()}
    clocks = _settled(_spanned(links, near_s), links, near_s)
    return {name: _tied(name, clocks, links, near_s) for name in sorted(clocks)}


def _directed(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    return tuple(candidate for candidate in candidates if candidate.score > 0)


def _turned(candidate: Candidate) -> Candidate:
    """The same between the second and the first."""
    stretch = 1 + candidate.rate
    return Candidate(
        -candidate.offset_s / stretch,
        1 / stretch - 1,
        candidate.gain,
        candidate.score,
        candidate.overlap_s,
        (candidate.at_s - candidate.offset_s) / stretch,
        candidate.half_s / stretch,
    )


Links = dict[tuple[str, str], tuple[Candidate, ...]]


def _weight(candidate: Candidate, near_s: float) -> float:
    return candidate.score / NEARNESS if abs(candidate.shift_s) <= near_s else candidate.score


def _agrees(one: Clock, two: Clock, candidate: Candidate) -> bool:
    """Whether a pair's candidate is what two clocks say, over its whole overlap."""
    ends = (candidate.at_s - candidate.half_s, candidate.at_s + candidate.half_s)
    return all(abs(two.stamp(one.site(t)) - (t - candidate.offset_s) / (1 + candidate.rate)) < CLOSES_S for t in ends)


def _spanned(links: Links, near_s: float) -> dict[str, Clock]:
    """Clocks joined by the candidates that most others confirm, the largest set of cameras so tied."""
    ranked = sorted(
        (
            (_support(pair, candidate, links, near_s), pair, candidate)
            for pair, own in links.items()
            for candidate in own
        ),
        key=lambda entry: (-entry[0], entry[1]),
    )
    groups: dict[str, dict[str, Clock]] = {}
    for _, (one, two), candidate in ranked:
        mine, other = groups.get(one, {one: Clock()}), groups.get(two, {two: Clock()})
        if mine is other or (one < two and one in other):
            continue
        # The other's clocks are given against its `two`, whose place in mine the candidate tells.
        place = mine[one].after(candidate)
        joined = dict(mine)
        for name, clock in other.items():
            own = clock.seen_from(other[two])
            joined[name] = Clock(
                (1 + place.rate) * own.offset_s + place.offset_s, (1 + place.rate) * (1 + own.rate) - 1
            )
        groups |= dict.fromkeys(joined, joined)
    return max(groups.values(), key=len, default={})


def _support(pair: tuple[str, str], candidate: Candidate, links: Links, near_s: float) -> float:
    """A candidate's own weight, and for each third camera that of the weaker of two candidates that close the loop."""
    one, two = pair
    total, start = _weight(candidate, near_s), Clock()
    end = start.after(candidate)
    for third in {name for name, _ in links} - {one, two}:
        closing = [
            min(_weight(there, near_s), _weight(back, near_s))
            for there in links.get((one, third), ())
            for back in links.get((third, two), ())
            if _agrees(start.after(there), end, back)
        ]
        total += max(closing, default=0.0)
    return total


def _settled(clocks: dict[str, Clock], links: Links, near_s: float) -> dict[str, Clock]:
    """Each camera where most of what its pairs say is true, the others given, until none moves."""
    for _ in range(ROUNDS):
        moved = False
        for name in sorted(clocks):
            places = _places(name, clocks, links)
            best = max(places, key=lambda place: _said(name, place, clocks, links, near_s).weight, default=clocks[name])
            better = (
                _said(name, best, clocks, links, near_s).weight
                > _said(name, clocks[name], clocks, links, near_s).weight
            )
            if better and not _same(best, clocks[name], links, name):
                clocks, moved = clocks | {name: best}, True
        if not moved:
            break
    return clocks


def _places(name: str, clocks: dict[str, Clock], links: Links) -> list[Clock]:
    """Everywhere that any pair proposes a camera's clock to be."""
    return [
        clocks[other].after(candidate)
        for other in sorted(clocks)
        if other != name
        for candidate in links.get((other, name), ())
    ]


@dataclass(frozen=True)
class _Word:
    """What a camera's pairs say for a place of its clock: the weight of it all, which cameras say it, and the largest
    gain among them. level: the weight if what fits there fitted for as long as the pair's longest candidate.
    """

    weight: float = 0.0
    agreeing: tuple[str, ...] = ()
    gain: float = 0.0
    level: float = 0.0


def _said(name: str, place: Clock, clocks: dict[str, Clock], links: Links, near_s: float) -> _Word:
    weight, level, gain, agreeing = 0.0, 0.0, 0.0, []
    for other in sorted(set(clocks) - {name}):
        own = links.get((other, name), ())
        fitting = [candidate for candidate in own if _agrees(clocks[other], place, candidate)]
        if fitting:
            best = max(fitting, key=lambda candidate: _weight(candidate, near_s))
            weight += _weight(best, near_s)
            level += max(best.score, _level(best, max(candidate.overlap_s for candidate in own)))
            gain = max(gain, best.gain)
            agreeing.append(other)
    return _Word(weight, tuple(agreeing), gain, level)


def _level(candidate: Candidate, longest_s: float) -> float:
    """The score of a candidate if it fitted for that long; nothing of one that fits for less than half of it."""
    if 2 * candidate.overlap_s < longest_s:
        return 0.0
    return float(free_rows(np.array([longest_s]))[0]) * (candidate.gain - LEAST_GAIN)


def _same(one: Clock, two: Clock, links: Links, name: str) -> bool:
    middles = [candidate.at_s for (first, _), own in links.items() if first == name for candidate in own[:1]]
    return all(abs(one.site(t) - two.site(t)) < CLOSES_S for t in middles)


def _tied(name: str, clocks: dict[str, Clock], links: Links, near_s: float) -> Tied:
    clock = clocks[name]
    own = _said(name, clock, clocks, links, near_s)
    others = [place for place in _places(name, clocks, links) if not _same(place, clock, links, name)]
    words = [
        (_near(place, own.agreeing, clocks, near_s), _said(name, place, clocks, links, near_s)) for place in others
    ]
    elsewhere = max((word.weight for _, word in words), default=0.0)
    if _near(clock, own.agreeing, clocks, near_s):
        repeated = max((word.level for near, word in words if near), default=0.0)
        certain = own.weight > max(CLEAR_SCORE, CONTRAST_NEAR * elsewhere, CONTRAST_LEVEL * repeated)
    else:
        repeated = max((word.level for _, word in words), default=0.0)
        certain = own.weight > max(CONVINCING, CONTRAST * elsewhere, CONTRAST * repeated)
    return Tied(clock, own.agreeing, own.weight, elsewhere, own.gain, certain)


def _near(place: Clock, agreeing: tuple[str, ...], clocks: dict[str, Clock], near_s: float) -> bool:
    return all(abs(place.site(0.0) - clocks[other].site(0.0)) <= near_s for other in agreeing)


def placed(said: dict[str, tuple[Candidate, ...]], clocks: dict[str, Clock], near_s: float) -> Tied | None:
    """Where a camera's clock is best, of others whose clocks are known. said: by the other, first in the candidates."""
    links = {(other, PLACED): tuple(one for one in own if one.score > 0) for other, own in said.items()}
    partners = {name: clock for name, clock in clocks.items() if name in said}
    places = _places(PLACED, partners, links)
    if not places:
        return None
    best = max(places, key=lambda place: _said(PLACED, place, partners, links, near_s).weight)
    return _tied(PLACED, partners | {PLACED: best}, links, near_s)

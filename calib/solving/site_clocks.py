"""Each camera's clock against the site's: as its stamps say, or as the tracks say, and how that was found out.

The hazard is the last step's excuse. A camera an hour off, or one that counted 29.83 frames as thirty, fits no pose,
and would be told to look at its lens; and one whose clock nobody can know from this flight must not be given the first
one that fits. So a stated bound is believed until the tracks contradict it beyond doubt, a clock is told only where
`clock_consensus` is certain, and who has none is left out with what its clock was tested for.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations
from math import inf
from typing import Final

from calib.adjustment.priors import ALIGNED_TO_S, trusted_clocks
from calib.observations import SiteCamera
from calib.solving.clock_consensus import CLEAR_SCORE, Clock, Pairs, Tied, consensus
from calib.solving.clocks import CONVINCING, FASTEST_RATE, NEAR_S, Alignment, Candidate, align
from calib.solving.series import TrackSeries

CONFIRMED_BY: Final = 2  # cameras that tie another one firmly before the pairs left are spared
LONG_ENOUGH_S: Final = 40.0  # an ordinary flight's clocks can be told from so much in common
CONTRADICTED: Final = 20.0  # log likelihood by which tracks contradict stamps: beyond any doubt
MEETS_S: Final = 3.0  # in common as stamped: enough to adjust a clock that nobody has reason to doubt
SAME_S: Final = 1.0  # of two clocks that nobody vouches for: phones on a network are alike to that
STATED_SCORE: Final = 1.0  # of stamps that are vouched for and that the tracks say nothing about


class Origin(StrEnum):
    """Where a clock is from."""

    STATED = "stated"  # the box vouches for its stamps, and the tracks do not contradict it
    FOUND = "found"  # from the tracks
    ASSUMED = "assumed"  # the tracks fit at any clock, or at none better than at the stamps as they are: these
    UNKNOWN = "unknown"  # the tracks fit at no clock, or at several


@dataclass(frozen=True)
class CameraClock:
    """A camera's clock, from where, the cameras whose tracks say so, and what an unknown one was tested for.

    gain: log ratio of the misfits without it and with it. contradicts: the box vouches for another.
    """

    clock: Clock
    origin: Origin
    agreeing: tuple[str, ...] = ()
    tested: str = ""
    gain: float = 0.0
    contradicts: bool = False


STAMPS_STAND: Final = CameraClock(Clock(), Origin.ASSUMED)


def site_clocks(
    tracks: dict[str, list[TrackSeries]], sites: dict[str, SiteCamera], near_s: float = NEAR_S
) -> dict[str, CameraClock]:
    """The clocks of all cameras that have tracks; those of unknown origin are not to be used."""
    trusted = trusted_clocks(sites)
    pairs, tied = _compared(tracks, trusted, near_s)
    tied = _against_reference(tied, sites, trusted, tracks)
    clocks = {name: _told(sites[name], tied.get(name), tracks, pairs) for name in sorted(tracks)}
    return _with_stamps_that_stand(clocks, pairs)


def _with_stamps_that_stand(clocks: dict[str, CameraClock], pairs: Pairs) -> dict[str, CameraClock]:
    """The clocks, those that are unknown because the flight repeats itself taken as stamped where that fits as well."""
    unknown = [name for name, own in clocks.items() if own.origin is Origin.UNKNOWN]
    if unknown and sum(map(_lost_as_stamped, pairs.values())) < len(pairs) * CLEAR_SCORE / 2:
        # What was found for one camera hangs on another, which fits as well elsewhere.
        near = {name for name, own in clocks.items() if abs(own.clock.offset_s) <= SAME_S and name not in unknown}
        return {name: own if name in near else STAMPS_STAND for name, own in clocks.items()}
    found = [abs(own.clock.offset_s) for own in clocks.values() if own.origin is Origin.FOUND]
    if max(found, default=0.0) > SAME_S:
        return clocks  # then stamps are nobody's word
    return clocks | {name: STAMPS_STAND for name in unknown if _fits_as_stamped(name, pairs)}


def _fits_as_stamped(name: str, pairs: Pairs) -> bool:
    """Whether each pair of a camera fits as stamped, and nowhere much better."""
    lost = (_lost_as_stamped(alignment) for pair, alignment in pairs.items() if name in pair)
    return max(lost, default=inf) < CLEAR_SCORE


def _lost_as_stamped(alignment: Alignment) -> float:
    """The log likelihood by which a pair fits better somewhere than as stamped; infinite if it does not fit as stamped.

    At the border of the rates that are searched no clock is found: there the tracks would rather run faster still.
    """
    stamped = alignment.as_stamped
    if stamped is None or stamped <= CLEAR_SCORE:
        return inf
    inside = (one.likelihood for one in alignment.candidates if abs(one.rate) < FASTEST_RATE)
    return max(0.0, max(inside, default=0.0) - stamped)


def _compared(
    tracks: dict[str, list[TrackSeries]], trusted: frozenset[str], near_s: float
) -> tuple[Pairs, dict[str, Tied]]:
    """Pairs with most to say first, until every camera is firmly tied."""
    length = {name: sum(track.duration_s for track in own) for name, own in tracks.items()}
    ranked = sorted(combinations(sorted(tracks), 2), key=lambda pair: -min(length[name] for name in pair))
    pairs: Pairs = {}
    firm = dict.fromkeys(tracks, 0)
    least = min(CONFIRMED_BY, len(tracks) - 1)
    for one, two in ranked:
        found = align(tracks[one], tracks[two], near_s)
        if one in trusted and two in trusted:
            found = _vouched(found)
        pairs[one, two] = found
        for name in (one, two):
            firm[name] += found.convincing
        if min(firm.values()) >= least:
            tied = consensus(pairs, near_s)
            if len(tied) == len(tracks) and all(one.certain for one in tied.values()):
                return pairs, tied
    return pairs, consensus(pairs, near_s)


def _vouched(found: Alignment) -> Alignment:
    """The stamps of two boxes that know their time, unless the tracks are sure of another."""
    score = max(found.as_stamped or 0.0, STATED_SCORE)
    best = found.candidates[0] if found.candidates else None
    elsewhere = best is not None and abs(best.shift_s) + abs(best.rate) * best.half_s > ALIGNED_TO_S
    if best and elsewhere and found.convincing and best.likelihood > score + CONTRADICTED:
        return found
    stated = Candidate(0.0, 0.0, found.stamped_gain, score, 0.0, 0.0, 0.0)
    return Alignment((stated,), found.as_stamped, found.convincing and not elsewhere)


def _against_reference(
    tied: dict[str, Tied], sites: dict[str, SiteCamera], trusted: frozenset[str], tracks: dict[str, list[TrackSeries]]
) -> dict[str, Tied]:
    """The same clocks against the site's: that of most boxes that know theirs, else of the median pace.

    Of those that most agree with to a second, if there are such: one that counts leap seconds is not the site's time.
    """
    knowing = [name for name in sorted(tied) if name in trusted]
    known = [name for name in sorted(tied) if tied[name].certain] or sorted(tied)
    if knowing:

        def rank(name: str) -> tuple[int, float]:
            zero = tied[name].clock
            seen = {other: replace(tied[other], clock=tied[other].clock.seen_from(zero)) for other in knowing}
            off = sum(_off(own, sites[other], tracks[other]) for other, own in seen.items())
            return (off, sites[name].clock_bound_s or 0.0)

        reference = min(knowing, key=rank)
    elif known:
        agreeing = _most_alike(known, tied)
        reference = sorted(agreeing, key=lambda name: (tied[name].clock.rate, name))[(len(agreeing) - 1) // 2]
    else:
        return tied
    zero = tied[reference].clock
    return {name: replace(own, clock=own.clock.seen_from(zero)) for name, own in tied.items()}


def _most_alike(names: list[str], tied: dict[str, Tied]) -> list[str]:
    """More than half of the clocks, alike to a second; all of them if there is no such half."""
    offsets = {name: tied[name].clock.offset_s for name in names}
    groups = [[other for other in names if abs(offsets[other] - offsets[name]) < SAME_S] for name in names]
    largest = max(groups, key=len)
    return largest if 2 * len(largest) > len(names) else names


def _told(site: SiteCamera, tied: Tied | None, tracks: dict[str, list[TrackSeries]], pairs: Pairs) -> CameraClock:
    certain = tied is not None and tied.certain
    if (
        site.clock_bound_s is not None
        and site.clock_bound_s <= ALIGNED_TO_S
        and not (certain and _off(tied, site, tracks[site.id]))
    ):
        agreeing, gain = (tied.agreeing, tied.gain) if tied is not None and certain else ((), 0.0)
        return CameraClock(Clock(), Origin.STATED, agreeing, gain=gain)
    if tied is not None and certain:
        contradicts = site.id in trusted_clocks({site.id: site})
        return CameraClock(tied.clock, Origin.FOUND, tied.agreeing, gain=tied.gain, contradicts=contradicts)
    own = [alignment for pair, alignment in pairs.items() if site.id in pair]
    if own and (all(_says_nothing(alignment) for alignment in own) or _too_short(site.id, tracks, own)):
        return STAMPS_STAND
    return CameraClock(Clock(), Origin.UNKNOWN, (), _tested(site.id, tracks, pairs))


def _too_short(name: str, tracks: dict[str, list[TrackSeries]], own: list[Alignment]) -> bool:
    """Whether the camera's tracks cannot tell its clock for want of time, and as stamped meet another camera's."""
    if any(alignment.candidates or alignment.as_stamped is not None for alignment in own):
        return False
    others = [track for other, theirs in tracks.items() if other != name for track in theirs]
    shared_s = (min(a.t_s[-1], b.t_s[-1]) - max(a.t_s[0], b.t_s[0]) for a in tracks[name] for b in others)
    return max(shared_s, default=0.0) >= MEETS_S


def _off(tied: Tied | None, site: SiteCamera, tracks: list[TrackSeries]) -> bool:
    """Whether the tracks say another time, anywhere along them, than the stamps that a box vouches for."""
    bound_s = max(3 * (site.clock_bound_s or 0.0), ALIGNED_TO_S)
    ends = [float(t) for track in tracks for t in (track.t_s[0], track.t_s[-1])]
    return tied is not None and any(abs(tied.clock.site(t) - t) > bound_s for t in ends)


def _says_nothing(alignment: Alignment) -> bool:
    """Whether a pair's tracks fit at the stamps as they are, and nowhere better."""
    best = max((candidate.score for candidate in alignment.candidates), default=0.0)
    return alignment.as_stamped is not None and alignment.as_stamped > -CONTRADICTED and best < CLEAR_SCORE


def _tested(name: str, tracks: dict[str, list[TrackSeries]], pairs: Pairs) -> str:
    """What the clock of a camera that has none was tested for."""
    own = [alignment for pair, alignment in pairs.items() if name in pair]
    found = [candidate for alignment in own for candidate in alignment.candidates]
    if not found and all(alignment.as_stamped is None for alignment in own):
        return "its clock cannot be told: at no offset does it see the object together with another camera for 15 s"
    if any(candidate.score > CONVINCING for candidate in found):
        return (
            "its clock cannot be told: its track fits the others' at several offsets, because the flight repeats "
            "itself; keep its clock in time and state its bound, or fly turns that do not repeat"
        )
    seen_s = {other: sum(track.duration_s for track in own_tracks) for other, own_tracks in tracks.items()}
    if min(seen_s[name], max(seen_s[other] for other in seen_s if other != name)) < LONG_ENOUGH_S:
        return (
            "its clock cannot be told: it sees the object too shortly together with another camera; keep its clock "
            f"in time and state its bound, or fly {LONG_ENOUGH_S:.0f} s and more where others see it too"
        )
    return (
        "its track fits the others' at no offset and no rate of its clock: it filmed something else, lost frames "
        "without telling, or its file is another camera's"
    )

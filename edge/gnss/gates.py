"""Gating: which epochs of a receiver may be used for a survey, and why not the others.

The hazard is the plausible wrong position. A receiver says "12 mm" in float as in fixed, a checksum of eight bits lets
one corrupt sentence in a thousand through, a correction stream dies and the position drifts on. So every epoch passes
two gates, and is refused with a reason: first what it says about itself (quality, age of the corrections, resolution,
separation, range, the receiver's own doubt, agreement of its sentences), then whether it fits the epochs before it. A
camera stands on a tripod: a position that moves is wrong, whatever it says.
"""

import datetime as dt
import math
import statistics
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Protocol

from edge.gnss.epoch import MS_PER_DAY, RTK_FIXED, Epoch, Part, Place
from edge.gnss.geoid import SITE_ZERO_M, contradiction, undulation_m

MAX_AGE_S: Final = 5.0  # corrections older than this have let the position drift by centimetres
MAX_RESOLUTION_M: Final = 0.002  # six decimals of a minute; five, 18.6 mm, bias a quiet receiver's mean by up to 10 mm
MAX_REPORTED_SIGMA_M: Final = 0.1  # ten times a fixed solution's; a smaller claim is no proof of anything
MAX_PDOP: Final = 6.0  # beyond it a fixed solution's height is decimetres off; survey guidance stops at 5 or 6
MAX_SOURCES_APART_M: Final = 0.03  # two messages of one instant; their own resolution comes on top
MIN_HEIGHT_M, MAX_HEIGHT_M = -500.0, 9000.0  # the Dead Sea's shore and Everest

MAX_STEP_H_M: Final = 0.03  # five sigma of the step of a fixed solution in a second; together with the vertical
MAX_STEP_V_M: Final = 0.04  # limit, no accepted epoch is more than 5 cm from those before it
MAX_PAUSE_S: Final = 5.0  # after a longer pause the ambiguities may have been fixed anew
CONFIRMATIONS: Final = 3  # epochs that must agree before the first of them counts
MEDIAN_EPOCHS: Final = 5  # epochs whose median the next one is compared with

QUALITY_NAMES: Final = {
    0: "no position", 1: "single", 2: "differential", 3: "PPS", 4: "RTK fixed", 5: "RTK float",
    6: "dead reckoning", 7: "manual input", 8: "simulator",
}  # fmt: skip


class Reason(StrEnum):
    """Why an epoch was refused."""

    NO_POSITION = "no position"
    QUALITY = "not RTK fixed"
    AGE = "corrections too old"
    AGE_UNKNOWN = "age of corrections unknown"
    RESOLUTION = "too few decimals"
    SEPARATION = "geoid separation missing"
    GEOID = "geoid separation contradicted"
    RANGE = "out of range"
    DOUBT = "receiver doubts itself"
    GEOMETRY = "satellites stand badly"
    DISAGREE = "its own sentences disagree"
    DATE = "impossible date"
    LEAP_SECOND = "leap second"
    TIME_ORDER = "time goes backwards"
    JUMP = "jumps"
    UNCONFIRMED = "waiting for confirmation"


@dataclass(frozen=True)
class Refusal:
    """A refused epoch: the reason, and the figure that broke it."""

    reason: Reason
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.reason} ({self.detail})" if self.detail else str(self.reason)


@dataclass(frozen=True)
class Position:
    """An epoch that may be averaged: ellipsoidal height; step_m the resolution, horizontal and vertical."""

    t_day_ms: int
    date: dt.date | None
    lat_deg: float
    lon_deg: float
    height_m: float
    step_m: tuple[float, float]
    source: str


@dataclass(frozen=True)
class Policy:
    """What an operator may set, and what is known of the site.

    separation_m: the geoid's, used whatever the receiver says of it; None: the receiver's own, held against EGM96 and
    against undulation_m, the geoid above the ellipsoid at the site, where that is known.
    earliest, latest: a date before or after them is a receiver whose week counter has wrapped; None for recordings.
    """

    separation_m: float | None = None
    undulation_m: float | None = None
    accept_unknown_age: bool = False
    earliest: dt.date | None = None
    latest: dt.date | None = None


def judge(epoch: Epoch, policy: Policy) -> Position | Refusal:
    """What one epoch says about itself: a position fit for a survey, or the reason why not."""
    if epoch.t_day_ms >= MS_PER_DAY:
        return Refusal(Reason.LEAP_SECOND)
    refusal = _quality(epoch) or _age(epoch, policy) or _doubt(epoch) or _date(epoch, policy)
    return refusal or _position(epoch, policy)


def _quality(epoch: Epoch) -> Refusal | None:
    if not epoch.solutions:
        return Refusal(Reason.NO_POSITION, "no message with a position")
    worst = next((part.quality for part in epoch.solutions if part.quality != RTK_FIXED), None)
    if worst is not None:
        return Refusal(Reason.QUALITY, f"{worst}: {QUALITY_NAMES.get(worst, 'unknown')}")
    contradiction = next((part.contradiction for part in epoch.parts.values() if part.contradiction), "")
    return Refusal(Reason.QUALITY, contradiction) if contradiction else None


def _age(epoch: Epoch, policy: Policy) -> Refusal | None:
    ages = [part.age_s for part in epoch.parts.values() if part.age_s is not None]
    if not ages:
        return None if policy.accept_unknown_age else Refusal(Reason.AGE_UNKNOWN)
    if not 0 <= max(ages) <= MAX_AGE_S:
        return Refusal(Reason.AGE, f"{max(ages):g} s")
    return None


def _doubt(epoch: Epoch) -> Refusal | None:
    sigmas = [sigma for part in epoch.parts.values() for sigma in part.sigma_m]
    if sigmas and max(sigmas) > MAX_REPORTED_SIGMA_M:
        return Refusal(Reason.DOUBT, f"it says {max(sigmas):.2f} m")
    # Solvers that know no dilution write 0.
    if epoch.pdops and min(epoch.pdops) > MAX_PDOP:
        return Refusal(Reason.GEOMETRY, f"PDOP {min(epoch.pdops):g}")
    return None


def _date(epoch: Epoch, policy: Policy) -> Refusal | None:
    if epoch.date is None:
        return None
    early, late = policy.earliest and epoch.date < policy.earliest, policy.latest and epoch.date > policy.latest
    return Refusal(Reason.DATE, f"{epoch.date}") if early or late else None


def _position(epoch: Epoch, policy: Policy) -> Position | Refusal:
    """The finest of the epoch's positions; the others must agree with it."""
    judged = [_of_part(epoch, part, policy) for part in epoch.parts.values() if part.place or part.quality is not None]
    refused = [each for each in judged if isinstance(each, Refusal)]
    usable = sorted((each for each in judged if isinstance(each, Position)), key=lambda each: math.hypot(*each.step_m))
    absurd = [refusal for refusal in refused if refusal.reason is Reason.RANGE]
    if absurd or not usable:
        # Too coarse is what is left to say of a message that is right but for that.
        return min(absurd or refused, key=lambda refusal: refusal.reason is Reason.RESOLUTION)
    for place, rival in epoch.rivals:
        rivals_apart_m = math.hypot(*offset_m(place, rival))
        if rivals_apart_m > MAX_SOURCES_APART_M + place.step_m[1]:
            return Refusal(Reason.DISAGREE, f"two positions of one instant {rivals_apart_m:.2f} m apart")
    finest, *others = usable
    for other in others:
        east, north, up = offset_m(finest, other)
        if math.hypot(east, north) > MAX_SOURCES_APART_M or abs(up) > MAX_SOURCES_APART_M + other.step_m[1]:
            apart_m = math.hypot(east, north, up)
            return Refusal(Reason.DISAGREE, f"{other.source} and {finest.source} {apart_m:.2f} m apart")
    return finest


def _of_part(epoch: Epoch, part: Part, policy: Policy) -> Position | Refusal:
    place = part.place
    if place is None:
        return Refusal(Reason.NO_POSITION, "blank fields")
    if place.above_geoid and policy.separation_m is None:
        return Refusal(Reason.SEPARATION, "enter separation_m, or make the receiver send it")
    if place.step_m[0] > MAX_RESOLUTION_M:
        return Refusal(Reason.RESOLUTION, place.resolution)
    height_m = place.height_m
    if policy.separation_m is not None and (place.above_geoid or place.separation_m is not None):
        height_m += policy.separation_m - (place.separation_m or 0.0)
    position = Position(epoch.t_day_ms, epoch.date, place.lat_deg, place.lon_deg, height_m, place.step_m, part.source)
    verdict = _in_range(position)
    if isinstance(verdict, Position) and (wrong := _contradicted(place, policy)):
        return Refusal(Reason.GEOID, wrong)
    return verdict


def _contradicted(place: Place, policy: Policy) -> str:
    """Why the separation that a receiver sends cannot be right; empty if it can, or another one is used."""
    if place.separation_m is None or policy.separation_m is not None:
        return ""
    of_site = ""
    if policy.undulation_m is not None:
        of_site = contradiction(
            place.separation_m, policy.undulation_m, "site.undulation_m is", zero_from_m=SITE_ZERO_M
        )
    of_model = contradiction(place.separation_m, undulation_m(place.lat_deg, place.lon_deg), "EGM96 says")
    return of_site or of_model


def _in_range(position: Position) -> Position | Refusal:
    if not (abs(position.lat_deg) <= 90 and abs(position.lon_deg) <= 180):
        return Refusal(Reason.RANGE, f"{position.lat_deg}, {position.lon_deg}")
    if not MIN_HEIGHT_M <= position.height_m <= MAX_HEIGHT_M:
        return Refusal(Reason.RANGE, f"height {position.height_m:.1f} m")
    if position.lat_deg == 0 and position.lon_deg == 0:
        return Refusal(Reason.RANGE, "0, 0")
    return position


def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """East and north metres of one degree of longitude and latitude on WGS 84's ellipsoid (NIMA TR8350.2, 2000)."""
    a, e2 = 6378137.0, 6.69437999014e-3
    sin = math.sin(math.radians(lat_deg))
    prime = a / math.sqrt(1 - e2 * sin * sin)
    meridian = prime * (1 - e2) / (1 - e2 * sin * sin)
    return math.radians(prime * math.cos(math.radians(lat_deg))), math.radians(meridian)


class Placed(Protocol):
    """What has a place: degrees, ellipsoidal metres."""

    @property
    def lat_deg(self) -> float: ...
    @property
    def lon_deg(self) -> float: ...
    @property
    def height_m(self) -> float: ...


def offset_m(position: Placed, reference: Placed) -> tuple[float, float, float]:
    """East, north, up metres from reference to position; good to a millimetre within 100 m."""
    east, north = metres_per_degree(reference.lat_deg)
    dlon = (position.lon_deg - reference.lon_deg + 180) % 360 - 180
    return dlon * east, (position.lat_deg - reference.lat_deg) * north, position.height_m - reference.height_m


def elapsed_ms(t_day_ms: int, since_day_ms: int) -> int:
    """Milliseconds from one time of day to another, by the shorter way round midnight."""
    return (t_day_ms - since_day_ms + MS_PER_DAY // 2) % MS_PER_DAY - MS_PER_DAY // 2


@dataclass
class _Chain:
    """Positions that follow one another: close in time and in place."""

    recent: deque[Position] = field(default_factory=lambda: deque(maxlen=MEDIAN_EPOCHS))

    def refuses(self, position: Position) -> Refusal | None:
        """Why `position` cannot be the next of this chain."""
        step_ms = elapsed_ms(position.t_day_ms, self.recent[-1].t_day_ms)
        if step_ms <= 0:
            return Refusal(Reason.TIME_ORDER, f"by {-step_ms / 1000:g} s")
        if step_ms > MAX_PAUSE_S * 1000:
            return Refusal(Reason.UNCONFIRMED, f"after a pause of {step_ms / 1000:g} s")
        offsets = [offset_m(position, earlier) for earlier in self.recent]
        east, north, up = (statistics.median(axis) for axis in zip(*offsets, strict=True))
        if math.hypot(east, north) > MAX_STEP_H_M or abs(up) > MAX_STEP_V_M:
            return Refusal(Reason.JUMP, f"by {math.hypot(east, north):.3f} m, {up:+.3f} m up")
        return None


@dataclass(frozen=True)
class Verdict:
    """What the second gate made of a position: those accepted now, in which segment, and a refusal if there is one."""

    accepted: tuple[Position, ...]
    segment: int
    refusal: Refusal | None = None


class StillnessGate:
    """Lets positions through that stand still; numbers the segments between interruptions.

    A position that does not follow those before it waits until CONFIRMATIONS in a row agree with one another. Then
    they begin a new segment: the antenna was moved, or the ambiguities were fixed anew, and one of the two fixes is
    wrong. Which is for the average to judge, not for this gate.
    """

    def __init__(self) -> None:
        self.segment = 0
        self._chain = _Chain()
        self._pending = _Chain()

    def interrupt(self) -> None:
        """Begin a new segment: the fix or the port was lost."""
        self._chain = _Chain()
        self._pending = _Chain()

    def judge(self, position: Position) -> Verdict:
        """Whether `position` fits those before it."""
        refusal = self._chain.refuses(position) if self._chain.recent else Refusal(Reason.UNCONFIRMED, "first epochs")
        if refusal is None:
            self._chain.recent.append(position)
            self._pending = _Chain()
            return Verdict((position,), self.segment)
        if self._pending.recent and self._pending.refuses(position):
            self._pending = _Chain()
        self._pending.recent.append(position)
        if len(self._pending.recent) < CONFIRMATIONS:
            return Verdict((), self.segment, refusal)
        self._chain, self._pending = self._pending, _Chain()
        self.segment += 1
        return Verdict(tuple(self._chain.recent), self.segment)

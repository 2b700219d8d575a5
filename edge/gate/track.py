"""One track of one camera: a constant-velocity filter in pixels and seconds, and what it has shown of itself.

Both coordinates are measured equally well, so they share one 2 x 2 covariance; that makes the filter a dozen
multiplications, cheap enough for plain numbers. What is published is the measured centre and never the filtered one:
the base has a better filter, and smoothing here would correlate its measurements.
"""

import itertools
import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from edge.gate.rows import TrackRow

ACCELERATION_PX_S2: Final = 250.0  # one sigma: a drone's 5 m/s2 seen at 30 m with 1500 px focal length
SIGMA_UNKNOWN_PX: Final = 1.0  # a detector that does not say: a quarter of a small box
FEWEST_FOR_PARABOLA: Final = 8  # measurements: fewer leave too little to judge the fit by
HISTORY_S: Final = 3.0  # s of positions kept: how long a slow one may take to show that it moves


@dataclass
class GateTrack:
    """State at `t_unix_ns`: position, velocity, their shared covariance, and its past."""

    number: int
    last: TrackRow
    speed_sigma_px_s: float
    clutter: float = 0.0
    u: float = field(init=False)
    v: float = field(init=False)
    du: float = 0.0
    dv: float = 0.0
    t_unix_ns: int = field(init=False)
    var: float = field(init=False)
    cov: float = 0.0
    var_speed: float = field(init=False)
    confirmed: bool = False
    best_score: float = 0.0
    reach_px: float = 0.0
    born_unix_ns: int = field(init=False)
    birth_px: tuple[float, float] = field(init=False)
    places: deque[TrackRow] = field(default_factory=deque)
    waiting: list[TrackRow] = field(default_factory=list)
    votes: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.u, self.v, self.t_unix_ns = self.last.u_px, self.last.v_px, self.last.t_unix_ns
        self.born_unix_ns = self.last.t_unix_ns
        self.birth_px = (self.u, self.v)
        self.var = (self.last.sigma_px or SIGMA_UNKNOWN_PX) ** 2
        self.var_speed = self.speed_sigma_px_s**2
        self._remember(self.last)

    def predict(self, t_unix_ns: int) -> tuple[float, float, float]:
        """Position u, v and its variance per coordinate at another time; the track stays as it is."""
        dt = (t_unix_ns - self.t_unix_ns) / 1e9
        noise = ACCELERATION_PX_S2**2 * dt**4 / 4
        return (
            self.u + self.du * dt,
            self.v + self.dv * dt,
            self.var + 2 * dt * self.cov + dt * dt * self.var_speed + noise,
        )

    def update(self, row: TrackRow) -> None:
        """Take one more measurement, at a later time."""
        dt = (row.t_unix_ns - self.t_unix_ns) / 1e9
        u, v, var = self.predict(row.t_unix_ns)
        q = ACCELERATION_PX_S2**2
        cov = self.cov + dt * self.var_speed + q * dt**3 / 2
        var_speed = self.var_speed + q * dt**2
        total = var + (row.sigma_px or SIGMA_UNKNOWN_PX) ** 2
        gain, gain_speed = var / total, cov / total
        self.u, self.v = u + gain * (row.u_px - u), v + gain * (row.v_px - v)
        self.du += gain_speed * (row.u_px - u)
        self.dv += gain_speed * (row.v_px - v)
        self.var, self.cov, self.var_speed = var * (1 - gain), cov * (1 - gain), var_speed - gain_speed * cov
        self.t_unix_ns = row.t_unix_ns
        self._remember(row)

    def _remember(self, row: TrackRow) -> None:
        self.last = row
        self.best_score = max(self.best_score, row.score)
        self.reach_px = max(self.reach_px, math.hypot(row.u_px - self.birth_px[0], row.v_px - self.birth_px[1]))
        self.places.append(row)
        while self.places[0].t_unix_ns < row.t_unix_ns - HISTORY_S * 1e9:
            self.places.popleft()
        # A score is a weight: a sure look at the object says more about its class than a doubtful one.
        votes = [row.score * score for score in row.classes]
        self.votes = [a + b for a, b in zip(self.votes, votes, strict=True)] if self.votes else votes

    def hits_since(self, t_unix_ns: int) -> int:
        """How many measurements it has from t_unix_ns on."""
        return sum(row.t_unix_ns >= t_unix_ns for row in self.places)

    def mean_score(self, since_unix_ns: int) -> float:
        """How sure its detector was of it since since_unix_ns, on the average."""
        scores = [row.score for row in self.places if row.t_unix_ns >= since_unix_ns]
        return sum(scores) / len(scores)

    def late_score(self, span_s: float, fewest: int) -> float:
        """The same over the last span_s, or over its `fewest` newest measurements if those go further back."""
        oldest_unix_ns = self.t_unix_ns - span_s * 1e9
        scores: list[float] = []
        for row in reversed(self.places):
            if row.t_unix_ns < oldest_unix_ns and len(scores) >= fewest:
                break
            scores.append(row.score)
        return sum(scores) / len(scores)

    def lengths_s(self) -> float:
        """How many of its own lengths it goes a second: far away or near, that depends on what it is alone."""
        return math.hypot(self.du, self.dv) / max(self.last.width_px, self.last.height_px, 1.0)

    def moved_px(self, since_unix_ns: int) -> float:
        """How far it is now from where it was at the earliest measurement not before since_unix_ns."""
        first = next(row for row in self.places if row.t_unix_ns >= since_unix_ns or row is self.places[-1])
        return math.hypot(self.last.u_px - first.u_px, self.last.v_px - first.v_px)

    def roughness_px(self, since_unix_ns: int) -> float:
        """How far its way since since_unix_ns is from a smooth one: rms about a parabola in time (a line, if short)."""
        way = [row for row in self.places if row.t_unix_ns >= since_unix_ns]
        degree = 2 if len(way) >= FEWEST_FOR_PARABOLA else 1
        if len(way) <= degree + 1:
            return math.inf
        t_s = np.array([(row.t_unix_ns - self.t_unix_ns) / 1e9 for row in way])
        powers = t_s[:, None] ** np.arange(degree + 1)
        places = np.array([(row.u_px, row.v_px) for row in way])
        fitted = powers @ np.linalg.lstsq(powers, places, rcond=None)[0]
        return float(np.sqrt(np.sum((places - fitted) ** 2) / (2 * (len(way) - degree - 1))))

    def largest_step_px(self, since_unix_ns: int) -> float:
        """The longest way between two measurements in a row since since_unix_ns."""
        way = [row for row in self.places if row.t_unix_ns >= since_unix_ns]
        return max((math.hypot(b.u_px - a.u_px, b.v_px - a.v_px) for a, b in itertools.pairwise(way)), default=0.0)

    def sigma_px(self, since_unix_ns: int) -> float:
        """What its detector says of its centres since since_unix_ns, on the average."""
        reported = [row.sigma_px or SIGMA_UNKNOWN_PX for row in self.places if row.t_unix_ns >= since_unix_ns]
        return sum(reported) / len(reported)

    def class_scores(self) -> tuple[float, ...]:
        """The vote of all its measurements, normalised where they say anything."""
        total = sum(self.votes)
        return tuple(vote / total for vote in self.votes) if total > 0 else ()

"""On whose word alone a calibration stands: cameras whose own claims no other camera checks.

The hazard is the lie that contradicts nothing. Of three tripods one may be said to stand three metres too high: the
triangle keeps its shape, the pixels fit, every test passes, and all positions lean. So each camera is disbelieved in
turn, in all that it claims of its place, its lens and its clock: where what is left determines the flight nearly as
well, a false claim would have been seen or does little; where it does not, everything that is sent rests on that one
camera's word. This is external reliability (Baarda 1968): sigma is not wider for it, for what is claimed is usually
true, but nobody may be told that it was checked.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from calib.adjustment.bundle import Adjusted
from calib.adjustment.problem import Problem
from calib.adjustment.projection import unknowns_of
from calib.adjustment.uncertainty import position_covariance, positions_by, settled_covariance
from calib.geometry.spline import Flight, Located
from edge.common.arrays import Array

# Times what it claims, its sigma: tens of metres beside centimetres, and as good as nothing.
DISBELIEVED: Final = 1000.0
# Times the stated sigma, in the worst direction. A false claim 1.4 sigmas off what all others leave open passes any
# test, and displaces what is sent by 1.4 times the root of ALONE squared less 1: the four sigmas of the 99.9 % bound.
# On rings of cameras 120 m about it is 80 to 110 with three, 3.7 with four after 15 s of flight and 2.2 after 70 s,
# 1.2 with six.
ALONE: Final = 3.0
FLIGHT_SAMPLES: Final = 200  # instants of the flight, at most: its places are alike in this


def sole_witnesses(adjusted: Adjusted, problem: Problem) -> tuple[str, ...]:
    """Cameras without whose own claims the flight would be far less certain. Source: Baarda (1968)."""
    located = _looks(adjusted.estimate.flight)
    stated = position_covariance(adjusted, problem, located)
    each = zip(adjusted.estimate.cameras, _each_disbelieved(adjusted, problem), strict=True)
    return tuple(
        camera.id for camera, without in each if not _growth(stated, positions_by(without, adjusted, located)) <= ALONE
    )


def _looks(flight: Flight) -> Located:
    """Instants spread over the whole flight."""
    each = max(1, FLIGHT_SAMPLES // len(flight.start_s))
    shares = (np.arange(each) + 0.5) / each
    t_s = flight.start_s[:, None] + shares * (flight.end_s - flight.start_s)[:, None]
    return flight.locate(t_s.ravel(), np.repeat(np.arange(len(flight.start_s)), each))


def _each_disbelieved(adjusted: Adjusted, problem: Problem) -> Iterator[Array]:
    """(14 C, 14 C) covariance of all unknowns if one camera's claims are not believed: one camera after the other."""
    prior, covariance = problem.prior, settled_covariance(adjusted, problem)
    known, free = (np.ix_(which, which) for which in (prior.known, np.diag(covariance) > 0))
    information, claims = np.linalg.inv(covariance[free]), np.linalg.inv(prior.covariance)
    for index in range(len(prior.cameras)):
        own = np.zeros(len(covariance), bool)
        own[unknowns_of(index)] = True
        more = np.where(own[prior.known], DISBELIEVED**2 * np.diag(prior.covariance), 0.0)
        change, without = np.zeros_like(covariance), np.zeros_like(covariance)
        change[known] = np.linalg.inv(prior.covariance + np.diag(more)) - claims
        without[free] = np.linalg.inv(information + change[free])
        yield without


def _growth(stated: Array, without: Array) -> float:
    """By how much sigma grows in the worst direction, median over (N, 3, 3) covariances."""
    grown = np.linalg.eigvals(np.linalg.solve(stated, without)).real.max(axis=1)
    return float(np.sqrt(np.median(grown)))

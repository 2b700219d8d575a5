"""Georeferencing: the similarity that takes the scaffold to the surveyed positions, once they are seen to belong to it.

The hazard is a survey with two positions exchanged or one mistyped: the similarity would spread the error over all
cameras, or turn the world over, and the adjustment only walks downhill from there. So the survey as it is competes with
each pair exchanged, each position left out, and the pictures mirrored: what fits the cameras' shape and stands upright.
One explanation alone is gone on with, and what it disbelieves is left to the adjustment to find; if several are as
good, none is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Final

import numpy as np

from calib.errors import CalibrationError, ContradictionError
from calib.geometry.similarity import HOLD_A_FRAME, Similarity, SimilarityFit, fit_similarity, fit_with_up, rms
from calib.observations import SiteCamera
from calib.solving.doubts import SLIPS_M, Claim, Doubt
from calib.solving.scaffold import Pose, Scaffold
from calib.solving.strain import Believed
from calib.solving.upright import upside_down
from edge.common.arrays import Array

SUSPICIOUS_MISFIT: Final = 0.08  # of the cameras' spread: a scaffold on unrefined lenses misses its survey by a few %
CURE: Final = 0.35  # an explanation that shrinks the misfit below this share of it has explained it
ROUGH: Final = 0.03  # of the cameras' spread: below it no other order of the positions says anything
OUTDONE: Final = 8.0  # times the misfit of another order of the positions: then it was that order
AS_GOOD: Final = 1.5  # times the best explanation's misfit
LOOSEST_ROLL_RAD: Final = 0.05  # 5 m at 100 m: beyond it a line of cameras is no survey
OVERTURNED: Final = "as it is surveyed the cameras hang upside down and what flies is under the ground"
CHECK_UP: Final = (
    "check whether positions are exchanged and whether the detector's pixels are counted from the top left; "
    "a camera that does hang upside down needs up_cam"
)
MIRRORS: Final = {  # what pictures counted from the wrong side do to the scaffold's frame and to each camera's
    "all pictures are mirrored": np.diag([-1.0, 1.0, 1.0]),
    "v is counted upwards in all pictures": np.diag([1.0, -1.0, 1.0]),
}


@dataclass(frozen=True)
class Georeference:
    """The scaffold's similarity to ENU, and which surveyed positions it does not rest on."""

    similarity: Similarity
    doubts: tuple[Believed, ...] = ()


@dataclass(frozen=True)
class _Explanation:
    """One way to read the survey. misfit_m: rms; disbelieved: whose positions it does not use as they are."""

    words: str
    fit: SimilarityFit
    upright: bool
    disbelieved: tuple[str, ...] = ()
    mends_survey: bool = True

    @property
    def misfit_m(self) -> float:
        return rms(self.fit.residual)


def georeference(scaffold: Scaffold, cameras: dict[str, SiteCamera]) -> Georeference:
    """The similarity that takes the scaffold to the surveyed positions, wrong ones found.

    Raises CalibrationError if the positions do not fix a frame (fewer than three, or in a line, and no camera says
    where up is), if they turn the world over, or if they are wrong in a way that cannot be told.
    """
    poses = scaffold.poses
    names = [name for name in sorted(poses) if cameras[name].position_enu is not None]
    source = np.array([poses[name].centre for name in names]).reshape(-1, 3)
    target = np.array([cameras[name].position_enu for name in names]).reshape(-1, 3)
    roll_rad = _roll_sigma_rad(target, [cameras[name] for name in names])
    if len(names) < HOLD_A_FRAME or roll_rad > LOOSEST_ROLL_RAD:
        return Georeference(fit_with_up(source, target, _up_directions(names, roll_rad, poses, cameras)))
    return _Survey(scaffold, cameras, tuple(names), source, target).believed()


@dataclass(frozen=True)
class _Survey:
    """The surveyed positions (n, 3) beside the scaffold's centres (n, 3) of the same cameras."""

    scaffold: Scaffold
    cameras: dict[str, SiteCamera]
    names: tuple[str, ...]
    source: Array
    target: Array

    def believed(self) -> Georeference:
        """The survey as it is, or what explains it better. Raises CalibrationError if nothing does, or too much."""
        as_it_is = self._explanation("", self.source, self.target)
        spread_m = float(np.sqrt(((self.target - self.target.mean(0)) ** 2).sum(1).mean()))
        rough_m = SUSPICIOUS_MISFIT * spread_m
        fits = as_it_is.misfit_m <= rough_m or len(self.names) < HOLD_A_FRAME + 1
        limit_m = rough_m if fits else min(CURE * as_it_is.misfit_m, 2 * rough_m)
        found = [one for one in (*self._exchanged(limit_m), *self._mirrored(limit_m)) if one.upright]
        best_m = min((one.misfit_m for one in found), default=np.inf)
        outdone = as_it_is.misfit_m > max(ROUGH * spread_m, OUTDONE * best_m)
        if as_it_is.upright and fits and not outdone:
            return Georeference(as_it_is.fit.similarity)
        found = _simplest([one for one in found if one.misfit_m <= max(AS_GOOD * best_m, rough_m / 2)])
        if not found and not fits:
            left_out = [one for one in self._one_wrong() if one.upright and one.misfit_m <= limit_m]
            found = sorted(left_out, key=lambda one: one.misfit_m)[:1]  # a place to start from; the adjustment judges
        if not found and as_it_is.upright:
            return Georeference(as_it_is.fit.similarity)  # whatever is wrong, the adjustment sees it better
        return self._gone_on_with(as_it_is, found)

    def _gone_on_with(self, as_it_is: _Explanation, found: list[_Explanation]) -> Georeference:
        left = len(self.names) - len(found[0].disbelieved) if found else 0
        if len(found) == 1 and found[0].mends_survey and left >= HOLD_A_FRAME:
            doubts = tuple(
                Believed(Doubt(Claim.POSITION, (name,), SLIPS_M[-1], 1.0), 1.0) for name in found[0].disbelieved
            )
            return Georeference(found[0].fit.similarity, doubts)
        how = f"the survey misses the cameras by {as_it_is.misfit_m:.1f} m" if as_it_is.upright else OVERTURNED
        if not found:
            raise CalibrationError(how, where="georeferencing", action=CHECK_UP)
        which = f"{found[0].words}" if len(found) == 1 else ", or ".join(one.words for one in found)
        apart = "" if len(found) == 1 else "; these cannot be told apart"
        raise ContradictionError(f"{how}: {which}{apart}", where="georeferencing", action="correct it and solve again")

    def _exchanged(self, limit_m: float) -> Iterator[_Explanation]:
        """Two positions exchanged, or three in a circle (files renamed one after the other), where that fits."""
        for count in (2, 3):
            for first, *others in combinations(range(len(self.names)), count):
                for circle in ((first, *rest) for rest in permutations(others)):
                    order = np.arange(len(self.names))
                    order[list(circle)] = np.roll(circle, 1)
                    who = tuple(self.names[index] for index in sorted(circle))
                    how = "are exchanged" if count == 2 else "are exchanged in a circle"
                    words = f"the positions of {', '.join(who[:-1])} and {who[-1]} {how}"
                    if rms(fit_similarity(self.source, self.target[order]).residual) <= limit_m:
                        found = self._explanation(words, self.source, self.target[order], who)
                        yield replace(found, mends_survey=count == 2)

    def _one_wrong(self) -> Iterator[_Explanation]:
        for index, name in enumerate(self.names):
            keep = np.arange(len(self.names)) != index
            words = f"the position of {name} is wrong"
            yield self._explanation(words, self.source[keep], self.target[keep], (name,))

    def _mirrored(self, limit_m: float) -> Iterator[_Explanation]:
        for words, mirror in MIRRORS.items():
            fit = fit_similarity(self.source @ mirror, self.target)
            if rms(fit.residual) <= limit_m:
                yield _Explanation(words, fit, self._upright(fit.similarity, mirror), mends_survey=False)

    def _explanation(self, words: str, source: Array, target: Array, who: tuple[str, ...] = ()) -> _Explanation:
        fit = fit_similarity(source, target)
        return _Explanation(words, fit, self._upright(fit.similarity, np.eye(3)), who)

    def _upright(self, similarity: Similarity, mirror: Array) -> bool:
        poses = self.scaffold.poses
        if any(self.cameras[name].up_cam is not None for name in poses):
            return True  # it is asked of the adjusted network, which knows what that camera says
        attitudes = [mirror @ pose.R @ mirror @ similarity.rotation.T for pose in poses.values()]
        centres = similarity.apply(np.array([pose.centre for pose in poses.values()]) @ mirror)
        return not upside_down(attitudes, centres, similarity.apply(self.scaffold.points @ mirror))


def _simplest(found: list[_Explanation]) -> list[_Explanation]:
    """Two exchanged, rather than three, which on a regular site is the same in a world that is turned."""
    simple = [one for one in found if len(one.disbelieved) < HOLD_A_FRAME]
    return simple or found


def _roll_sigma_rad(positions: Array, cameras: list[SiteCamera]) -> float:
    """How well a survey fixes the roll about the line its positions are nearest to, one sigma."""
    if len(positions) < HOLD_A_FRAME:
        return np.inf
    second = float(np.linalg.svd(positions - positions.mean(0), compute_uv=False)[1])
    variance = np.mean([np.trace(c.position_covariance) / 3 for c in cameras if c.position_covariance is not None])
    return float(np.sqrt(variance)) / max(second, 1e-9)


def _up_directions(names: list[str], roll_rad: float, poses: dict[str, Pose], cameras: dict[str, SiteCamera]) -> Array:
    """(U, 3) up in the scaffold's frame, from the cameras that know it. Raises CalibrationError if none helps."""
    ups = [poses[name].R.T @ up for name in sorted(poses) if (up := cameras[name].up_cam) is not None]
    if len(names) >= 2 and ups:
        return np.array(ups)
    if len(names) < HOLD_A_FRAME:
        fault = f"{len(names)} calibrated cameras have a surveyed position ({', '.join(names) or 'none'}), three must"
        cure = "survey more tripods and see that all see the flight; two suffice if one says where up is"
    else:
        fault = f"the surveyed cameras stand in a line: the roll about it is open by {np.degrees(roll_rad):.0f} degrees"
        cure = "move a camera off the line, or give one of them"
    raise CalibrationError(
        fault, where="georeferencing", action=f"{cure} (up_cam and up_sigma_deg), or solve with --local"
    )

"""Bundle adjustment, and the judging of what came of it: which camera is an outlier, which priors claim too much.

The hazard is the average. A camera with the lens file of another, or a tripod whose position was mistyped, bends
everything a little and looks fine in the sum. So after each adjustment every camera has to explain its own rows as well
as the others do theirs, and what survey, lens files and clocks claim has to agree with what the cameras saw (`strain`).
The worst camera is taken out by name, with the evidence, what is doubted is believed less, and the rest adjusted again.
"""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from calib.adjustment.bundle import LAST_WEIGHT_ROUNDS, WEIGHT_ROUNDS, Adjusted, adjust
from calib.adjustment.flight import FlightEstimate
from calib.adjustment.priors import FIXED, CameraPrior, camera_priors, held, misled, on_site_time
from calib.adjustment.problem import Problem
from calib.adjustment.projection import ROTATION
from calib.adjustment.weights import Weights
from calib.errors import CalibrationError
from calib.geometry.spline import relaid
from calib.network import Camera
from calib.solving.bootstrap import first_estimate
from calib.solving.doubts import SURVEY_OFF_M, Claim, Doubt, slight_in_all
from calib.solving.initial_estimate import InitialEstimate
from calib.solving.inputs import FEWEST_CAMERA_ROWS, Inputs
from calib.solving.rivals import started, told_apart
from calib.solving.strain import Believed, Strain, strain, widening
from calib.solving.turned import Turn, turned
from edge.common.arrays import Array

FIRST_SIGMA_RAY: Final = 0.005  # what a first estimate is good for, in ray units
FEWEST_INLIERS: Final = 0.5  # share of a camera's rows within its noise: half clutter is no camera
WITHIN_SIGMAS: Final = 3.0  # 98.9 % of good two-dimensional residuals
COARSEST: Final = 8.0  # times the other cameras' noise, in ray units: a lens or a clock that no refinement mends
DOUBT_ROUNDS: Final = 4  # of adjusting with other doubts: what is wrong is clearer the less it is believed
FITTED: Final = 0.9  # share of its rows that its first pose explains: a camera that belongs, whatever was surveyed
FEWEST_LEFT: Final = 3  # cameras: fewer would hang on the survey of two
NOTHING_WITH_IT: Final = "with it nothing can be determined: check its lens file, its clock and its frames"
GAUGE_SIGMA: Final = 1e-6  # baselines: holds a local frame without counting as knowledge


@dataclass(frozen=True)
class Refined:
    """The adjustment, its problem, and from where it was begun after all that was taken out. left_out: camera, why.

    strain: the test of what survey, lens files and clocks claim, and what was doubted; None in a local frame. turns:
    of cameras whose pose changed in flight, and of whose tracks a part was left out for it.
    """

    adjusted: Adjusted
    problem: Problem
    initial: InitialEstimate
    left_out: dict[str, str]
    strain: Strain | None = None
    turns: tuple[Turn, ...] = ()


def refine(inputs: Inputs, initial: InitialEstimate, knots_s: float) -> Refined:
    """Bundle adjustment, again and again until nothing is left that does not belong.

    Raises CalibrationError if too little is left.
    """
    attempt = _Attempt(inputs, initial, knots_s)
    while True:
        attempt.adjust()
        if attempt.without_a_camera() or attempt.with_other_doubts() or attempt.without_a_turn():
            continue
        if attempt.with_all_rows() or attempt.on_others_time():
            continue
        assert attempt.adjusted is not None
        turns = tuple(attempt.turns)
        return Refined(attempt.adjusted, attempt.problem, attempt.initial, attempt.left_out, attempt.strain, turns)


@dataclass
class _Attempt:
    """Where refining stands. weights, settled: of the round before, while the cameras stay the same.

    all_rows: whether they take part; which cameras belong and what is doubted is found on a part of many first.
    believed: what was begun with before the survey was doubted for the sake of a camera. doubted: about what, by round.
    claimed: the doubts that were begun with.
    """

    inputs: Inputs
    initial: InitialEstimate
    knots_s: float
    left_out: dict[str, str] = field(default_factory=dict)
    weights: Weights | None = None
    settled: FlightEstimate | None = None
    all_rows: bool = False
    retimed: bool = False
    believed: InitialEstimate | None = None
    doubted: list[frozenset[object]] = field(default_factory=lambda: [frozenset()])
    turns: list[Turn] = field(default_factory=list)
    adjusted: Adjusted | None = None
    strain: Strain | None = None
    claimed: tuple[Believed, ...] = field(init=False)
    problem: Problem = field(init=False)
    estimate: FlightEstimate = field(init=False)

    def __post_init__(self) -> None:
        self.claimed = self.initial.doubts

    def adjust(self) -> None:
        """Adjust what there is; `adjusted` stays None if a camera hardly saw anything, or nothing can be determined."""
        whole, estimate = problem_of(self.inputs, self.initial, self.knots_s)
        self.problem = whole if self.all_rows else whole.part
        self.estimate = _carried_on(self.settled, estimate) if self.settled else estimate
        self.adjusted = None
        if self._blind_camera() is None:
            rounds = LAST_WEIGHT_ROUNDS if self.all_rows else WEIGHT_ROUNDS
            weights = self.weights or first_weights(self.problem, self.estimate)
            weights = replace(weights, interval_s=self.problem.interval_s)
            try:
                self.adjusted = adjust(self.problem, self.estimate, weights, rounds)
            except CalibrationError:
                if _most_doubtful(self.initial) is None:
                    raise

    def without_a_camera(self) -> bool:
        """Take out the camera that does not belong, if there is one. Raises CalibrationError if too few are left.

        Not at once if it fitted the others before the survey was asked: then the survey is doubted first.
        """
        if self.adjusted is not None:
            outcast = _outcast(self.adjusted, self.problem)
            cameras = self.adjusted.estimate.cameras
        elif blind := self._blind_camera():
            outcast, cameras = (blind, "it hardly ever saw an object that another camera saw at the same time"), None
        else:
            doubtful = _most_doubtful(self.initial)
            assert doubtful is not None
            outcast, cameras = (doubtful, NOTHING_WITH_IT), None
        if outcast is None:
            return False
        if self._survey_first(outcast[0]):
            return True
        name, self.left_out[outcast[0]] = outcast
        self._begin_again(_without(self.initial, cameras or self.initial.cameras, name))
        return True

    def _survey_first(self, outcast: str) -> bool:
        """Doubt all surveyed positions, and begin again, if they may be why a camera does not belong."""
        surveyed = tuple(sorted(name for name, site in self.inputs.sites.items() if site.position_enu is not None))
        fitted = self.initial.shares.get(outcast, 0.0) >= FITTED
        if not fitted or self.initial.gauge is not None or self.adjusted is None or len(self.doubted) > 1:
            return False
        if len(self.initial.cameras) <= FEWEST_LEFT:
            return False  # without the survey, three would explain nearly anything
        positions = Believed(Doubt(Claim.POSITION, surveyed, SURVEY_OFF_M[-1], 1.0), 1.0)
        self.believed = self.initial
        self._begin_again(replace(self.initial, doubts=(positions,)))
        self.doubted.append(_about(self.initial.doubts))
        return True

    def with_other_doubts(self) -> bool:
        """Believe less what the adjustment contradicts, if that is not what was believed less already."""
        assert self.adjusted is not None
        if self.initial.gauge is not None:
            return False
        found = strain(self.adjusted, self.problem, self.inputs.sites)
        if self.believed is not None and all(one.doubt.claim is not Claim.POSITION for one in found.doubts):
            self._begin_again(self.believed)  # the survey was not the reason
            self.believed = None
            return True
        self.believed = None
        doubts = self._steady(told_apart(self.adjusted, self.problem, self.inputs.sites, found.doubts))
        self.strain = replace(found, doubts=doubts)
        if len(self.doubted) > DOUBT_ROUNDS or _covered(self.strain.doubts, self.initial.doubts):
            return False
        (weighed, stated), (before, _) = (_parted(d, self.problem) for d in (self.strain.doubts, self.initial.doubts))
        if _covered(weighed, before):  # only what is stated changes: adjusting anew would find the same
            self.initial = replace(self.initial, doubts=self.strain.doubts)
            self.problem = replace(self.problem, beyond=widening(stated, self.problem.prior))
            return False
        self.doubted.append(_about(self.strain.doubts))
        self._go_on(
            started(self.adjusted.estimate, self.problem, self.inputs.sites, self.strain.doubts), self.strain.doubts
        )
        return True

    def without_a_turn(self) -> bool:
        """Leave out what a camera saw before or after it was turned, and doubt anew: until then others seemed wrong."""
        assert self.adjusted is not None
        turn = turned(self.adjusted, self.problem)
        if turn is None or any(turn.camera == one.camera for one in self.turns):
            return False
        self.turns.append(turn)
        cameras = self.adjusted.estimate.cameras
        camera = next(camera for camera in cameras if camera.id == turn.camera)
        tracks = {**self.initial.tracks, camera.id: turn.cut(camera, self.initial.tracks[camera.id])}
        self._begin_again(replace(self.initial, cameras=cameras, tracks=tracks, doubts=self.claimed))
        self.doubted, self.believed = [frozenset()], None
        return True

    def with_all_rows(self) -> bool:
        """Go on with all rows, if only a part of them took part."""
        assert self.adjusted is not None
        if self.all_rows or self.problem.whole:
            return False
        self.all_rows = True
        self._go_on(self.adjusted.estimate, self.initial.doubts)
        return True

    def on_others_time(self) -> bool:
        """Adjust once more against the clocks that most agree on, if the one that was taken for the time is not one."""
        assert self.adjusted is not None
        if self.retimed or not misled(self.adjusted.estimate.cameras, self.inputs.sites):
            return False
        self.retimed = True
        self._go_on(self.adjusted.estimate, self.initial.doubts)
        return True

    def _go_on(self, estimate: FlightEstimate, doubts: tuple[Believed, ...]) -> None:
        assert self.adjusted is not None
        self.initial = replace(self.initial, cameras=estimate.cameras, doubts=doubts)
        self.weights, self.settled = self.adjusted.weights, estimate

    def _begin_again(self, initial: InitialEstimate) -> None:
        self.initial, self.weights, self.settled, self.all_rows = initial, None, None, False

    def _steady(self, doubts: tuple[Believed, ...]) -> tuple[Believed, ...]:
        """What is doubted; with the positions doubted until now, where these doubts have led there and back already."""
        if _about(doubts) == self.doubted[-1] or _about(doubts) not in self.doubted:
            return doubts
        places = [one for one in self.initial.doubts if one.doubt.claim is Claim.POSITION]
        return (*doubts, *(one for one in places if one.doubt.about not in _about(doubts)))

    def _blind_camera(self) -> str | None:
        pairs = zip(self.estimate.cameras, self.problem.data, strict=True)
        return next((camera.id for camera, seen in pairs if len(seen.t_s) < FEWEST_CAMERA_ROWS), None)


def _carried_on(settled: FlightEstimate, anew: FlightEstimate) -> FlightEstimate:
    """An estimate begun anew with the flight as it had settled, where the same was flown."""
    before = {camera.id: camera.clock_offset_s for camera in settled.cameras}
    later_s = float(np.median([camera.clock_offset_s - before[camera.id] for camera in anew.cameras]))
    control = relaid(settled.control, settled.flight, anew.flight, later_s)
    return replace(anew, control=np.where(np.isfinite(control), control, anew.control))


def _about(doubts: tuple[Believed, ...]) -> frozenset[object]:
    return frozenset(one.doubt.about for one in doubts)


def _covered(doubts: tuple[Believed, ...], allowed: tuple[Believed, ...]) -> bool:
    """Whether just these doubts were allowed for, and in no smaller size: adjusting anew would change nothing."""
    rooms = {one.doubt.about: one.doubt.room for one in allowed}
    return _about(doubts) == rooms.keys() and all(
        all(own <= room for own, room in zip(one.doubt.room, rooms[one.doubt.about], strict=True)) for one in doubts
    )


def _most_doubtful(initial: InitialEstimate) -> str | None:
    """The camera whose first pose explained least, if it is worse than the others and three are left without it."""
    shares = {camera.id: initial.shares.get(camera.id, 1.0) for camera in initial.cameras}
    worst = min(sorted(shares), key=lambda name: shares[name])
    enough = len(shares) > FEWEST_LEFT and worst not in (initial.gauge or ())
    return worst if enough and shares[worst] < float(np.median(list(shares.values()))) else None


def problem_of(inputs: Inputs, initial: InitialEstimate, knots_s: float) -> tuple[Problem, FlightEstimate]:
    """What is adjusted, and the estimate that the adjustment begins with."""
    cameras = on_site_time(initial.cameras, inputs.sites)
    priors = camera_priors(cameras, inputs.sites)
    if initial.gauge:
        priors = _local_gauge(priors, initial.gauge)
    cameras = tuple(map(held, cameras, priors))
    estimate, data = first_estimate(
        inputs.scene,
        cameras,
        initial.tracks,
        initial.objects,
        t_mid=inputs.t_mid_unix_ns,
        spacing_s=knots_s,
    )
    plain = Problem(data, priors)
    weighed, stated = _parted(initial.doubts, plain)
    widened = widening(weighed, plain.prior) if weighed else None
    beyond = widening(stated, plain.prior) if stated else None
    return replace(plain, widened=widened, beyond=beyond), estimate


def _parted(doubts: tuple[Believed, ...], problem: Problem) -> tuple[tuple[Believed, ...], tuple[Believed, ...]]:
    """Doubts that priors are weighed by, and those that only what is stated grows by."""
    slight = [slight_in_all(one.doubt, problem.prior) for one in doubts]
    pairs = list(zip(doubts, slight, strict=True))
    return tuple(one for one, only in pairs if not only), tuple(one for one, only in pairs if only)


def _local_gauge(priors: tuple[CameraPrior, ...], gauge: tuple[str, str]) -> tuple[CameraPrior, ...]:
    """Priors that hold the first camera's pose and the way to the second: seven freedoms no pixel can know."""
    by_id = {prior.mean.id: prior for prior in priors}
    one, two = (by_id[name] for name in gauge)
    along = two.mean.centre_enu - one.mean.centre_enu
    sigma = one.sigma.copy()
    sigma[ROTATION] = FIXED
    by_id[gauge[0]] = replace(one, sigma=sigma, centre_information=np.eye(3) / GAUGE_SIGMA**2)
    by_id[gauge[1]] = replace(two, centre_information=np.outer(along, along) / (along @ along) / GAUGE_SIGMA**2)
    return tuple(by_id[prior.mean.id] for prior in priors)


def first_weights(problem: Problem, estimate: FlightEstimate) -> Weights:
    """Weights for an estimate that nothing has been adjusted of yet: rather too wide."""
    hops = np.linalg.norm(np.diff(estimate.control, axis=0), axis=1)
    speed = float(np.median(hops)) / estimate.flight.spacing_s
    sigma = np.array([FIRST_SIGMA_RAY * camera.lens.intrinsics[0] for camera in estimate.cameras])
    return Weights(sigma, problem.interval_s, 0.0, max(speed, 1e-3) ** 2)


def _without(initial: InitialEstimate, cameras: tuple[Camera, ...], name: str) -> InitialEstimate:
    """Begin again without a camera. Raises CalibrationError if fewer than two are left, or it held the frame."""
    cameras = tuple(camera for camera in cameras if camera.id != name)
    if len(cameras) < 2 or name in (initial.gauge or ()):
        raise CalibrationError(
            f"{name} does not fit, and without it nothing can be calibrated",
            where="adjustment",
            action=f"check lens file, clock and detector of {name}",
        )
    objects = {key: number for key, number in initial.objects.items() if key[0] != name}
    return replace(initial, cameras=cameras, objects=objects)


def noise_ray(adjusted: Adjusted) -> Array:
    """(C,) one sigma of each camera's residuals in ray units."""
    focal = np.array([camera.lens.intrinsics[0] for camera in adjusted.estimate.cameras])
    return np.asarray(adjusted.weights.sigma_px / focal, float)


def _outcast(adjusted: Adjusted, problem: Problem) -> tuple[str, str] | None:
    """The camera that explains its rows worst, and how badly; None if all are fit to stay."""
    noise = noise_ray(adjusted)
    for index in np.argsort(-noise).tolist():
        camera, image = adjusted.estimate.cameras[index], adjusted.projected[index]
        others = float(np.median(np.delete(noise, index)))
        sigma = adjusted.told_sigma_px(index) * problem.data[index].sigma_px
        share = float(np.mean(image.valid & (np.linalg.norm(image.residual, axis=1) < WITHIN_SIGMAS * sigma)))
        if len(noise) > 2 and noise[index] > COARSEST * others:
            return camera.id, (
                f"its rows miss by {1e3 * noise[index]:.1f} mrad where the others miss by {1e3 * others:.2f}: "
                "check its lens file, its clock and what it detects"
            )
        if share < FEWEST_INLIERS:
            return camera.id, (
                f"only {100 * share:.0f} % of its rows are explained by any position of the object: "
                "check what it detects"
            )
    return None

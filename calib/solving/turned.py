"""Cameras whose pose changed in flight: a tripod that was knocked, moved or sank, found after everything is adjusted.

The hazard is the average pose. A camera that was turned halfway is adjusted to stand between its two poses, drags the
flight with it, and spreads what is left over all cameras, whose claims then seem to be at fault. So each camera is
tested for a turn at each of several instants: the score of that one change, flight and cameras following, is a
chi-square with three degrees of freedom (Rao 1948), and costs no adjustment. Who is turned is said only where three
others agree without it.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np

from calib.adjustment.bundle import Adjusted
from calib.adjustment.normal import Normal
from calib.adjustment.problem import Point, Problem, Whitened
from calib.adjustment.projection import CAMERA_SIZE, ROTATION, site_time_s, unknowns_of
from calib.network import Camera
from calib.solving.found import Cause, Found
from calib.solving.series import SHORTEST_TRACK, TrackSeries
from edge.common.arrays import Array

TURN_INSTANTS: Final = 16  # at which a turn is looked for
FEWEST_ROWS: Final = 50  # of a camera on either side
FEWEST_TO_NAME: Final = 4  # one that turned, and three that agree without it
TURNED: Final = 45.0  # chi-square of three, with which a camera has turned: by chance once in a billion, by drift never
OTHERS_OUTDONE: Final = 3.0  # times what a turn of any other camera explains
WORST_CONDITION: Final = 1e9  # of a turn's information: beyond it, some of the turn is not seen
LARGEST_RAD: Final = float(np.radians(6.0))  # one that is turned further no longer sees the object, or never saw it


@dataclass(frozen=True)
class Turn:
    """A camera's turn by turn_rad (3,) in its own frame, within within_s of t_s (site time from t_mid) either way.

    statistic: the chi-square of three degrees of freedom that it explains. kept_before: whether the rows before it are
    used, and not those after it.
    """

    camera: str
    t_s: float
    within_s: float
    turn_rad: Array
    statistic: float
    kept_before: bool

    def cut(self, camera: Camera, tracks: list[TrackSeries]) -> list[TrackSeries]:
        """What is used of the camera's tracks."""
        kept = []
        for track in tracks:
            site_s = track.t_s * (1 + camera.clock_rate) + camera.clock_offset_s
            before, after = site_s < self.t_s - self.within_s, site_s > self.t_s + self.within_s
            kept.append(track.rows(before if self.kept_before else after))
        return [track for track in kept if len(track.t_s) >= SHORTEST_TRACK]

    def found(self, t_mid_unix_ns: int) -> Found:
        """The finding."""
        at = datetime.fromtimestamp(t_mid_unix_ns * 1e-9 + self.t_s, UTC)
        which = "after" if self.kept_before else "before"
        degrees = float(np.degrees(np.linalg.norm(self.turn_rad)))
        sentence = (
            f"{self.camera} was turned or moved at about {at:%Y-%m-%d %H:%M:%S} UTC, by {degrees:.1f} degrees: its "
            f"rows {which} that were not used"
        )
        return Found(Cause.POSE, (self.camera,), sentence, cure="fix its tripod, and survey it again if it was moved")


def turned(adjusted: Adjusted, problem: Problem) -> Turn | None:
    """The camera that turned in flight, if there is one beyond doubt."""
    if len(problem.data) < FEWEST_TO_NAME:
        return None
    turns = sorted(_turns(adjusted, problem), key=lambda turn: -turn.statistic)
    others = max((turn.statistic for turn in turns[1:]), default=0.0)
    sure = bool(turns) and turns[0].statistic > max(TURNED, OTHERS_OUTDONE * others)
    return turns[0] if sure and np.linalg.norm(turns[0].turn_rad) < LARGEST_RAD else None


def _turns(adjusted: Adjusted, problem: Problem) -> list[Turn]:
    """The likeliest turn of each camera that saw enough before and after one."""
    parts = Point.at(problem, adjusted.estimate, adjusted.weights).whitened()
    found = [_likeliest(adjusted, index, problem, part) for index, part in enumerate(parts)]
    return [turn for turn in found if turn is not None]


def _likeliest(adjusted: Adjusted, index: int, problem: Problem, part: Whitened) -> Turn | None:
    camera = adjusted.estimate.cameras[index]
    t_s = site_time_s(camera, problem.data[index])
    instants = np.linspace(t_s.min(), t_s.max(), TURN_INSTANTS + 2)
    within_s = float(instants[1] - instants[0])
    best: Turn | None = None
    for at_s in instants[1:-1].tolist():
        after = t_s >= at_s
        rows, before = int(after.sum()), int((~after).sum())
        if min(rows, before) < FEWEST_ROWS:
            continue
        score, information = _scored(adjusted, index, part.rows(after))
        if np.linalg.cond(information) > WORST_CONDITION:
            continue  # of a camera that holds a local frame, or saw the object at one place only
        turn_rad = np.asarray(np.linalg.solve(information, score), float)
        statistic = float(score @ turn_rad)
        if best is None or statistic > best.statistic:
            best = Turn(camera.id, at_s, within_s, turn_rad, statistic, kept_before=before > rows)
    return best


def _scored(adjusted: Adjusted, index: int, part: Whitened) -> tuple[Array, Array]:
    """Score (3,) and information (3, 3) of a turn of these rows alone, flight, cameras and priors following."""
    normal, factor, border = adjusted.normal, adjusted.factor, len(adjusted.normal.right_camera)
    own = Normal.zero(len(adjusted.estimate.control), CAMERA_SIZE)
    part.add_to(own, slice(0, CAMERA_SIZE))
    by_turn = own.border[:, :, ROTATION].reshape(-1, 3)
    followed = factor.flight.solve(by_turn)
    cross = -by_turn.T @ factor.carried
    cross[:, unknowns_of(index)] += own.corner[ROTATION]
    carried = cross @ factor.camera_covariance
    information = own.corner[ROTATION, ROTATION] - by_turn.T @ followed - carried @ cross.T
    # What is left to settle of all the others pulls too.
    flight = factor.flight.solve(normal.right_control.ravel())
    left = normal.right_camera - normal.border.reshape(-1, border).T @ flight
    return own.right_camera[ROTATION] - by_turn.T @ flight - carried @ left, information


def without(
    turn: Turn, cameras: tuple[Camera, ...], tracks: dict[str, list[TrackSeries]]
) -> dict[str, list[TrackSeries]]:
    """All tracks, the turned camera's cut."""
    camera = next(camera for camera in cameras if camera.id == turn.camera)
    return {**tracks, turn.camera: turn.cut(camera, tracks[turn.camera])}

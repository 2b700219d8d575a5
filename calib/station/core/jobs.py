"""What the station asks of its solver, and what comes back: plain data, so that a process can stand between them."""

from dataclasses import dataclass

from calib.errors import SkyfixError
from calib.network import Network
from calib.observations import Scene


@dataclass(frozen=True)
class Solved:
    """What the live station needs of a solution, in words that need no solver to be read.

    sigma_m: median one sigma of the flight's positions. left_out: camera and why. findings: what was found wrong.
    grade: of what is claimed of the site, A to E; verdict: why; improvement: what to do.
    """

    network: Network
    sigma_m: float
    left_out: tuple[tuple[str, str], ...] = ()
    findings: tuple[str, ...] = ()
    grade: str = "A"
    verdict: str = ""
    improvement: str = ""


@dataclass(frozen=True)
class SolveJob:
    """A scene to solve, from a network if there is one to begin with."""

    number: int
    scene: Scene
    start: Network | None = None


@dataclass(frozen=True)
class SolveResult:
    """A job's result, or why there is none; and the seconds it took."""

    number: int
    solved: Solved | None
    error: SkyfixError | None
    seconds: float

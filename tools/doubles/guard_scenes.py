"""Random scenes for the guard: 3, 4 or 6 cameras, one drone or several, and what happens to one camera, or nothing.

Everything is drawn from the scene's own number: the same number, the same scene, on every processor.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from calib.guarding.meetings import attitude_sigma
from calib.observations import Frame
from tools.doubles.faults import CameraFault, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, frames, make

Kind = Literal["none", "box", "knock", "clock", "tilt"]

QUIET: Final = ("none", "box")  # kinds in which nothing happens
KINDS: Final[tuple[Kind, ...]] = ("none", "box", "knock", "knock", "clock", "clock", "tilt", "knock")
EVENT_S: Final = 14.0
AFTER_S: Final = 14.0
KNOCK_DEG: Final = (0.2, 3.0)
STEP_S: Final = (0.02, 0.5)
TILT_DEG_S: Final = (0.03, 0.1)
BOUNDS_S: Final = (0.001, 0.005, None)
BOX_TURNS_S: Final = (15.0, 60.0)  # in which an object turns once, and with it where in its box its middle is
STEP_NS: Final = 500_000_000
WITNESSES: Final = 3  # others that see the same object
LENS_PX: Final = 0.3  # one sigma of what a lens model leaves
DETECTED_S: Final = 5.0  # of visible flight, in which a fault should be found
PACE_S: Final = 0.5  # over which an object's pace in the image is measured: noise is small beside it


@dataclass(frozen=True)
class GuardScene:
    """A scene, what happens in it at EVENT_S, to whom, and what bound all clocks state."""

    number: int
    kind: Kind
    scene: Scene
    fault: CameraFault
    victim: str
    bound_s: float | None

    @property
    def begins_s(self) -> float:
        """When there is something to be noticed: of a tilt, when it has reached the least of knocks."""
        tilt = abs(self.fault.tilt_deg_per_s)
        return EVENT_S + (KNOCK_DEG[0] / tilt if tilt else 0.0)

    @property
    def name(self) -> str:
        """In a few words."""
        bound = "no bound" if self.bound_s is None else f"{self.bound_s * 1e3:g} ms"
        spec = self.scene.spec
        what = f"{self.kind} {self.fault.name} {self.victim}" if self.fault.name else self.kind
        return f"{self.number}: {spec.cameras} cameras, {spec.uavs} drones, {bound}, {what}"

    def stream(self) -> Iterator[tuple[int, Frame]]:
        """(arrival ns, frame) of all cameras, with what happens."""
        if self.kind == "box":
            return _off_centre(frames(self.scene), self.number)
        if self.kind == "none":
            return frames(self.scene)
        return faulty_frames(self.scene, self.fault, EVENT_S, self.victim)


def draw(number: int, cameras: Sequence[int] = (3, 4, 6)) -> GuardScene:
    """Scene of that number."""
    rng = np.random.default_rng((number, 16))
    kind = KINDS[number % len(KINDS)]
    spec = Spec(
        cameras=int(cameras[number // len(KINDS) % len(cameras)]),
        rate_hz=15.0,
        uavs=int(rng.choice([1, 1, 2, 4])),
        birds=int(rng.choice([0, 0, 0, 3])),
        duration_s=EVENT_S + AFTER_S,
        noise_px=float(rng.uniform(0.4, 1.2)),
        dropout=float(rng.choice([0.0, 0.1, 0.3])),
        clutter=float(rng.choice([0.0, 0.5])),
        radius_m=float(rng.uniform(60.0, 130.0)),
        height_m=float(rng.uniform(30.0, 60.0)),
        seed=1000 + number,
    )
    victim = f"cam{int(rng.integers(spec.cameras))}"
    bound_s = BOUNDS_S[int(rng.integers(len(BOUNDS_S)))]
    sign = float(rng.choice([-1.0, 1.0]))
    fault = CameraFault("")
    if kind == "knock":
        turn_deg = _between(rng, KNOCK_DEG)
        fault = CameraFault(f"by {turn_deg:.2f} degrees", turn_deg=turn_deg)
    elif kind == "clock":
        step_s = sign * _between(rng, STEP_S)
        fault = CameraFault(f"by {step_s * 1e3:.0f} ms", step_s=step_s)
    elif kind == "tilt":
        tilt = sign * _between(rng, TILT_DEG_S)
        fault = CameraFault(f"by {tilt:.3f} degrees a second", tilt_deg_per_s=tilt)
    return GuardScene(number, kind, make(spec), fault, victim, bound_s)


def _between(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """As often small as large, in ratios."""
    return float(np.exp(rng.uniform(*np.log(ends))))


def _off_centre(stream: Iterator[tuple[int, Frame]], seed: int) -> Iterator[tuple[int, Frame]]:
    """Boxes that are off their object by up to half their width, by another phase for each camera and track."""
    for arrival_ns, frame in stream:
        assert frame.width_px is not None
        pixels = frame.pixels.copy()
        for k, label in enumerate(frame.label.tolist()):
            rng = np.random.default_rng((seed, int(frame.camera[3:]), label))
            phase, turn_s = rng.uniform(0, 2 * np.pi), rng.uniform(*BOX_TURNS_S)
            angle = phase + 2 * np.pi * (frame.t_unix_ns - T0_UNIX_NS) * 1e-9 / turn_s
            pixels[k, 0] += frame.width_px[k] / 2 * np.cos(angle)
        yield arrival_ns, replace(frame, pixels=pixels)


def visible_s(drawn: GuardScene) -> Callable[[int], float]:
    """Of an instant: for how long the victim and enough others saw one object, since there was anything to notice.

    Enough are three others, or two where there are but three cameras. Counted in steps of half a second.
    """
    scene, step_ns = drawn.scene, T0_UNIX_NS + round(drawn.begins_s * 1e9)
    enough = min(WITNESSES, scene.spec.cameras - 1)
    edges, total, seen = [], 0.0, []
    rows = scene.simulated.rows
    while step_ns < T0_UNIX_NS + round(scene.spec.duration_s * 1e9):
        reported = {
            name: {
                int(source)
                for source in np.unique(own.source[(own.t_unix_ns >= step_ns) & (own.t_unix_ns < step_ns + STEP_NS)])
                if source > 0
            }
            for name, own in rows.items()
        }
        shared = any(
            sum(source in own for name, own in reported.items() if name != drawn.victim) >= enough
            for source in reported[drawn.victim]
        )
        total += shared * STEP_NS * 1e-9
        step_ns += STEP_NS
        edges.append(step_ns)
        seen.append(total)
    return lambda t_unix_ns: float(np.interp(t_unix_ns, [edges[0] - STEP_NS, *edges], [0.0, *seen]))


def shift_sigma(drawn: GuardScene) -> float:
    """By how many sigma the fault moves the victim's pixels, in the mean over the first seconds that count as visible.

    Sigma is of the mean of a second's rows: their noise, what a lens model leaves, and what the calibration itself
    states of that camera's attitude. Whatever a guard is like, it cannot see what is hardly larger.
    """
    scene = drawn.scene
    spec, camera = scene.spec, next(one for one in scene.truth if one.id == drawn.victim)
    focal_px = min(camera.lens.intrinsics[:2])
    sigma_px = float(np.sqrt(spec.noise_px**2 / max(spec.rate_hz * (1 - spec.dropout), 1.0) + LENS_PX**2))
    sigma_px = float(np.hypot(sigma_px, focal_px * attitude_sigma(scene.network, drawn.victim)))
    fault = drawn.fault
    if drawn.kind != "clock":
        return float(focal_px * np.radians(fault.turn_deg or KNOCK_DEG[0]) / sigma_px)
    own, visible = scene.simulated.rows[drawn.victim], visible_s(drawn)
    begin_ns = T0_UNIX_NS + round(EVENT_S * 1e9)
    shifts = []
    for source in np.unique(own.source[own.source > 0]):
        rows = (own.source == source) & (own.t_unix_ns >= begin_ns)
        rows &= np.array([visible(t) <= DETECTED_S for t in own.t_unix_ns.tolist()])
        t_s, pixels = (own.t_unix_ns[rows] - begin_ns) * 1e-9, own.pixels[rows]
        again = np.searchsorted(t_s, t_s + PACE_S)
        near = again < len(t_s)
        near[near] &= t_s[again[near]] - t_s[near] < 2 * PACE_S
        pace = (pixels[again[near]] - pixels[near]) / (t_s[again[near]] - t_s[near])[:, None]
        shifts += np.linalg.norm(pace * fault.step_s, axis=1).tolist()
    return float(np.mean(shifts)) / sigma_px if shifts else 0.0

"""Kinds of scenes that a tracker has to follow, and what is wrong with their cameras: the benches' and the tests' own.

Each kind is a generator: another seed is another scene of the same kind. What a tracker is given is made as in
`flight.py`: a network off by errors of its own covariance. What is changed on the way to it (a number for each row, a
box off the object's middle, frames that come late) is what real boxes do.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from calib.observations import Frame
from calib.simulation.description import Blind, CameraSpec, Simulation
from calib.simulation.simulation import watch
from edge.common.arrays import Array
from tools.doubles.flight import ORIGIN, T0_UNIX_NS, Scene, Spec, frames, network_of
from tools.doubles.motions import MIDDLE, agile, calm, circle, flown, hover_and_sprint, passing, turn_after_calm

RING_M: Final = {3: 40.0, 4: 45.0, 6: 60.0}  # radius of the cameras' ring, by how many they are
FOCAL_PX: Final = 1150.0
HOMES_ENU: Final = ((-13.0, 0.0, 45.0), (13.0, 4.0, 48.0), (0.0, -14.0, 41.0))  # so far apart that none is another

Fly = Callable[[np.random.Generator, float], Array]


@dataclass(frozen=True)
class Kind:
    """fly: waypoints of the one object; None: three calm ones. boxes: changes to each camera. See `frames_of`."""

    name: str
    fly: Fly | None = None
    cameras: int = 4
    rate_hz: tuple[float, ...] = (30.0,)
    duration_s: float = 12.0
    aim_enu: tuple[float, float, float] = MIDDLE
    late_s: tuple[float, ...] = ()
    claimed: float = 1.0  # times its true noise that a detector says
    drift_px: float = 0.0
    box_off_m: float = 0.0  # that a box's centre is beside the object, constant by camera and object
    numbers: str = "box"  # "box": as a good one; "row": each row anew; "none": 0
    blind: tuple[float, float] | None = None  # s between which all cameras but the last see nothing


KINDS: Final = (
    Kind("calm"),
    Kind("calm, three cameras", cameras=3),
    *(Kind(f"calm, then {g} g, 15 Hz", partial(turn_after_calm, turn_g=g), 3, (15.0,)) for g in (1.5, 2.0, 3.0)),
    Kind("calm, then 3 g", partial(turn_after_calm, turn_g=3.0)),
    Kind("hover and sprint", hover_and_sprint),
    Kind("agile, 4 g", partial(agile, most_g=4.0)),
    Kind("agile, 4 g, 15 Hz", partial(agile, most_g=4.0), 3, (15.0,)),
    Kind("circle, 25 m/s, 3 g, 15 Hz", partial(circle, speed_m_s=25.0, turn_g=3.0), 3, (15.0,)),
    Kind("circle, 40 m/s, 5 g", partial(circle, speed_m_s=40.0, turn_g=5.0)),
    Kind("two of three late by 0.4 s", cameras=3, late_s=(0.0, 0.4, 0.4)),
    *(
        Kind(
            f"pass at {km:g} km", partial(passing, away_m=1000.0 * km, speed_m_s=speed), aim_enu=(0, 950 * km, 300 * km)
        )
        for km, speed in ((1.0, 10.0), (2.0, 60.0), (2.9, 60.0))
    ),
    Kind("one camera alone for 5 s", blind=(5.0, 10.0), duration_s=16.0),
    Kind("box off by 0.25 m", box_off_m=0.25),
    Kind("box off by 0.25 m, three cameras", cameras=3, box_off_m=0.25),
    Kind("errors that last 1.5 s", drift_px=1.0),
    Kind("half of its noise claimed", claimed=0.5),
    Kind("a number for each row", numbers="row"),
    Kind("no numbers", numbers="none"),
    Kind("5 to 60 Hz", rate_hz=(5.0, 15.0, 30.0, 60.0)),
)


def scene_of(kind: Kind, seed: int) -> Scene:
    """The scene of a kind and seed."""
    rng = np.random.default_rng([seed, len(kind.name)])
    homes = HOMES_ENU if kind.fly is None else ()
    objects = [flown(calm(rng, kind.duration_s + 1, home), f"uav{k}") for k, home in enumerate(homes)]
    objects += [] if kind.fly is None else [flown(kind.fly(rng, kind.duration_s + 1))]
    cameras = tuple(_camera(kind, k, rng) for k in range(kind.cameras))
    described = Simulation(
        name="kinds",
        seed=seed,
        origin=ORIGIN,
        start_unix_ns=T0_UNIX_NS,
        duration_s=kind.duration_s,
        object=tuple(objects),
        camera=cameras,
    )
    spec = Spec(cameras=kind.cameras, duration_s=kind.duration_s, seed=seed)
    watched = watch(described)
    return Scene(spec, watched, network_of(spec, watched, rng))


def _camera(kind: Kind, k: int, rng: np.random.Generator) -> CameraSpec:
    angle = 2 * np.pi * k / kind.cameras + rng.uniform(-0.15, 0.15)
    radius_m, rate_hz = RING_M[kind.cameras], kind.rate_hz[k % len(kind.rate_hz)]
    aim = np.array(kind.aim_enu) + rng.uniform(-3, 3, 3)
    blind = kind.blind if _goes_blind(kind, k) else None
    return CameraSpec(
        id=f"cam{k}",
        intrinsics=(FOCAL_PX, FOCAL_PX, 959.5, 539.5),
        distortion=(-0.08, 0.01, 0.0, 0.0, 0.0),
        centre_enu=(radius_m * np.cos(angle), radius_m * np.sin(angle), rng.uniform(1, 3)),
        look_at_enu=(float(aim[0]), float(aim[1]), float(aim[2])),
        frame_rate_hz=rate_hz,
        frames=int(kind.duration_s * rate_hz),
        phase_s=rng.uniform(0, 1 / rate_hz),
        noise_px=1.0,
        drift_px=kind.drift_px,
        drift_s=1.5,
        dropout=0.05,
        blind=() if blind is None else (Blind(from_s=blind[0], to_s=blind[1]),),
        track_gap_s=1.0,
    )


def _goes_blind(kind: Kind, camera: int) -> bool:
    return camera < kind.cameras - 1


def hidden(kind: Kind, camera: int, t_s: float) -> bool:
    """Whether a camera sees nothing at a time."""
    return kind.blind is not None and _goes_blind(kind, camera) and kind.blind[0] <= t_s <= kind.blind[1]


def frames_of(kind: Kind, scene: Scene) -> Iterator[Frame]:
    """What arrives of a scene, in that order, with all that is wrong with it."""
    rng = np.random.default_rng([scene.spec.seed, 1])
    side = {f"cam{k}": rng.choice([-1.0, 1.0], 100) for k in range(kind.cameras)}
    late_ns = dict(zip(side, [round(1e9 * s) for s in kind.late_s or [0.0] * kind.cameras], strict=True))
    arrivals = [(arrival + late_ns[frame.camera], frame) for arrival, frame in frames(scene)]
    fresh = 10_000
    for _, frame in sorted(arrivals, key=lambda one: one[0]):
        pixels, label = frame.pixels.copy(), frame.label
        if kind.box_off_m:
            pixels[:, 0] += side[frame.camera][frame.label % 100] * kind.box_off_m * FOCAL_PX / RING_M[kind.cameras]
        if kind.numbers == "row":
            label = fresh + np.arange(len(label))
            fresh += len(label)
        elif kind.numbers == "none":
            label = np.zeros_like(label)
        yield replace(frame, pixels=pixels, label=label, sigma_px=frame.sigma_px * kind.claimed)

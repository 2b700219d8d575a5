"""What a scene file may hold: one seeded TOML says everything that is true, and everything that is wrongly believed.

The hazard is a simulation that only ever tests its own assumptions. So each error of the real world has a key of its
own (clock, lens, survey, knocks, drops, clutter, noise that is correlated in time), all off by default, and truth and
belief are kept apart: what a key calls `published` or `_error` is what the site file says, the rest is what happens.

All times `_s` are seconds of the site's time since `start_unix_ns`; all `_enu` are metres about `origin`.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from edge.lens import DEFAULT_LENS, LensName

Metres3 = tuple[float, float, float]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
NotNegative = Annotated[float, Meta(ge=0, le=1e6)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]


class Roam(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Flies at random: accelerations of one sigma `sigma_m_s2` an axis that last `tau_s`, and a pull to `home_enu`.

    It starts anywhere within `spread_m` of home, at a velocity of one sigma `speed_m_s` an axis. The defaults are a
    drone that somebody flies by hand.
    """

    home_enu: Metres3
    spread_m: tuple[NotNegative, NotNegative, NotNegative] = (40.0, 40.0, 25.0)
    speed_m_s: NotNegative = 4.0
    sigma_m_s2: NotNegative = 2.0
    tau_s: Annotated[float, Meta(ge=0.1, le=1e3)] = 1.5


class ObjectSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something that flies: a cubic spline through waypoints, `step_s` apart (or at `times_s`), at rest nowhere.

    With `roam` in place of waypoints it flies at random, another way with each seed of the scene.
    """

    name: Name = "drone"
    kind: Literal["drone", "bird", "aeroplane", "helicopter"] = "drone"
    waypoints_enu: Annotated[tuple[Metres3, ...], Meta(min_length=2)] = ()
    roam: Roam | None = None
    step_s: Positive = 1.0
    times_s: tuple[float, ...] | None = None
    start_s: float = 0.0
    boundary: Literal["not-a-knot", "natural", "clamped"] = "not-a-knot"
    width_m: Positive = 0.5
    height_m: Positive = 0.2


class Bump(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The tripod is knocked at `at_s`: turned by a rotation vector in camera axes, and moved."""

    at_s: float
    rotation_deg: Metres3 = (0.0, 0.0, 0.0)
    shift_m: Metres3 = (0.0, 0.0, 0.0)


class ClockStep(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The box's clock is stepped at `at_s`: from then on its stamps are `step_s` later."""

    at_s: float
    step_s: float


class Blind(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The camera delivers no detections from `from_s` to `to_s`."""

    from_s: float
    to_s: float


class LensFault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One sigma of what is drawn onto the published lens: focal as a fraction, centre in pixels, k1 or its like."""

    focal: NotNegative = 0.0
    centre_px: NotNegative = 0.0
    k1: NotNegative = 0.0


class CameraSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera: how it stands and sees in truth, and what its site file says.

    Aim it with `look_at_enu`, or with `heading_deg` (clockwise from north) and `elevation_deg`; `roll_deg` turns it
    clockwise about its axis. Its frames fire at `phase_s + k / frame_rate_hz` on its own clock, which is slow by
    `clock_offset_s` and loses `clock_rate` seconds a second (about the middle of the scene).
    """

    id: Name
    size_px: tuple[Annotated[int, Meta(ge=16, le=65535)], Annotated[int, Meta(ge=16, le=65535)]] = (1920, 1080)
    lens: LensName = DEFAULT_LENS
    intrinsics: tuple[float, float, float, float] = (1000.0, 1000.0, 960.0, 540.0)
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    published_intrinsics: tuple[float, float, float, float] | None = None
    published_distortion: tuple[float, ...] | None = None
    lens_error: LensFault = LensFault()

    centre_enu: Metres3
    look_at_enu: Metres3 | None = None
    heading_deg: float = 0.0
    elevation_deg: float = 0.0
    roll_deg: float = 0.0
    bump: tuple[Bump, ...] = ()

    surveyed: bool = True
    survey_sigma_m: tuple[NotNegative, NotNegative, NotNegative] = (0.02, 0.02, 0.04)
    survey_error: Literal["none", "gaussian", "uniform"] = "none"
    survey_error_m: Metres3 = (0.0, 0.0, 0.0)  # a fixed error, a mistyped position say; the drawn one comes on top

    frame_rate_hz: Positive = 30.0
    frames: Annotated[int, Meta(ge=1)] | None = None  # None: as many as the scene is long
    phase_s: float = 0.0
    exposure_s: NotNegative = 0.004
    readout_s: NotNegative = 0.0
    publish_readout: bool = True
    frame_drop: Fraction = 0.0
    clock_offset_s: float = 0.0
    clock_rate: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.0
    clock_bound_s: NotNegative | None = None
    clock_step: tuple[ClockStep, ...] = ()

    noise: Literal["gaussian", "uniform"] = "gaussian"
    noise_px: NotNegative = 0.0  # one sigma, or half the width when uniform
    drift_px: NotNegative = 0.0  # one sigma of a Gauss-Markov error that comes on top
    drift_s: Positive = 1.0  # its correlation time
    outlier: Fraction = 0.0  # share of rows that are anywhere in the image instead
    sigma_px: Positive | None = None  # what the detector says of itself; None: nothing
    dropout: Fraction = 0.0  # share of frames in which an object in view is missed
    dropout_length_s: NotNegative = 0.0  # mean length of a miss; 0: frame by frame
    clutter_per_frame: Annotated[float, Meta(ge=0, le=100)] = 0.0
    numbered: bool = True  # False: all track numbers 0
    track_gap_s: Positive = 2.0  # unseen for longer, an object is a new track to the detector, as to a real one
    blind: tuple[Blind, ...] = ()


class Weather(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the scene looks when rendered."""

    clouds: Fraction = 0.5
    foliage: Fraction = 0.5
    sun: bool = True
    sensor_noise: NotNegative = 2.0  # grey levels, one sigma


class Simulation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole scene. `duration_s`: None as long as the longest flight through waypoints."""

    name: Name = "simulated"
    seed: Annotated[int, Meta(ge=0)]
    origin: tuple[float, float, float] = (47.4085, 8.5071, 580.0)
    start_unix_ns: Annotated[int, Meta(ge=10**18, le=4 * 10**18)] = 1_780_000_000 * 10**9
    duration_s: Positive | None = None
    truth_rate_hz: Positive = 20.0
    object: tuple[ObjectSpec, ...]  # none: the cameras see clutter at most
    camera: Annotated[tuple[CameraSpec, ...], Meta(min_length=1)]
    weather: Weather = Weather()

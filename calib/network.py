"""The calibrated network: where each camera stands and looks, how its clock runs, and how well all that is known.

The hazard is a network that is half of one solution and half of another: poses, clocks and lenses are only right
together. A Network is therefore frozen and swapped in whole, its covariance is the joint one of all poses (errors that
cameras share do not average away), and its fingerprint says which solution a position was computed with.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import tomli_w
from numpy.typing import NDArray

from calib.errors import CalibrationError
from edge.common.arrays import Array
from edge.common.toml_text import read_toml
from edge.lens import LensModel, pixel_to_ray, ray_to_pixel

POSE_SIZE = 6  # rotation vector (rad, camera frame), centre (m, ENU)
NETWORK_FORMAT = 1


@dataclass(frozen=True)
class Camera:
    """One calibrated camera.

    R_cam_enu: (3, 3) takes ENU vectors to the camera frame (x right, y down, z forward). centre_enu: (3,) m.
    The site's time of a stamp t is t + clock_offset_s + clock_rate (t - t_mid) + readout_s v / H.
    sigma_px: one sigma of its pixels a coordinate as the adjustment found it, None if nobody did; correlated_s: for how
    long an error of them lasts. Raises CalibrationError if R_cam_enu is not a rotation.
    """

    id: str
    lens: LensModel
    R_cam_enu: Array
    centre_enu: Array
    clock_offset_s: float = 0.0
    clock_rate: float = 0.0
    readout_s: float = 0.0
    sigma_px: float | None = None
    correlated_s: float = 0.0

    def __post_init__(self) -> None:
        off = np.abs(self.R_cam_enu @ self.R_cam_enu.T - np.eye(3)).max()
        if not off < 1e-6 or np.linalg.det(self.R_cam_enu) < 0:
            raise CalibrationError(
                "R_cam_enu is no rotation", where=self.id, action="give an orthonormal matrix, det +1"
            )

    def project(self, points_enu: Array) -> Array:
        """Raw pixels (N, 2) of points (N, 3) in ENU metres; NaN for points behind the camera."""
        in_camera = (points_enu - self.centre_enu) @ self.R_cam_enu.T
        depth = np.where(in_camera[:, 2:] > 0, in_camera[:, 2:], np.nan)
        return ray_to_pixel(self.lens, in_camera[:, :2] / depth)

    def bearings_enu(self, pixels: Array) -> Array:
        """Unit vectors (N, 3) in ENU towards what raw pixels (N, 2) show; NaN outside the lens model."""
        rays = pixel_to_ray(self.lens, pixels)
        in_camera = np.column_stack([rays, np.ones(len(rays))])
        bearings: Array = in_camera @ self.R_cam_enu
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        return bearings

    def site_time_s(self, t_unix_ns: NDArray[np.int64], v_px: Array, t_mid_unix_ns: int) -> Array:
        """Seconds (N,) of site time since t_mid_unix_ns at which rows v_px of frames stamped t_unix_ns were exposed."""
        return self.exposed_s(np.asarray((np.asarray(t_unix_ns, np.int64) - t_mid_unix_ns) * 1e-9, float), v_px)

    def exposed_s(self, t_s: Array, v_px: Array) -> Array:
        """The same (N,) of stamps that are seconds (N,) since t_mid already."""
        return t_s + self.clock_offset_s + self.clock_rate * t_s + self.readout_s * v_px / self.lens.size_px[1]

    def stamped_s(self, site_s: Array) -> Array:
        """(N,) stamps, seconds from t_mid, of the first row of frames exposed at site times (N,)."""
        return (site_s - self.clock_offset_s) / (1 + self.clock_rate)


def pose_of(index: int) -> slice:
    """Where the pose of the camera of that index stands in a joint covariance: rotation, then centre."""
    return slice(POSE_SIZE * index, POSE_SIZE * (index + 1))


def attitude_of(index: int) -> slice:
    """Where its rotation vector alone stands there."""
    return slice(POSE_SIZE * index, POSE_SIZE * index + 3)


@dataclass(frozen=True)
class Network:
    """All calibrated cameras of a site.

    origin: latitude deg, longitude deg, ellipsoidal height m of the ENU frame. t_mid_unix_ns: epoch of the clock
    rates. covariance: (6 C, 6 C) joint covariance, per camera a rotation vector (rad; R = exp(rotation) R_cam_enu) and
    the centre (m). rms_px: of the inlier residuals. frame: what the survey's coordinates are called. rests_on: cameras
    whose own claims of place, lens and clock no other camera checks, and without which all would be far less certain.
    """

    site: str
    origin: tuple[float, float, float]
    t_mid_unix_ns: int
    cameras: tuple[Camera, ...]
    covariance: Array
    rms_px: float
    frame: str = "WGS 84"
    rests_on: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        size = POSE_SIZE * len(self.cameras)
        if self.covariance.shape != (size, size):
            raise CalibrationError(
                f"covariance of shape {self.covariance.shape} for {len(self.cameras)} cameras",
                where=self.site,
                action=f"give ({size}, {size})",
            )

    @cached_property
    def ids(self) -> frozenset[str]:
        """Names of all cameras."""
        return frozenset(camera.id for camera in self.cameras)

    @cached_property
    def centres_enu(self) -> Array:
        """(C, 3) optical centres of all cameras, ENU metres."""
        return np.array([camera.centre_enu for camera in self.cameras]).reshape(-1, 3)

    def since_mid_s(self, t_unix_ns: int) -> float:
        """Seconds of site time at an instant of UTC."""
        return (t_unix_ns - self.t_mid_unix_ns) * 1e-9

    def camera(self, camera_id: str) -> Camera | None:
        """The camera of that id, or None if it is not part of the network."""
        return next((camera for camera in self.cameras if camera.id == camera_id), None)

    def pose_covariance(self, camera_id: str) -> Array:
        """(6, 6) covariance of one camera's rotation vector and centre."""
        at = pose_of([camera.id for camera in self.cameras].index(camera_id))
        return self.covariance[at, at]

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hex digits that differ whenever any number of the network does; written out once: it takes 2 ms."""
        return hashlib.sha256(to_toml(self).encode()).hexdigest()[:12]


def to_toml(network: Network) -> str:
    """network.toml as text; from_toml gives the same network back to the last bit."""
    cameras = [
        {
            "id": c.id,
            "R_cam_enu": c.R_cam_enu.tolist(),
            "centre_enu": c.centre_enu.tolist(),
            "clock_offset_s": c.clock_offset_s,
            "clock_rate": c.clock_rate,
            "readout_s": c.readout_s,
            "lens": c.lens.model,
            "size_px": list(c.lens.size_px),
            "intrinsics": list(c.lens.intrinsics),
            "distortion": list(c.lens.distortion),
            "lens_rms_px": c.lens.rms_px,
            "correlated_s": c.correlated_s,
        }
        | ({} if c.sigma_px is None else {"sigma_px": c.sigma_px})
        for c in network.cameras
    ]
    head = {
        "format": NETWORK_FORMAT,
        "site": network.site,
        "origin": list(network.origin),
        "t_mid_unix_ns": network.t_mid_unix_ns,
        "rms_px": network.rms_px,
        "frame": network.frame,
        "rests_on": list(network.rests_on),
        "covariance": network.covariance.tolist(),
    }
    return tomli_w.dumps({"network": head, "camera": cameras})


def from_toml(text: str, *, where: str = "network.toml") -> Network:
    """The network written by to_toml. Raises CalibrationError, naming `where`, if it is not one."""
    try:
        tree = read_toml(text)
        head = tree["network"]
        if head["format"] != NETWORK_FORMAT:
            raise ValueError(f"format {head['format']}, this program reads {NETWORK_FORMAT}")
        network = Network(
            site=head["site"],
            origin=(float(head["origin"][0]), float(head["origin"][1]), float(head["origin"][2])),
            t_mid_unix_ns=int(head["t_mid_unix_ns"]),
            cameras=tuple(_camera(entry) for entry in tree["camera"]),
            covariance=np.array(head["covariance"], float),
            rms_px=float(head["rms_px"]),
            frame=head["frame"],
            # Of an older file nobody knows it: then it rests on all of them.
            rests_on=tuple(map(str, head.get("rests_on", [camera["id"] for camera in tree["camera"]]))),
        )
        _refuse_nonsense(network)
        return network
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CalibrationError(
            f"not a network ({error!r})", where=where, action="delete it and calibrate again"
        ) from error


def _refuse_nonsense(network: Network) -> None:
    """Raises ValueError if a number of it is none, or no instant: nothing that is computed with it would end well."""
    numbers = [network.covariance, network.centres_enu, np.array(network.origin), np.array([network.rms_px])]
    clocks = [(one.clock_offset_s, one.clock_rate, one.readout_s, one.correlated_s) for one in network.cameras]
    if not all(np.isfinite(part).all() for part in (*numbers, np.array(clocks))):
        raise ValueError("a number that is not finite")
    if not 0 <= network.t_mid_unix_ns < 2**63:
        raise ValueError(f"t_mid_unix_ns = {network.t_mid_unix_ns}")


def _camera(entry: dict[str, object]) -> Camera:
    def numbers(key: str) -> Array:
        return np.array(entry[key], float)

    lens = LensModel(
        model=entry["lens"],  # type: ignore[arg-type]  # LensModel checks it
        intrinsics=tuple(numbers("intrinsics").tolist()),
        distortion=tuple(numbers("distortion").tolist()),
        size_px=(int(numbers("size_px")[0]), int(numbers("size_px")[1])),
        rms_px=float(numbers("lens_rms_px")),
    )
    return Camera(
        id=str(entry["id"]),
        lens=lens,
        R_cam_enu=numbers("R_cam_enu"),
        centre_enu=numbers("centre_enu"),
        clock_offset_s=float(numbers("clock_offset_s")),
        clock_rate=float(numbers("clock_rate")),
        readout_s=float(numbers("readout_s")),
        sigma_px=float(numbers("sigma_px")) if "sigma_px" in entry else None,
        correlated_s=float(numbers("correlated_s")) if "correlated_s" in entry else 0.0,
    )

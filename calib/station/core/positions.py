"""Where the cameras stand, from whichever source says so: the configuration and its survey, or the boxes.

Three hazards. A position of another country (core/site_extent.py). A frame that moves: all estimation is about one
origin; it is fixed by the first complete set of positions and kept, because a better fix of one tripod must not shift
every target by a metre. And a position of another point: a receiver measures its antenna, the geometry needs the lens.
The offset between them has one home, the box (gnss.lever_arm_m), and a fix says which point it is of; where that is the
antenna, sigma covers the offset that nobody measured, or every target would be off by it with a sigma that says
otherwise.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from calib.geodesy import Origin, geodetic_to_enu, mean_position
from calib.observations import SiteCamera
from calib.reference_frame import UNKNOWN_FRAME_SIGMA_M, ReferenceFrame, frame_of_all
from calib.station.config import MIN_CAMERAS, CameraSection, Sigmas
from calib.station.core.coordinates import MORE_DIGITS, Written
from calib.station.core.intake import CameraIntake
from calib.station.core.site_extent import CORRECT_IT, too_far
from edge.common.arrays import Array
from edge.common.health import Check
from edge.gnss.kept_fix import WHAT_TO_DO, contradict, words
from edge.messages import Fix

LEAST_POSITION_SIGMA_M: Final = 0.005  # no receiver on a tripod does better, whatever it says
# The offset of an antenna that nobody measured, one sigma east, north, up. Refusing such fixes would put out every site
# whose antenna is at the lens, and every box too old to say which point its fix is of. Antennas stand up to 0.3 m above
# the lens and 0.1 m beside it: 0.17 and 0.06 m rms. Boxes of a site are built alike, so that this does not average over
# its cameras as sigmas do: times the root of the three that a site has at least.
UNKNOWN_OFFSET_M: Final = (0.1, 0.1, 0.3)
NAME_THE_FRAME: Final = (
    "name the frame of the corrections: gnss.frame on the boxes, `base-station survey frame --is`, or [site] frame for "
    "positions in the configuration"
)
SAME_FRAME: Final = "survey all cameras with one correction service, or correct the frame's name where it is wrong"


def lens_position(fix: Fix) -> tuple[Origin, Sigmas]:
    """The lens by a box's fix: latitude deg, longitude deg, ellipsoidal m; one sigma east, north, up, m."""
    offset_m = UNKNOWN_OFFSET_M if fix.of == "antenna" else (0.0, 0.0, 0.0)
    east, north, up = np.hypot(np.maximum(fix.sigma_m, LEAST_POSITION_SIGMA_M), offset_m).tolist()
    return (fix.lat_deg, fix.lon_deg, fix.height_m), (east, north, up)


def check_offset(camera: str, fix: Fix) -> list[Check]:
    """What to do about a fix that is of the antenna; nothing if it is of the lens."""
    if fix.of == "lens":
        return []
    reason = f"its fix is of the antenna, not of the lens: {UNKNOWN_OFFSET_M[2]} m is added to the sigma of its height"
    action = "measure from the lens to the antenna and give gnss.lever_arm_m in the box's edge.toml"
    return [Check(f"antenna {camera}", "warn", reason, action)]


def check_frame(frame: ReferenceFrame) -> Check:
    """What is added to the sigma of all that is sent, for the frame of the positions that it is told from.

    No alarm: nothing is wrong, and whoever hears the station in the frame of its own corrections loses nothing by it.
    """
    if frame.known:
        return Check("frame", "ok", f"the positions are in {frame.label}, and so is all that is sent")
    reason = (
        f"the positions' reference frame is not known ({frame.label}): {UNKNOWN_FRAME_SIGMA_M:g} m is added to the "
        "sigma of every position that is sent"
    )
    return Check("frame", "ok", reason, NAME_THE_FRAME)


class Positions:
    """Camera positions in the site's frame. origin: None until enough cameras have a position."""

    def __init__(
        self,
        cameras: dict[str, CameraSection],
        origin: Origin | None,
        frames: Mapping[str, ReferenceFrame] | None = None,
    ) -> None:
        """frames: of the surveyed positions, by camera; unknown of those that are left out."""
        self._cameras = cameras
        self._frames = frames or {}
        self._places: dict[str, Origin] = {}
        self.unbelieved: dict[str, str] = {}  # camera: why its position is not used
        self.origin = origin
        self._written = Written.of(
            (one.position, one.position_sigma) for one in cameras.values() if one.position is not None
        )

    def update(self, boxes: dict[str, CameraIntake]) -> None:
        """See which positions can be of one site, and choose the origin once enough are known."""
        known = {camera: place[0] for camera in self._cameras if (place := self._geodetic(camera, boxes[camera]))}
        if known != self._places:
            self._places, self.unbelieved = known, too_far(known)
        believed = [place for camera, place in known.items() if camera not in self.unbelieved]
        if self.origin is None and believed and len(believed) >= min(MIN_CAMERAS, len(self._cameras)):
            self.origin = mean_position(np.array(believed))

    def _geodetic(self, camera: str, box: CameraIntake) -> tuple[Origin, Sigmas] | None:
        section = self._cameras[camera]
        if section.position is not None:
            return section.position, self._written.sigma_m(section.position, section.position_sigma)
        return None if box.fix is None else lens_position(box.fix)

    def known(self, camera: str, box: CameraIntake) -> bool:
        """Whether a camera has a position, though the site may have no origin yet for want of the others'."""
        return camera not in self.unbelieved and self._geodetic(camera, box) is not None

    def of(self, camera: str, box: CameraIntake) -> tuple[Array, Array] | None:
        """(3,) ENU metres and (3, 3) covariance of a camera's optical centre, or None if it is not known."""
        place = self._geodetic(camera, box)
        if place is None or self.origin is None or camera in self.unbelieved:
            return None
        geodetic, sigma_m = place
        return geodetic_to_enu(np.array([geodetic]), self.origin)[0], np.diag(np.square(sigma_m))

    def checks(self, boxes: dict[str, CameraIntake]) -> list[Check]:
        """The cameras whose position is not of this site, or in force and their antenna's."""
        far = [Check(f"position {camera}", "fail", why, CORRECT_IT) for camera, why in self.unbelieved.items()]
        used = [box for camera, box in boxes.items() if self._cameras[camera].position is None]
        doubted = [check for camera, box in boxes.items() for check in self._doubts(camera, box)]
        rounded = [Check("positions", "warn", coarse, MORE_DIGITS)] if (coarse := self._written.coarse) else []
        return (
            far
            + doubted
            + rounded
            + [check for box in used if box.fix is not None for check in check_offset(box.id, box.fix)]
        )

    def _doubts(self, camera: str, box: CameraIntake) -> list[Check]:
        """What speaks against a camera's position: its own box, or that it lies elsewhere than before."""
        surveyed = self._cameras[camera].position
        if surveyed is not None and box.taken_back and box.fix is None:
            reason = f"its box doubts where it is ({box.taken_back}); the surveyed position is used"
            return [Check(f"position {camera}", "warn", reason, "if its tripod was moved, survey it again")]
        if surveyed is not None:
            return self._beside_survey(camera, surveyed, box)
        if why := box.fix_doubt:
            covered = "" if box.fix is None else "; its sigma covers both"
            return [Check(f"position {camera}", "fail", why + covered, WHAT_TO_DO)]
        if box.taken_back:
            reason = f"in use, and its receiver no longer confirms it ({box.taken_back})"
            return [Check(f"position {camera}", "warn", reason, "see edge-node check on its box")]
        return []

    def _beside_survey(self, camera: str, surveyed: Origin, box: CameraIntake) -> list[Check]:
        """Whether the box's own receiver speaks against the surveyed position, which is the one in use."""
        if box.fix is None:
            return []
        sigma_m = self._written.sigma_m(surveyed, self._cameras[camera].position_sigma)
        place, fix_sigma_m = lens_position(box.fix)
        east, north, up = geodetic_to_enu(np.array([place]), surveyed)[0].tolist()
        if not contradict((east, north, up), sigma_m, fix_sigma_m):
            return []
        reason = f"its box's receiver says it is {words((east, north, up))} the surveyed position, which is used"
        action = "survey it again (base-station survey), or correct the box's gnss.lever_arm_m"
        return [Check(f"position {camera}", "warn", reason, action)]

    def frame(self, boxes: dict[str, CameraIntake]) -> ReferenceFrame:
        """The reference frame of the positions in use: the least known of them."""
        return frame_of_all(list(self._frames_of(boxes).values()))

    def _frames_of(self, boxes: dict[str, CameraIntake]) -> dict[str, ReferenceFrame]:
        surveyed = {
            camera: self._frames.get(camera, ReferenceFrame())
            for camera, section in self._cameras.items()
            if section.position is not None
        }
        fixed = {
            camera: ReferenceFrame(box.fix.frame)
            for camera, box in boxes.items()
            if camera not in surveyed and box.fix is not None
        }
        return surveyed | fixed

    def frame_checks(self, boxes: dict[str, CameraIntake]) -> list[Check]:
        """Whether it is known in which frame the positions are, and is one."""
        frames = self._frames_of(boxes)
        if not frames:
            return []
        named = {frame.label.strip(): camera for camera, frame in frames.items() if frame.known}
        if len({label.lower() for label in named}) > 1:
            reason = ", ".join(f"{camera} is in {label}" for label, camera in named.items())
            return [Check("frame", "warn", f"the positions' frames differ: {reason}", SAME_FRAME)]
        return [check_frame(frame_of_all(frames.values()))]

    def by_fixes(self, camera: str) -> bool:
        """Whether a camera's position is that of its box's fixes, and not a surveyed one."""
        return self._cameras[camera].position is None

    def site_camera(self, camera: str, box: CameraIntake) -> SiteCamera | None:
        """What is known of a camera before calibrating, or None without a lens."""
        if box.lens is None:
            return None
        place = self.of(camera, box)
        return SiteCamera(
            camera,
            box.lens,
            position_enu=None if place is None else place[0],
            position_covariance=None if place is None else place[1],
            clock_bound_s=box.clock_bound_s,
            readout_s=box.readout_s,
        )

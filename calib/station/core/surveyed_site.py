"""What is known of a site before anything is seen: its frame's origin, its cameras, where they were surveyed.

It is put into every file of a recording, so that the recording can be solved by itself, and read from there again. The
hazard is a camera of the same name at another site: so it says which site it is of.
"""

from dataclasses import dataclass

from calib.geodesy import Origin
from calib.station.config import CameraSection
from edge.messages import SurveyedCamera, SurveyMessage


@dataclass(frozen=True)
class SurveyedSite:
    """cameras: by id, in the configuration's order, the survey's positions filled in. origin: None if none is given."""

    name: str
    origin: Origin | None
    cameras: dict[str, CameraSection]

    def message(self, t_unix_ns: int) -> SurveyMessage:
        """As it goes into the recording."""
        cameras = [
            SurveyedCamera(
                id=camera.id,
                position=camera.position,
                position_sigma_m=None if camera.position is None else camera.position_sigma,
            )
            for camera in self.cameras.values()
        ]
        return SurveyMessage(t_unix_ns=t_unix_ns, site=self.name, origin=self.origin, cameras=cameras)

    @classmethod
    def of(cls, message: SurveyMessage) -> "SurveyedSite":
        """From what a recording holds of it."""
        return cls(message.site, message.origin, {camera.id: _section(camera) for camera in message.cameras})


def _section(camera: SurveyedCamera) -> CameraSection:
    if camera.position is None or camera.position_sigma_m is None:
        return CameraSection(id=camera.id)
    return CameraSection(id=camera.id, position=camera.position, position_sigma=camera.position_sigma_m)

"""The station's core configured for a simulated scene: what benches and tests feed with messages."""

from calib.station.config import BaseConfig, CalibrationSection, CameraSection, SiteSection
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from tools.doubles.box_messages import SITE
from tools.doubles.flight import ORIGIN, Scene


def station_for(
    scene: Scene,
    memory: StoredState | None = None,
    calibration: CalibrationSection | None = None,
) -> Station:
    """A station that knows the scene's cameras by name, and nothing more; not calibrated."""
    sections = [CameraSection(id=camera.id) for camera in scene.truth]
    site = SiteSection(name=SITE, origin=ORIGIN, undulation_m=47.0)  # of the geoid there
    config = BaseConfig(site=site, camera=sections, calibration=calibration or CalibrationSection())
    return Station(config, {section.id: section for section in sections}, memory or StoredState())

"""The scene on one time: stamps that are minutes or hours off moved first, the clocks of all cameras beside it.

The hazard is a clock's rate about a far epoch: an hour away from the flight a rate of ten millionths is 36 ms, and the
adjustment would trade one for the other. So far offsets are taken off the stamps before anything else looks at them,
and put back into the network at the end, where the stamps of that camera are as wrong as they were.
"""

from dataclasses import dataclass, field, replace
from typing import Final

from calib.errors import CalibrationError
from calib.network import Camera, Network
from calib.solving.clock_consensus import Clock
from calib.solving.clocks import NEAR_S
from calib.solving.found import Found
from calib.solving.inputs import Inputs, prepare
from calib.solving.site_clocks import CameraClock, Origin, site_clocks
from calib.solving.solution import CameraReport
from calib.solving.steadied import steadied_clocks

MOVED_FROM_S: Final = 10.0  # stamps further off than this are moved: a thousandth of it is what a rate may blur


@dataclass(frozen=True)
class Timed:
    """Inputs whose stamps are near the site's time. clocks: what is left, of the cameras that have a usable one.

    moved_s: added to the stamps of the cameras named. found: clocks that stepped.
    """

    inputs: Inputs
    clocks: dict[str, Clock]
    moved_s: dict[str, float] = field(default_factory=dict)
    found: tuple[Found, ...] = ()

    def blamed(self, error: CalibrationError) -> CalibrationError:
        """A refusal of what came after, with the steps that it may be the consequence of."""
        if not self.found:
            return error
        clocks = [str(one) for one in self.found]
        return type(error)(f"{'; '.join(clocks)}; without that, {error.what}", where=error.where, action=error.action)

    def as_stamped(self, network: Network) -> Network:
        """The network with clocks that hold for the stamps as they came."""
        return replace(network, cameras=tuple(self._camera(camera) for camera in network.cameras))

    def _camera(self, camera: Camera) -> Camera:
        moved_s = self.moved_s.get(camera.id, 0.0)
        return replace(camera, clock_offset_s=camera.clock_offset_s + moved_s * (1 + camera.clock_rate))

    def report(self, camera: CameraReport) -> CameraReport:
        """What is said of a clock, at the flight: an hour away from it a rate would blur the offset."""
        return replace(camera, clock_offset_s=camera.clock_offset_s + self.moved_s.get(camera.id, 0.0))


def on_one_time(inputs: Inputs, *, local: bool = False, near_s: float = NEAR_S) -> Timed:
    """Find the clocks, cut where one stepped, move what is far off, and leave out, with the reason, who has none."""
    steadied = steadied_clocks(inputs, site_clocks(inputs.tracks, inputs.sites, near_s))
    found = steadied.clocks
    far = {name: _shift_s(own) for name, own in found.items() if abs(_shift_s(own)) > MOVED_FROM_S}
    clocks = {name: own.clock for name, own in found.items() if own.origin is not Origin.UNKNOWN}
    if far:
        inputs, clocks = _moved(inputs, clocks, far, local=local)
    tracks = {name: steadied.cut(name, own) for name, own in inputs.tracks.items()}
    return Timed(
        replace(inputs, tracks=tracks, left_out={**inputs.left_out, **steadied.if_left_out()}),
        clocks,
        far,
        steadied.found,
    )


def _shift_s(clock: CameraClock) -> float:
    return round(clock.clock.offset_s, 3) if clock.origin is Origin.FOUND else 0.0


def _moved(
    inputs: Inputs, clocks: dict[str, Clock], far: dict[str, float], *, local: bool
) -> tuple[Inputs, dict[str, Clock]]:
    rows = dict(inputs.scene.observations)
    for name, shift_s in far.items():
        rows[name] = replace(rows[name], t_unix_ns=rows[name].t_unix_ns + round(shift_s * 1e9))
    moved = prepare(replace(inputs.scene, observations=rows), local=local)
    # A later epoch, and stamps that are `shift` later, see the same clock from elsewhere.
    later_s = (moved.t_mid_unix_ns - inputs.t_mid_unix_ns) * 1e-9
    return moved, {
        name: Clock(clock.offset_s + clock.rate * later_s - far.get(name, 0.0) * (1 + clock.rate), clock.rate)
        for name, clock in clocks.items()
    }

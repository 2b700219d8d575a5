"""Messages that came once, read again as the station reads them: a recording or a track folder as a scene to solve.

The hazard is a second reader. Where a recording is decoded by rules of its own, what is solved afterwards is not what
was flown from, and nobody sees it. So the messages go through the station's own intake, positions and window, with the
instants of their arrival; what differs is said in core/intake.py. What was refused is named, with what to do.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Final, NamedTuple

from calib.observations import Frame, Scene
from calib.station.config import CameraSection
from calib.station.core.intake import CameraIntake, Intake
from calib.station.core.positions import Positions
from calib.station.core.site_extent import CORRECT_IT
from calib.station.core.surveyed_site import SurveyedSite
from calib.station.core.window import CameraWindow, Window
from edge.common.errors import ConfigError
from edge.messages import SurveyMessage, camera_of_key, decode

NO_ORIGIN: Final = (0.0, 0.0, 0.0)  # the origin of a frame that no camera has a position in


class Recorded(NamedTuple):
    """A message: its key, when it arrived (ns, the recording's own clock), its bytes."""

    key: str
    t_arrival_ns: int
    payload: bytes


@dataclass(frozen=True)
class RefusedRows:
    """What of a camera was not used: how often, why, and what to do about it."""

    camera: str
    count: int
    reason: str
    action: str

    def __str__(self) -> str:
        return f"camera {self.camera}: {self.reason} ({self.count}); {self.action}"


@dataclass(frozen=True)
class Played:
    """The scene, and what is not in it. without_lens: cameras left out, because nothing says what lens they have."""

    scene: Scene
    refused: tuple[RefusedRows, ...]
    without_lens: tuple[str, ...]


def survey_in(message: Recorded) -> SurveyedSite | None:
    """The survey in force, if that is what a message holds: the first of a recording. Raises MessageError."""
    if not message.key.endswith("/station/survey"):
        return None
    return SurveyedSite.of(decode(message.payload, SurveyMessage, where=message.key))


def play(messages: Iterable[Recorded], site: SurveyedSite | None = None, *, arrivals_are_real: bool = True) -> Played:
    """What a station would know at the end of the messages, with every row kept.

    site: instead of the survey that stands at their head. Without either, every camera that sends is taken, at its own
    fix. arrivals_are_real: False where the messages were made from a file of stamps. Raises MessageError if what stands
    at the head is no survey, ConfigError if `site` is another than the messages are of.
    """
    rest = iter(messages)
    for first in rest:
        playback = _Playback(site or survey_in(first), arrivals_are_real)
        for message in chain([first], rest):
            playback.take(message)
        return playback.played()
    return _Playback(site, arrivals_are_real).played()


class _Playback:
    """A station's eyes without the rest of it. site: None if any camera may be new."""

    def __init__(self, site: SurveyedSite | None, arrivals_are_real: bool) -> None:
        self._site = site
        self._sections: dict[str, CameraSection] = {} if site is None else dict(site.cameras)
        self._intake = Intake(
            self._sections, "the configuration", late_rows_count=True, arrivals_are_real=arrivals_are_real
        )
        self._window = Window(self._sections)
        self._positions = Positions(self._sections, None if site is None else site.origin)
        self._clock_sets: Counter[str] = Counter()
        self._forgotten: list[RefusedRows] = []
        self._site_of_keys = ""

    def take(self, message: Recorded) -> None:
        """One message."""
        name, topic = camera_of_key(message.key), message.key.rpartition("/")[2]
        if name is None:
            return
        self._site_of_keys = message.key.split("/")[2]
        if self._site is not None and self._site_of_keys != self._site.name:
            raise ConfigError(
                f"the configuration is of site {self._site.name!r}, the recording of {self._site_of_keys!r}",
                where=message.key,
                action="give that site's configuration: cameras of one name at two sites stand in different places",
            )
        if self._site is None and name not in self._sections:
            self._sections[name] = CameraSection(id=name)
            self._intake.cameras[name], self._window.cameras[name] = CameraIntake(name), CameraWindow(None)
        camera = self._intake.known(name)
        if camera is not None:
            self._of_camera(camera, topic, message.payload, message.t_arrival_ns)

    def _of_camera(self, camera: CameraIntake, topic: str, payload: bytes, now_ns: int) -> None:
        if topic == "tracks":
            self._add(camera, self._intake.frame(camera, payload, now_ns))
        elif topic == "backlog":
            self._add(camera, self._intake.backlog(camera, payload, now_ns))
        elif topic == "lens":
            if self._intake.lens(camera, payload, now_ns):
                self._forget(camera, "rows from before its lens was exchanged")
        elif topic == "fix":
            self._intake.fix(camera, payload, now_ns)
            if self._site is not None:
                self._positions.update(self._intake.cameras)

    def _add(self, camera: CameraIntake, frame: Frame | None) -> None:
        if camera.clock_sets != self._clock_sets[camera.id]:
            self._clock_sets[camera.id] = camera.clock_sets
            self._forget(camera, "rows from before its clock was set")
        if frame is not None:
            self._window.add(frame)

    def _forget(self, camera: CameraIntake, reason: str) -> None:
        """Only what came after belongs together, as live."""
        rows = len(self._window.cameras[camera.id])
        if rows:
            action = "fly after such a change, not across it"
            self._forgotten.append(RefusedRows(camera.id, rows, reason, action))
        self._window.cameras[camera.id].clear()

    def played(self) -> Played:
        """What came of all messages."""
        boxes = self._intake.cameras
        self._place()
        sites = {name: self._positions.site_camera(name, boxes[name]) for name in self._in_order()}
        usable = tuple(site for site in sites.values() if site is not None)
        observations = {site.id: self._window.cameras[site.id].observations() for site in usable}
        name = self._site_of_keys if self._site is None else self._site.name
        scene = Scene(name, self._positions.origin or NO_ORIGIN, usable, observations)
        return Played(scene, tuple(self._refused()), tuple(name for name, site in sites.items() if site is None))

    def _in_order(self) -> list[str]:
        """The configuration's order; without one, by name, for whoever spoke first is chance."""
        return sorted(self._sections) if self._site is None else list(self._sections)

    def _place(self) -> None:
        """Choose the frame's origin. Live waits until three cameras have a position; here no more will come."""
        boxes = self._intake.cameras
        self._positions.update(boxes)
        far = self._positions.unbelieved
        placed = {
            n: c
            for n, c in self._sections.items()
            if (c.position is not None or boxes[n].fix is not None) and n not in far
        }
        if placed and self._positions.origin is None:
            known = Positions(placed, None)
            known.update(boxes)
            self._positions.origin = known.origin

    def _refused(self) -> Iterator[RefusedRows]:
        yield from self._forgotten
        for name, why in self._positions.unbelieved.items():
            yield RefusedRows(name, 1, f"{why}; it is solved as if not surveyed", CORRECT_IT)
        for name in self._in_order():
            camera = self._intake.cameras[name]
            for kind, (reason, action, _) in camera.faults.items():
                yield RefusedRows(name, camera.counters[kind], reason, action)
        for stranger, count in self._intake.strangers.items():
            action = f'add [[camera]] id = "{stranger}", or correct the box\'s camera id'
            yield RefusedRows(stranger, count, "the configuration does not name it: left out", action)

"""The boxes as the loop sees them: what came of theirs over Zenoh since it last looked, and what it tells them.

The hazard is what the live way lost: a number counts as received only once it is where it can be recorded, or the
backlog would never be asked for it again.
"""

from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec

from calib.station.archive.backfill import Backfill
from calib.station.core.intake import CameraIntake
from calib.station.router_watch import RouterWatch
from edge.common.health import Check
from edge.link.health import LinkHealth
from edge.link.inbox import Presence, Received
from edge.link.link import Link
from edge.link.security import Bearer
from edge.link.settings import LinkSettings
from edge.messages import camera_key, site_key, station_key

QUEUE: Final = 4096  # messages waiting: more than a second of 100 cameras
ROUTER_QUEUE: Final = 8  # of the router's health: the newest counts
NEWEST_TOPICS: Final = ("lens", "fix", "health")  # topics of which the newest is kept for whoever comes later
LATE_A_TURN: Final = 20  # rows of history taken between two looks at what is live


class Boxes:
    """Everything between the station and the boxes of its site."""

    def __init__(self, settings: LinkSettings, site: str, ledger: Path, stack: ExitStack) -> None:
        """ledger: file that remembers what was received. stack: closes the link. Raises ConfigError, LinkError."""
        self.link = stack.enter_context(Link(settings, name="station"))
        self._health = stack.enter_context(LinkHealth(self.link, Bearer(site, "station")))
        self._tracks = self.link.subscribe(camera_key(site, "*", "tracks"), QUEUE)
        self._states = [self.link.watch_state(camera_key(site, "*", topic)) for topic in NEWEST_TOPICS]
        self._router = RouterWatch(self.link.subscribe(site_key(site, "router/health"), ROUTER_QUEUE))
        self._presence = self.link.watch_presence(camera_key(site, "*"))
        self._backfill = stack.enter_context(Backfill(self.link, site, ledger))
        self.link.declare_presence(station_key(site))

    def wait(self, timeout_s: float) -> None:
        """Until something came, or the time is over."""
        self.link.wait(timeout_s)

    def tracks(self) -> list[Received]:
        """What the cameras see, in the order it came."""
        return self._tracks.drain()

    def states(self) -> list[Received]:
        """Lenses, fixes and healths that are new."""
        return [message for inbox in self._states for message in inbox.drain()]

    def presence(self) -> list[Presence]:
        """Boxes that appeared or vanished."""
        return self._presence.drain()

    def late(self) -> list[Received]:
        """Rows that were lost on the live way, a few at a time: for the recording, never for what is live."""
        return self._backfill.late.drain(LATE_A_TURN)

    def recorded(self, box: CameraIntake) -> None:
        """A box's newest live message is in the recording."""
        if box.epoch is not None:
            self._backfill.have_number(box.id, box.epoch, box.next_seq - 1)

    def pause_backfill(self, paused: bool) -> None:
        """While nothing is recorded, what is lost is not fetched: it would be lost for good."""
        self._backfill.paused = paused

    def publish(self, key: str, message: msgspec.Struct, payload: bytes, *, state: bool) -> None:
        """Tell whoever listens. payload: the message, encoded. state: who comes later needs it too."""
        if state:
            self.link.set_state(key, message)
        else:
            self.link.publish_bytes(key, payload)

    def checks(self) -> list[Check]:
        """How the link is, and how the router says that it is."""
        return [*self._health.checks(who="the router"), *self._router.checks()]

    @property
    def counters(self) -> dict[str, float]:
        """What the link and the backlog counted."""
        late = msgspec.structs.asdict(self._backfill.counters)
        found = {f"backfill_{name}": float(count) for name, count in late.items()}
        return self._health.counters() | found | {"inbox_dropped": float(self._tracks.dropped)}

"""How many may stand at the page's door, and for how long. Pure: transports and times are handed in.

The hazard is the thousand who ask slowly: each holds a descriptor for ever with a letter a second, the process has a
thousand of them, and from then on nobody is served and every attempt fills the log. So who connects has seconds to ask,
an answer has its time too, one address has its share, and where the room is full the newest comes in place of whoever
has stood longest without asking.
"""

from dataclasses import dataclass
from typing import Final, Literal, Protocol

MOST_AT_DOOR: Final = 200  # a process has 1024 descriptors, and recordings and previews want some
MOST_OF_ONE: Final = 60  # of one address: ten browser windows
ASKS_S: Final = 5.0  # to ask in, from the connection or from the last answer
ANSWERED_S: Final = 30.0  # to take an answer in: a report over a radio; a web socket stays

Stage = Literal["new", "asking", "watching"]


class Transport(Protocol):
    """What the door needs of a connection."""

    def is_closing(self) -> bool:
        """Whether it is over."""

    def abort(self) -> None:
        """End it at once."""


@dataclass
class _Connection:
    transport: Transport
    since_s: float
    stage: Stage = "new"


Client = tuple[str, int]  # address and port


class Door:
    """The connections there are, by their client. turned_away: how many were ended here."""

    def __init__(self) -> None:
        self._connections: dict[Client, _Connection] = {}
        self.turned_away = 0

    def __len__(self) -> int:
        return len(self._connections)

    def came(self, client: Client, transport: Transport, now_s: float) -> None:
        """Somebody connected: let in, in place of another if it must be, or turned away."""
        self._forget_gone()
        own = [other for other in self._connections if other[0] == client[0]]
        if len(own) >= MOST_OF_ONE:
            crowd = own
        elif len(self._connections) >= MOST_AT_DOOR:
            crowd = list(self._connections)
        else:
            crowd = []
        silent = [other for other in crowd if self._connections[other].stage == "new"]
        if silent:
            self._turn_away(silent[0])
        elif crowd:
            self.turned_away += 1
            transport.abort()
            return
        self._connections[client] = _Connection(transport, now_s)

    def asked(self, client: Client, stage: Stage, now_s: float) -> None:
        """A whole request came; stage: `asking`, or `watching` where it is a web socket."""
        self._move(client, stage, now_s)

    def answered(self, client: Client, now_s: float) -> None:
        """The answer is out; it may ask again."""
        self._move(client, "new", now_s)

    def sweep(self, now_s: float) -> None:
        """End those whose time is over. Call it once a second."""
        self._forget_gone()
        limits = {"new": ASKS_S, "asking": ANSWERED_S}
        for client, connection in list(self._connections.items()):
            if now_s - connection.since_s > limits.get(connection.stage, float("inf")):
                self._turn_away(client)

    def _move(self, client: Client, stage: Stage, now_s: float) -> None:
        connection = self._connections.get(client)
        if connection is not None:
            connection.stage, connection.since_s = stage, now_s

    def _turn_away(self, client: Client) -> None:
        self.turned_away += 1
        self._connections.pop(client).transport.abort()

    def _forget_gone(self) -> None:
        for client in [client for client, one in self._connections.items() if one.transport.is_closing()]:
            del self._connections[client]

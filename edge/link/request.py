"""A question somebody asked of one of our keys, to be answered from our own thread in our own time."""

from collections.abc import Iterable
from contextlib import suppress

import zenoh

from edge import messages


class Request:
    """A question. Whoever took it from the inbox answers it, or lets it fall: then the asker learns that at once."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._key = key
        self._query = query

    @property
    def parameters(self) -> dict[str, str]:
        """What came after the `?` of the selector, as text; the asker may have written anything there."""
        pairs = (part.partition("=") for part in str(self._query.parameters).split(";"))
        return {name: value for name, _, value in pairs if name}

    def answer(self, payloads: Iterable[bytes]) -> None:
        """Send these replies, each a message of its own, and end the question. An asker who left is no error."""
        with suppress(zenoh.ZError), self._query:
            for payload in payloads:
                self._query.reply(self._key, payload, encoding=messages.ENCODING)

"""The door in front of everything the page's process serves: HTTP, web sockets, and the library's own files."""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final

from calib.station.status.access import COOKIE, allowed, in_query

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

REFUSED: Final = b"a token is needed: http://HOST:PORT/?token=..."
REFUSED_SOCKET: Final = 1008  # policy violation (RFC 6455)
# Nothing from elsewhere, nothing framed. The library writes its own styles and scripts into the page.
POLICY: Final = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; connect-src 'self'; frame-ancestors 'none'"
)


class RequestFilter:
    """Lets through what access.py allows; a token in the address becomes a cookie and leaves the address."""

    def __init__(self, app: Any, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one socket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        query = scope["query_string"].decode("latin-1")
        if not allowed(self._token, headers, query):
            await _refuse(scope, send)
        elif scope["type"] == "http" and in_query(self._token, query):
            await self._welcome(scope["path"], send)
        else:
            await self._app(scope, receive, _with_policy(send))

    async def _welcome(self, path: str, send: Send) -> None:
        cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/; Max-Age=31536000"
        headers = [(b"location", path.encode()), (b"set-cookie", cookie.encode("latin-1"))]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


async def _refuse(scope: Scope, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": REFUSED_SOCKET})
        return
    await send({"type": "http.response.start", "status": 401, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": REFUSED})


def _with_policy(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            extra = [(b"content-security-policy", POLICY.encode()), (b"x-content-type-options", b"nosniff")]
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return sending

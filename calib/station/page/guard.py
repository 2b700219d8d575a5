"""The door in front of everything the page's process serves: HTTP, web sockets, and the library's own files."""

import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final
from urllib.parse import quote

from calib.station.page.door import Client, Door
from calib.station.status.access import COOKIE, SESSION_S, TokenGate, Verdict, in_query, session

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

# What is answered instead, by what was found: HTTP status, text.
ANSWERS: Final[dict[Verdict, tuple[int, bytes]]] = {
    "refused": (401, b"a token is needed: add ?token=... to the address"),
    "wait": (429, b"too many wrong tokens from here: wait, and give the right one"),
}
REFUSED_SOCKET: Final = 1008  # policy violation (RFC 6455)
# Nothing from elsewhere, nothing framed. The library writes its own styles and scripts into the page.
POLICY: Final = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; connect-src 'self'; frame-ancestors 'none'"
)


class RequestFilter:
    """Lets through what access.py allows; a token in the address becomes a session and leaves the address."""

    def __init__(self, app: Any, token: str, door: Door | None = None) -> None:
        """door: is told who asked and when the answer is out; None: nobody is counted."""
        self._app, self._token = app, token
        self._door = Door() if door is None else door
        self.gate = TokenGate(token)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one socket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        client: Client = tuple(scope.get("client") or ("", 0))
        self._door.asked(client, "asking" if scope["type"] == "http" else "watching", time.monotonic())
        try:
            await self._judge(scope, receive, send, client[0])
        finally:
            self._door.answered(client, time.monotonic())

    async def _judge(self, scope: Scope, receive: Receive, send: Send, address: str) -> None:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        query = scope["query_string"].decode("latin-1")
        verdict = self.gate.judge(headers, query, address, time.time())
        if verdict != "in":
            await _refuse(scope, send, verdict)
        elif scope["type"] == "http" and in_query(self._token, query):
            await self._welcome(scope, send)
        else:
            await self._app(scope, receive, _with_policy(send))

    async def _welcome(self, scope: Scope, send: Send) -> None:
        value = session(self._token, time.time())
        secure = "; Secure" if scope.get("scheme") == "https" else ""
        cookie = f"{COOKIE}={value}; HttpOnly; SameSite=Strict; Path=/; Max-Age={SESSION_S}{secure}"
        own = quote("/" + scope["path"].lstrip("/"))  # two slashes would be another host, a line's end another header
        headers = [(b"location", own.encode()), (b"set-cookie", cookie.encode("latin-1"))]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


async def _refuse(scope: Scope, send: Send, verdict: Verdict) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": REFUSED_SOCKET})
        return
    status, text = ANSWERS[verdict]
    await send({"type": "http.response.start", "status": status, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": text})


def _with_policy(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            extra = [(b"content-security-policy", POLICY.encode()), (b"x-content-type-options", b"nosniff")]
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return sending

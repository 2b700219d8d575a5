"""Who may look at the page. Pure.

Two hazards. On a network, anybody: so an address other than this machine's own needs a token, which is compared in
constant time. And on this machine, any web site that the operator's browser has open: it may ask for 127.0.0.1 under a
name of its own (DNS rebinding) or open a socket from its own page; so the names and origins are looked at.
"""

import hmac
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs, urlsplit

from edge.common.errors import ConfigError
from edge.common.hosts import is_own

COOKIE: Final = "skyfix"
SHORTEST_TOKEN: Final = 16  # characters


def read_token(file: Path) -> str:
    """The token in a file that only its owner may read. Raises ConfigError."""
    try:
        mode, token = file.stat().st_mode, file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(file), action="see status.token_file") from error
    if mode & 0o077:
        raise ConfigError("others may read the token", where=str(file), action=f"chmod 600 {file}")
    if len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        action = f"openssl rand -hex 16 > {file}"
        raise ConfigError(
            f"is no token of {SHORTEST_TOKEN} printable characters or more", where=str(file), action=action
        )
    return token


def allowed(token: str, headers: dict[str, str], query: str) -> bool:
    """Whether a request may pass. headers: names in lower case. query: what follows the question mark.

    Without a token only this machine's own names are answered; with one, it must come as `?token=`, as a bearer or in
    the cookie. A browser's Origin must be the host that it asked.
    """
    host = headers.get("host", "")
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return False
    if not token:
        return is_own(urlsplit(f"//{host}").hostname or "")
    return any(hmac.compare_digest(given.encode(), token.encode()) for given in _given(headers, query))


def in_query(token: str, query: str) -> bool:
    """Whether the token came in the address, where it should not stay."""
    return bool(token) and "token" in parse_qs(query)


def _given(headers: dict[str, str], query: str) -> list[str]:
    given = parse_qs(query).get("token", [])
    scheme, _, bearer = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        given = [*given, bearer.strip()]
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    return given if cookie is None else [*given, cookie.value]

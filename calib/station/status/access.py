"""Who may look at the page. Pure.

Three hazards. On a network, anybody: so an address other than this machine's own needs a token, which is compared in
constant time. And on this machine, any web site that the operator's browser has open: it may ask for 127.0.0.1 under a
name of its own (DNS rebinding) or open a socket from its own page; so the names and origins are looked at. And the
tablet that was lost: so what a browser keeps is no token but a session, and it ends.
"""

import hmac
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Final, Literal
from urllib.parse import parse_qs, urlsplit

from calib.station.status.attempts import Attempts
from edge.common.errors import ConfigError
from edge.common.hosts import is_own

COOKIE: Final = "skyfix"
SHORTEST_TOKEN: Final = 16  # characters
SESSION_S: Final = 7 * 86_400  # a week in the field; all end at once where the token is changed
MOST_DIGITS: Final = 12  # of an end: thirty thousand years

# in; refused: what was given is none; wait: it was not looked at, for there were too many wrong ones.
Verdict = Literal["in", "refused", "wait"]


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


class TokenGate:
    """Whether a request may pass. attempts: of wrong tokens."""

    def __init__(self, token: str) -> None:
        """token: empty where only this machine's own names are answered."""
        self._token = token
        self.attempts = Attempts()

    def judge(self, headers: dict[str, str], query: str, address: str, now_unix_s: float) -> Verdict:
        """headers: names in lower case. query: what follows the question mark. address: whose.

        A browser's Origin must be the host that it asked. With a token, it comes as `?token=` or as a bearer, or there
        is the session of one that came; a wrong one has the next from there wait.
        """
        if not _asks_us(headers, by_name=not self._token):
            return "refused"
        if not self._token or session_holds(self._token, _cookie(headers), now_unix_s):
            return "in"
        given = _given(headers, query)
        if not given:
            return "refused"
        if not self.attempts.may(address, now_unix_s):
            return "wait"
        if any(hmac.compare_digest(one.encode(), self._token.encode()) for one in given):
            return "in"
        self.attempts.failed(address, now_unix_s)
        return "refused"


def session(token: str, now_unix_s: float) -> str:
    """A cookie's value that shows for SESSION_S that somebody knew the token. It tells nothing of it."""
    ends = f"{int(now_unix_s + SESSION_S)}"
    return f"{ends}.{_sealed(token, ends)}"


def session_holds(token: str, value: str, now_unix_s: float) -> bool:
    """Whether a cookie's value is a session of this token's that has not ended."""
    ends, _, seal = value.partition(".")
    if not (ends.isascii() and ends.isdigit() and len(ends) <= MOST_DIGITS):
        return False
    return hmac.compare_digest(seal.encode(), _sealed(token, ends).encode()) and now_unix_s < int(ends)


def _sealed(token: str, ends: str) -> str:
    return hmac.new(token.encode(), f"{COOKIE} session {ends}".encode(), "sha256").hexdigest()


def in_query(token: str, query: str) -> bool:
    """Whether the token came in the address, where it should not stay."""
    return bool(token) and "token" in parse_qs(query)


def _asks_us(headers: dict[str, str], *, by_name: bool) -> bool:
    """Whether a request is from no other site's page, and, by_name, for one of this machine's own names."""
    host, origin = headers.get("host", ""), headers.get("origin")
    try:
        if origin is not None and urlsplit(origin).netloc != host:
            return False
        return not by_name or is_own(urlsplit(f"//{host}").hostname or "")
    except ValueError:  # brackets that do not close
        return False


def _given(headers: dict[str, str], query: str) -> list[str]:
    given = parse_qs(query).get("token", [])
    scheme, _, bearer = headers.get("authorization", "").partition(" ")
    return [*given, bearer.strip()] if scheme.lower() == "bearer" else given


def _cookie(headers: dict[str, str]) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return "" if found is None else found.value

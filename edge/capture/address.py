"""A camera's address: as it may be shown, and why a camera does not answer at it.

The hazard is the password in it. Whatever names a source goes into the journal, to whoever listens to Health, onto the
operator's page and into the recording; so no error, no finding and no picture carries an address but by `shown`.
"""

import re
import socket
from typing import Final
from urllib.parse import SplitResult, urlsplit

from edge.common.errors import LoginError, SourceError

HIDDEN: Final = "***"
_USER: Final = re.compile(r"(?<=://).*@")  # greedy: a password may hold an @ that nobody encoded
# Typed without its scheme, or with half of it: no file is called user:password@camera.
_USER_ALONE: Final = re.compile(r"(?i)^([a-z]{0,5}:?/{0,2})[^/@]*:[^@]*@")
# Any parameter of an address, in its query or, as some cameras have it, in its path: up to the next one, or its end.
_PARAMETER: Final = re.compile(r"(?i)(?<![a-z0-9])([a-z][a-z0-9_.\[\]-]*?)(=|%3d)(.*?)(?=_[a-z]+=|[&;/?#]|$)")
# Those whose values say what is asked for. Of all others nobody knows whether they are a password.
HARMLESS: Final = frozenset(
    {
        "action", "audio", "buffer_size", "camera", "ch", "channel", "chn", "cmd", "codec", "compression",
        "fifo_size", "format", "fps", "height", "overrun_nonfatal", "profile", "proto", "quality", "rate",
        "real_stream", "resolution", "size", "stream", "streamtype", "subtype", "timeout", "transportmode",
        "type", "unicast", "video", "videocodec", "width",
    }
)  # fmt: skip
# A part of a path that is a key and no word: recorders and restreamers hand them out.
_KEY: Final = re.compile(
    r"(?<=/)(?=[A-Za-z0-9]*[a-z])(?=[A-Za-z0-9]*[A-Z])(?=(?:[A-Za-z]*[0-9]){2})[A-Za-z0-9]{12,}(?=[/?#]|$)"
    r"|(?<=/)[0-9a-fA-F-]{24,}(?=[/?#]|$)"
)
PORTS: Final = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443}  # where none is in the address
CAMERA_ANSWERS_S: Final = 2.0  # an answer to one line; the open before it waited longer
UNAUTHORISED: Final = (401, 403)
_STATUS: Final = re.compile(rb"^(?:RTSP|HTTP)/\d\.\d (\d{3})")


def shown(path: str) -> str:
    """A source's path or address, without who logs in and how."""
    if "://" not in path:
        return _USER_ALONE.sub(rf"\1{HIDDEN}@", path)
    hidden = _PARAMETER.sub(_without_value, _KEY.sub(HIDDEN, path))
    return _USER.sub(HIDDEN + "@", hidden)


def _without_value(match: re.Match[str]) -> str:
    return match[0] if match[1].lower() in HARMLESS else match[1] + match[2] + HIDDEN


def why_not(path: str) -> SourceError:
    """Why a stream did not open: nobody there, a login refused, no such stream, or not to be told. Never raises."""
    where = shown(path)
    if _to_be_encoded(path):
        action = "percent-encode what stands between :// and @: @ is %40, : %3A, / %2F, # %23, ? %3F, % %25"
        return LoginError("the user name or password holds characters of an address", where=where, action=action)
    try:
        address = urlsplit(path)
        port = address.port or PORTS.get(address.scheme, 0)
    except ValueError as error:
        return SourceError(f"is no address ({error})", where=where, action="correct source.path")
    host = address.hostname or ""
    try:
        status = _status(address, host, port) if host and port else None
    except OSError as error:
        action = "check the address, the cable and the network; it is tried again by itself"
        return SourceError(f"nobody answers at {host}:{port} ({error})", where=where, action=action)
    return _refusal(path, status)


def _refusal(path: str, status: int | None) -> SourceError:
    where = shown(path)
    if status in UNAUTHORISED:
        action = "correct it in source.path; it is tried every few minutes only, for cameras lock accounts"
        given = "refuses the user name or password" if "@" in path else "asks for a user name and password"
        return LoginError(f"the camera {given} ({status})", where=where, action=action)
    if status == 404:
        return SourceError("the camera has no such stream (404)", where=where, action="correct the address's path")
    said = f" (the camera answers {status})" if status else ""
    action = "check that the address gives video; it is tried again by itself"
    return SourceError(f"the stream does not open{said}", where=where, action=action)


def _to_be_encoded(path: str) -> bool:
    """Whether what stands before the last @ would end the address's authority, or begins another escape."""
    user = _USER.search(path)
    if user is None:
        return False
    text = user[0][:-1]
    return bool(re.search(r"[@/#?\[\] ]|%(?![0-9A-Fa-f]{2})", text)) or text.count(":") > 1


def _status(address: SplitResult, host: str, port: int) -> int | None:
    """What a camera answers to whoever does not log in; None where that is not to be understood. Raises OSError."""
    target = f"{address.scheme}://{host}:{port}{address.path}" + (f"?{address.query}" if address.query else "")
    if address.scheme.startswith("rtsp"):
        request = f"DESCRIBE {target} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n"
    else:
        resource = (address.path or "/") + (f"?{address.query}" if address.query else "")
        request = f"GET {resource} HTTP/1.0\r\nHost: {host}\r\n\r\n"
    with socket.create_connection((host, port), CAMERA_ANSWERS_S) as connection:
        if address.scheme in ("rtsps", "https"):
            return None
        connection.settimeout(CAMERA_ANSWERS_S)
        try:
            connection.sendall(request.encode("utf-8", "replace"))
            match = _STATUS.match(connection.recv(256))
        except TimeoutError:
            return None
    return int(match[1]) if match else None

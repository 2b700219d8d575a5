"""Who holds a port: asked before it is listened on, so that a second program says so instead of trying for ever."""

import socket
from typing import Final

from msgspec.structs import replace

from edge.link.settings import LinkSettings

EVERYWHERE: Final = frozenset({"0.0.0.0", "::", "*"})
LOOPBACK: Final = "127.0.0.1"
# A listener everywhere has a certificate of names that are not known here; that it is our authority's is checked still.
ANY_NAME: Final = "#verify_name_on_connect=false"


def place(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint such as tls/[::1]:7447#option."""
    host, _, port = endpoint.partition("/")[2].partition("#")[0].rpartition(":")
    return host.strip("[]"), int(port)


def why_not_free(host: str, port: int) -> OSError | None:
    """Why this port cannot be listened on; None if it can."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((host, port))
    except OSError as error:
        return error
    return None


def beside_listener(settings: LinkSettings) -> LinkSettings:
    """The settings with which a second program on this machine reaches those who dial the first one.

    Where the first one listens, it is dialled as a client, to whom it forwards; with its own certificate. Where it does
    not, or nothing holds its ports, these are its own settings.
    """
    taken = [endpoint for endpoint in settings.listen if why_not_free(*place(endpoint)) is not None]
    if not taken:
        return settings
    connect = tuple(_dialled(endpoint) for endpoint in taken)
    # The list of who may say what is the listener's: applied here, it would let the listener speak for itself only.
    tls = None if settings.tls is None else replace(settings.tls, access="")
    return LinkSettings(mode="client", connect=connect, tls=tls, insecure=settings.insecure)


def _dialled(endpoint: str) -> str:
    protocol, (host, port) = endpoint.partition("/")[0], place(endpoint)
    if host not in EVERYWHERE:
        return endpoint.partition("#")[0]
    return f"{protocol}/{LOOPBACK}:{port}" + ("" if protocol == "tcp" else ANY_NAME)

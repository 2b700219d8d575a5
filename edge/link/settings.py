"""What a site chooses of its link: who dials whom, and whether everybody proves who he is.

The hazard is the convenient default: a plain endpoint that others can reach lets anybody add an aircraft. So that is
refused here, where it is read, unless the file says so in words. What Zenoh makes of it is in profile.py; this file
loads nothing of Zenoh, so that a configuration can be read where no network is.
"""

import re
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

Endpoint = Annotated[str, Meta(pattern=r"^(tcp|tls|quic)/.+:\d{1,5}(#.+)?$")]

LOOPBACK_ENDPOINT: Final = "tcp/127.0.0.1:7447"  # Zenoh's own port; loopback, because development has no TLS


def is_loopback(endpoint: str) -> bool:
    """Whether an endpoint can only be reached from this machine."""
    return re.match(r"^\w+/(127\.|localhost:|\[::1\])", endpoint) is not None


class TlsSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The files that `base-station certs issue` makes, on this machine."""

    authority: Annotated[str, Meta(min_length=1, description="authority.pem: whom we believe")]
    certificate: Annotated[str, Meta(min_length=1, description="certificate.pem: who we are")]
    key: Annotated[str, Meta(min_length=1, description="key.pem, mode 0600: the proof of it")]
    access: Annotated[str, Meta(description="access.json: who may say what; whoever listens needs it")] = ""


class LinkSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who dials whom. A small site: the base listens and the boxes dial it, both as `peer`; through a router: `client`.

    Two programs never dial each other: after a one-sided timeout such a pair can stay split for days.
    """

    mode: Annotated[
        Literal["peer", "client", "router"], Meta(description="client: everything goes through a router")
    ] = "peer"
    connect: Annotated[tuple[Endpoint, ...], Meta(description="whom this program dials: PROTOCOL/HOST:PORT")] = ()
    listen: Annotated[tuple[Endpoint, ...], Meta(description="where this program is dialled: PROTOCOL/HOST:PORT")] = ()
    tls: TlsSettings | None = None
    insecure: Annotated[
        bool, Meta(description="listen without tls beyond this machine: for a bench, never for a hill")
    ] = False

    def __post_init__(self) -> None:
        plain = [endpoint for endpoint in (*self.listen, *self.connect) if endpoint.startswith("tcp/")]
        open_ears = [endpoint for endpoint in self.listen if not is_loopback(endpoint)]
        if self.tls is None and len(plain) < len(self.listen) + len(self.connect):
            raise ValueError(
                "a tls/ or quic/ endpoint needs [link.tls]: make its files with `base-station certs issue`"
            )
        if self.tls is not None and plain:
            raise ValueError(f"{plain[0]} beside [link.tls] would let anybody in: write tls/ instead of tcp/")
        if self.tls is not None and self.listen and not self.tls.access:
            raise ValueError("whoever listens needs [link.tls] access: the list of who may say what (access.json)")
        if self.tls is None and open_ears and not self.insecure:
            raise ValueError(
                f"{open_ears[0]} without [link.tls] lets anybody on the network add an aircraft:"
                " give [link.tls], or listen on 127.0.0.1, or set insecure = true"
            )

    @property
    def warning(self) -> str:
        """What to say loudly at start and in health; empty for the production profile."""
        if self.tls is not None:
            return ""
        beyond = [endpoint for endpoint in (*self.listen, *self.connect) if not is_loopback(endpoint)]
        where = f"on {', '.join(beyond)}" if beyond else "on this machine only"
        return f"DEVELOPMENT PROFILE: no TLS and no access control, {where}"


BOX_LINK: Final = LinkSettings(connect=(LOOPBACK_ENDPOINT,))
BASE_LINK: Final = LinkSettings(listen=(LOOPBACK_ENDPOINT,))

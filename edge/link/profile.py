"""How a Zenoh session is set up: the few things a site chooses, and the many that measurement chose for it.

The defaults of the library suit a laboratory: it looks for neighbours by multicast, gossips, shares memory (1.66 GB for
100 sessions), believes a dead link for 10 s and accepts messages of 1 GiB. Here nothing is found that was not named,
and a link that is dead is known to be so within 4 s. There are two profiles: with `tls`, everybody proves who he is and
may say only what the site's list allows (edge/link/access.py); without, anybody on the network can add an aircraft, so
that listens on loopback only, unless `insecure` says in so many words that it may not.
"""

import re
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import zenoh

from edge.link.access import access_control, load_access

Endpoint = Annotated[str, msgspec.Meta(pattern=r"^(tcp|tls|quic)/.+:\d{1,5}(#.+)?$")]

LOOPBACK_ENDPOINT: Final = "tcp/127.0.0.1:7447"  # Zenoh's own port; loopback, because development has no TLS
MAX_MESSAGE_BYTES: Final = 1 << 20  # the largest honest message, 1000 detections, is about 300 kB

# Each value: what was measured to work (a cut link is noticed in 4 s and redialled within 2 s of its return).
_TUNED: Final[dict[str, Any]] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "timestamping/enabled": False,  # the time that matters is in the payload
    "transport/link/tx/lease": 4000,  # ms
    "transport/link/tx/keep_alive": 4,  # per lease
    "transport/unicast/open_timeout": 2000,  # ms
    "transport/unicast/accept_timeout": 2000,  # ms
    "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
    "connect/retry": {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2},
    "listen/retry": {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2},
}

# At the ends of the site's radio: little is held back in buffers, for a second of old data only delays what is new.
# Measured at 180 kbit/s with 250 offered: p99 1.2 s instead of 7.9; on a clean link nothing changes.
_AT_THE_ENDS: Final[dict[str, Any]] = {
    "transport/link/tx/batch_size": 4096,  # bytes
    "transport/link/tcp/so_sndbuf": 16384,  # bytes
    "transport/link/tls/so_sndbuf": 16384,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 5000,  # us; our own thread waits, nobody else
    "transport/link/tx/queue/size/data_high": 4,  # batches
    "transport/link/tx/queue/size/data": 4,
}
# A router serves many: one that hangs must not hold up the others, so it waits less and keeps more.
_IN_THE_MIDDLE: Final[dict[str, Any]] = {
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 1000,
    "transport/link/tx/queue/size/data_high": 16,
    "transport/link/tx/queue/size/data": 16,
}


def is_loopback(endpoint: str) -> bool:
    """Whether an endpoint can only be reached from this machine."""
    return re.match(r"^\w+/(127\.|localhost:|\[::1\])", endpoint) is not None


class TlsSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The files that `python deploy/certs issue` makes, on this machine."""

    authority: str  # authority.pem: whom we believe
    certificate: str  # certificate.pem: who we are
    key: str  # key.pem, mode 0600: the proof of it
    access: str = ""  # access.json: who may say what; whoever listens needs it


class LinkSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who dials whom. A small site: the base listens and the boxes dial it, both as `peer`; through a router: `client`.

    Two programs never dial each other: after a one-sided timeout such a pair can stay split for days.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    tls: TlsSettings | None = None
    insecure: bool = False  # listen without tls beyond this machine: for a bench, never for a hill

    def __post_init__(self) -> None:
        plain = [endpoint for endpoint in (*self.listen, *self.connect) if endpoint.startswith("tcp/")]
        open_ears = [endpoint for endpoint in self.listen if not is_loopback(endpoint)]
        if self.tls is None and len(plain) < len(self.listen) + len(self.connect):
            raise ValueError(
                "a tls/ or quic/ endpoint needs [link.tls]: make its files with `python deploy/certs issue`"
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


def zenoh_config(settings: LinkSettings) -> zenoh.Config:
    """The complete session configuration of these settings. Raises ConfigError if the list of certificates is bad."""
    wanted = {"mode": settings.mode, "connect/endpoints": settings.connect, "listen/endpoints": settings.listen}
    place = _IN_THE_MIDDLE if settings.mode == "router" else _AT_THE_ENDS
    config = zenoh.Config()
    for key, value in (wanted | _TUNED | _security(settings.tls) | place).items():
        config.insert_json5(key, msgspec.json.encode(value).decode())
    return config


def _security(tls: TlsSettings | None) -> dict[str, Any]:
    if tls is None:
        return {}
    files = {
        "root_ca_certificate": tls.authority,
        "enable_mtls": True,
        "listen_certificate": tls.certificate,
        "listen_private_key": tls.key,
        "connect_certificate": tls.certificate,
        "connect_private_key": tls.key,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    allowed = {"access_control": access_control(load_access(Path(tls.access)))} if tls.access else {}
    return {"transport/link/protocols": ["tls", "quic"], "transport/link/tls": files} | allowed

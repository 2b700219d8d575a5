"""How a Zenoh session is set up: the few things a site chooses, and the many that measurement chose for it.

The defaults of the library suit a laboratory: it looks for neighbours by multicast, gossips, shares memory (1.66 GB for
100 sessions), believes a dead link for 10 s and accepts messages of 1 GiB. Here nothing is found that was not named,
and a link that is dead is known to be so within 4 s. There are two profiles: with `tls`, everybody proves who he is and
may say only what the site's list allows (edge/link/access.py); without, anybody on the network can add an aircraft, so
that listens on loopback only, unless `insecure` says in so many words that it may not.
"""

from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh

from edge.link.access import access_control, load_access
from edge.link.settings import LinkSettings, TlsSettings

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

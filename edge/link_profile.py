"""How a Zenoh session is set up: the few things a site chooses, and the many that measurement chose for it.

The defaults of the library suit a laboratory: it looks for neighbours by multicast, gossips, shares memory (1.66 GB for
100 sessions), believes a dead link for 10 s and accepts messages of 1 GiB. Here nothing is found that was not named,
and a link that is dead is known to be so within 4 s.
"""

from typing import Annotated, Final, Literal

import msgspec
import zenoh

Endpoint = Annotated[str, msgspec.Meta(pattern=r"^(tcp|tls|quic)/.+:\d{1,5}(#.+)?$")]

LOOPBACK_ENDPOINT: Final = "tcp/127.0.0.1:7447"  # Zenoh's own port; loopback, because development has no TLS
MAX_MESSAGE_BYTES: Final = 1 << 20  # the largest honest message, 1000 detections, is about 300 kB

# Each key: what was measured to work (a cut link is noticed in 4 s and redialled within 1 s of its return).
_TUNED: Final[dict[str, str]] = {
    "scouting/multicast/enabled": "false",
    "scouting/gossip/enabled": "false",
    "transport/shared_memory/enabled": "false",
    "timestamping/enabled": "false",  # the time that matters is in the payload
    "transport/link/tx/lease": "4000",  # ms
    "transport/link/tx/keep_alive": "4",  # per lease
    "transport/unicast/open_timeout": "2000",  # ms
    "transport/unicast/accept_timeout": "2000",  # ms
    "transport/link/rx/max_message_size": str(MAX_MESSAGE_BYTES),
    "connect/retry": "{period_init_ms: 250, period_max_ms: 1000, period_increase_factor: 2}",
    "listen/retry": "{period_init_ms: 250, period_max_ms: 1000, period_increase_factor: 2}",
}


class LinkSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who dials whom. A small site: the base listens and the boxes dial it, both as `peer`; through a router: `client`.

    Two programs never dial each other: after a one-sided timeout such a pair can stay split for days.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()


BOX_LINK: Final = LinkSettings(connect=(LOOPBACK_ENDPOINT,))
BASE_LINK: Final = LinkSettings(listen=(LOOPBACK_ENDPOINT,))


def zenoh_config(settings: LinkSettings) -> zenoh.Config:
    """The complete session configuration of these settings."""
    config = zenoh.Config()
    config.insert_json5("mode", _json(settings.mode))
    config.insert_json5("connect/endpoints", _json(settings.connect))
    config.insert_json5("listen/endpoints", _json(settings.listen))
    for key, value in _TUNED.items():
        config.insert_json5(key, value)
    return config


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()

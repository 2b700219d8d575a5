"""How an RTK receiver is read: what a box's `[gnss]` and a base's `[receiver]` have in common, so that advice about one
can be followed at the other.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from edge.gnss.decoders import ProtocolName, check_protocols


class ReceiverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A receiver, and what an operator has to say of it."""

    device: Annotated[str, Meta(min_length=1, description="serial device, socket://host:port or a recording")]
    baud: Annotated[int, Meta(ge=0, le=4_000_000, description="bits a second; 0: try the usual ones")] = 115200
    protocols: Annotated[
        tuple[ProtocolName, ...], Meta(description="what it sends; empty: whichever of them are recognised")
    ] = ()
    service: Annotated[
        Literal["own-base", "network-rtk", "ppp-rtk"], Meta(description="where the corrections come from")
    ] = "network-rtk"
    baseline_m: Annotated[float, Meta(ge=0, le=1e5, description="to the base station, where there is a real one")] = 0.0
    separation_m: Annotated[
        Annotated[float, Meta(ge=-120, le=100)] | None,
        Meta(description="geoid above ellipsoid, in place of what the receiver sends; 0: its heights are ellipsoidal"),
    ] = None
    accept_unknown_age: Annotated[bool, Meta(description="for a receiver that sends no age of corrections")] = False

    def __post_init__(self) -> None:
        check_protocols("protocols", self.protocols)

"""How a machine knows UTC: the `[clock]` section of edge.toml and base.toml."""

from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

LIMIT_S: Final = 0.01  # at 20 m/s it is 0.2 m
ClockBound = Annotated[float, Meta(ge=0, le=1e6)]  # s: the same as on the wire


class ClockConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the machine knows UTC."""

    source: Annotated[
        Literal["auto", "ptp", "assumed"],
        Meta(description="auto: chrony, else the kernel; ptp: ptp4l; assumed: assumed_bound_s is taken at its word"),
    ] = "auto"
    limit_s: Annotated[float, Meta(gt=0, le=3600, description="check fails where UTC may be further off")] = LIMIT_S
    assumed_bound_s: Annotated[ClockBound, Meta(description="assumed: how far this machine's UTC may be off")] = 0.01

"""A GNSS receiver at the base as an input: edge/gnss's reader, opened as base.toml and the command line want it."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from calib.station.config import ReceiverSection
from calib.station.inputs.input import PositionInput
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.receiver import Receiver


def receiver_settings(section: ReceiverSection | None, *, where: str, **own: Any) -> GnssConfig:
    """How the receiver is read. own: keys of the section that were given otherwise, None where they were not.

    where: the configuration. Raises ConfigError.
    """
    table = {"baud": 0} if section is None else msgspec.to_builtins(section)  # 0: the usual ones are tried
    table |= {key: value for key, value in own.items() if value is not None}
    if table.get("device") is None:
        raise ConfigError("no receiver", where=where, action="give --device, or [receiver] device")
    return build(table, GnssConfig, where="receiver")


@contextmanager
def opened_receiver(settings: GnssConfig, undulation_m: float | None = None) -> Iterator[PositionInput]:
    """A receiver that is read by a thread of its own until the context is left. undulation_m: as Receiver has it."""
    with Receiver(settings, undulation_m=undulation_m) as receiver:
        yield receiver

"""A GNSS receiver at the base as an input: edge/gnss's reader, opened as base.toml and the command line want it."""

from collections.abc import Iterator
from contextlib import contextmanager

from calib.station.config import ReceiverSection
from calib.station.inputs.input import PositionInput
from edge.common.errors import ConfigError
from edge.common.settings import build
from edge.config import GnssConfig
from edge.gnss.receiver import Receiver


def receiver_settings(
    section: ReceiverSection | None, *, device: str | None, service: str, baseline_m: float, where: str
) -> GnssConfig:
    """How the receiver is read. device: instead of the section's. where: the configuration. Raises ConfigError."""
    chosen = device or (section.device if section is not None else None)
    if chosen is None:
        raise ConfigError("no receiver", where=where, action="give --device, or [receiver] device")
    baud = 0 if section is None else section.baud  # 0: the usual ones are tried
    table = {"device": chosen, "baud": baud, "service": service, "baseline_m": baseline_m}
    return build(table, GnssConfig, where="receiver")


@contextmanager
def opened_receiver(settings: GnssConfig) -> Iterator[PositionInput]:
    """A receiver that is read by a thread of its own until the context is left."""
    with Receiver(settings) as receiver:
        yield receiver

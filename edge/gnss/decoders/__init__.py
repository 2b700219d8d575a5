"""The receivers' protocols there are: a new one is a file here and its line in PROTOCOLS."""

from typing import Annotated, Final

from edge.common.plugs import check_name, name_among
from edge.gnss.decoder import Decoder
from edge.gnss.decoders.nmea import Nmea
from edge.gnss.decoders.ubx import Ubx

PROTOCOLS: Final[dict[str, type[Decoder]]] = {decoder.name: decoder for decoder in (Nmea, Ubx)}

# The name of a protocol in a configuration. A struct that holds some asks check_protocols in its __post_init__.
ProtocolName = Annotated[str, name_among(PROTOCOLS)]


def check_protocols(field: str, names: tuple[str, ...]) -> None:
    """Raises ValueError for the name of no protocol."""
    for name in names:
        check_name(field, name, PROTOCOLS)


def decoders(names: tuple[str, ...] = ()) -> list[Decoder]:
    """New decoders of those protocols; of all there are where none is named, so that each is recognised."""
    return [PROTOCOLS[name]() for name in names or PROTOCOLS]

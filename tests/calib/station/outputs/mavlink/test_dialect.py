"""The committed dialect is what its XML says, and the wire is as long as MAVLink allows."""

import xml.etree.ElementTree as ET

import pytest

from calib.station.outputs.mavlink import dialect
from tools.make_dialect import DIALECT, XML, generate

LONGEST_PAYLOAD = 255  # bytes; mavgen does not check it
BYTES = {"uint8_t": 1, "uint16_t": 2, "uint32_t": 4, "uint64_t": 8, "float": 4, "double": 8}


def test_the_committed_module_is_generated_from_the_xml() -> None:
    assert generate(XML.read_text()) == DIALECT.read_text(), "run python -m tools.make_dialect"


def test_ids_lie_in_the_private_range_and_below_what_message_interval_can_name() -> None:
    assert all(45000 <= number <= 45099 for number in dialect.mavlink_map)


@pytest.mark.parametrize("message", ET.parse(XML).getroot().findall("./messages/message"), ids=lambda m: m.get("name"))
def test_payloads_fit_and_fields_are_in_wire_order(message: ET.Element) -> None:
    sizes, total = [], 0
    for field in message.findall("field"):
        kind, _, count = field.attrib["type"].rstrip("]").partition("[")
        sizes.append(BYTES[kind])
        total += BYTES[kind] * int(count or 1)
    assert total <= LONGEST_PAYLOAD
    assert sizes == sorted(sizes, reverse=True)


def test_the_layout_that_was_released_does_not_change() -> None:
    """Any change of these numbers breaks every receiver in the field: give the message a new id instead."""
    assert dialect.MAVLink_target_track_ecef_message.crc_extra == 226
    assert dialect.MAVLink_target_track_ecef_message.unpacker.size == 151
    assert dialect.MAVLink_tracker_status_message.unpacker.size == 34

"""Names of what can be plugged in: known when a schema is written, asked for when a value is read."""

from typing import Annotated

import msgspec
import pytest

from edge.common.errors import ConfigError
from edge.common.plugs import check_name, name_among
from edge.common.settings import build

KNOWN = {"b": 2, "a": 1}


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table with a name in it."""

    kind: Annotated[str, name_among(KNOWN, "which one")] = "a"

    def __post_init__(self) -> None:
        check_name("kind", self.kind, KNOWN)


def test_the_schema_lists_the_names() -> None:
    field = msgspec.json.schema(Section)["$defs"]["Section"]["properties"]["kind"]
    assert (field["enum"], field["description"]) == (["a", "b"], "which one")


def test_an_unknown_name_is_named_with_its_key_and_what_is_allowed() -> None:
    with pytest.raises(ConfigError) as caught:
        build({"kind": "c"}, Section, where="x.toml")
    assert "x.toml: key kind = 'c' is not allowed" in str(caught.value)
    assert 'give one of "a", "b" (which one)' in caught.value.action


def test_one_that_came_later_is_read_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KNOWN, "c", 3)
    assert build({"kind": "c"}, Section, where="x.toml").kind == "c"

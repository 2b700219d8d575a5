"""Words that a later version of the program added to a list of words, read by an earlier one.

The hazard is the new state or level: to whoever decodes strictly, it makes the whole message wrong, and a box that was
upgraded goes dumb. So each list of words on the wire names the word to read instead, and a message that does not decode
as it is gets one more chance with those in place. What is wrong in any other way stays wrong.
"""

from functools import cache
from typing import Any, Final

import msgspec
from msgspec import inspect

NEWER: Final = "newer_word"


def newer_word(instead: str) -> msgspec.Meta:
    """For `Annotated[Literal[...], newer_word("...")]`: what to read for a word that is not in the list."""
    return msgspec.Meta(extra={NEWER: instead})


def with_known_words(value: Any, kind: type) -> Any:
    """A decoded value in which each unknown word of a list that names a substitute is replaced by it."""
    return _known(value, _type_info(kind))


@cache
def _type_info(kind: type) -> inspect.Type:
    return inspect.type_info(kind)


def _known(value: Any, kind: inspect.Type) -> Any:
    if isinstance(kind, inspect.Metadata):
        instead = (kind.extra or {}).get(NEWER)
        if instead is not None and isinstance(kind.type, inspect.LiteralType) and isinstance(value, str):
            return value if value in kind.type.values else instead
        return _known(value, kind.type)
    if isinstance(kind, inspect.StructType) and isinstance(value, dict):
        kinds = {field.encode_name: field.type for field in kind.fields}
        return {name: _known(each, kinds[name]) if name in kinds else each for name, each in value.items()}
    if isinstance(kind, inspect.ListType) and isinstance(value, list):
        return [_known(each, kind.item_type) for each in value]
    return value

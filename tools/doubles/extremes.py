"""Valid messages with extreme values: what a camera that is let in may say, by fault or by malice.

Random bytes are refused where they are decoded; what ended stations was valid JSON with a number nobody had thought of.
So honest messages are taken, and a few of their fields set to the ends of what their type allows: least, most, none,
the smallest number that is not 0, and lists that are empty or full. The types are the wire contract's own; a field that
is added to a message is in here the day it is added.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import msgspec
from msgspec import inspect

Message = TypeVar("Message", bound=msgspec.Struct)

SMALL: Final = (5e-324, 1e-300, 1e-30, 1e-9)  # numbers that are not 0, and whose squares are
LARGE: Final = (1e308, 1e154, 1e30)  # finite, and their squares are not
WORDS: Final = ("", "x", "\x00", "\u202e", "<b>", "\U0001f6f8" * 60)
MOST_ITEMS: Final = 300  # of a list that has no bound of its own


@dataclass
class Extremes:
    """Draws messages of one type. draw: the source of all chance; begin it with a seed."""

    draw: random.Random

    def of(self, honest: Message, fields: int = 2) -> Message:
        """An honest message with some fields, or fields of what it holds, at the ends of their types."""
        try:
            return self._changed(honest, fields)
        except ValueError:  # two fields that do not go together: the type itself refuses them
            return honest

    def _changed(self, honest: Message, fields: int) -> Message:
        info = inspect.type_info(type(honest))
        assert isinstance(info, inspect.StructType)
        chosen = self.draw.sample(info.fields, min(fields, len(info.fields)))
        change = {field.name: self._value(field.type, getattr(honest, field.name)) for field in chosen}
        return msgspec.convert(msgspec.to_builtins(msgspec.structs.replace(honest, **change)), type(honest))

    def _value(self, kind: Any, honest: Any) -> Any:
        """A value at an end of a type; one like the honest one where the type has no ends."""
        makers: dict[type, Callable[[Any, Any], Any]] = {
            inspect.Metadata: lambda wrapped, now: self._value(wrapped.type, now),
            inspect.UnionType: lambda union, now: self._value(self.draw.choice(union.types), now),
            inspect.NoneType: lambda _, __: None,
            inspect.BoolType: lambda _, __: self.draw.random() < 0.5,
            inspect.IntType: self._whole,
            inspect.FloatType: self._real,
            inspect.StrType: lambda text, now: now if text.pattern else self.draw.choice(WORDS)[: text.max_length],
            inspect.LiteralType: lambda words, _: self.draw.choice(words.values),
            inspect.ListType: self._items,
            inspect.VarTupleType: lambda several, now: tuple(self._items(several, now)),
            inspect.TupleType: self._tuple,
            inspect.DictType: self._dict,
            inspect.StructType: lambda struct, now: self._changed(now, 2) if isinstance(now, struct.cls) else now,
        }
        return makers[type(kind)](kind, honest)

    def _whole(self, kind: inspect.IntType, honest: Any) -> int:
        least = kind.ge if kind.ge is not None else -(2**53)
        most = kind.le if kind.le is not None else 2**53
        near = [honest + step for step in (-1, 1, 10**6, -(10**9))] if isinstance(honest, int) else []
        return self.draw.choice([least, most, *(one for one in near if least <= one <= most)])

    def _real(self, kind: inspect.FloatType, honest: Any) -> float:
        ends = [end for end in (kind.ge, kind.gt, kind.le, kind.lt) if end is not None]
        scaled = [honest * factor for factor in (0.5, 0.99, 1.01, 2.0, -1.0)] if isinstance(honest, float) else []
        tried = [*ends, 0.0, -0.0, *SMALL, *(-one for one in SMALL), *LARGE, *(-one for one in LARGE), *scaled]
        return self.draw.choice([one for one in tried if _within(kind, one)])

    def _items(self, kind: Any, honest: Sequence[Any]) -> list[Any]:
        """Empty, one, as many as there were, as many as there may be; of honest ones, some of them changed."""
        most = kind.max_length if kind.max_length is not None else MOST_ITEMS
        least = kind.min_length or 0
        count = max(least, self.draw.choice([least, 1, len(honest), most]))
        if not honest:
            return []
        found = [honest[index % len(honest)] for index in range(count)]
        for index in self.draw.sample(range(count), min(count, 3)):
            found[index] = self._value(kind.item_type, found[index])
        return found

    def _tuple(self, kind: inspect.TupleType, honest: Sequence[Any] | None) -> tuple[Any, ...]:
        known = list(honest) if honest else [None] * len(kind.item_types)
        drawn = [self._value(one, now) for one, now in zip(kind.item_types, known, strict=True)]
        # One of them as often as all: three absurd numbers are refused by rules that one passes.
        if honest and self.draw.random() < 0.5:
            which = self.draw.randrange(len(drawn))
            return tuple(drawn[which] if index == which else now for index, now in enumerate(honest))
        return tuple(0.0 if one is None else one for one in drawn)

    def _dict(self, kind: inspect.DictType, honest: dict[str, Any] | None) -> dict[str, Any]:
        count = self.draw.choice([0, 1, MOST_ITEMS])
        return {f"{self.draw.choice(WORDS)}{index}": self._value(kind.value_type, 0.5) for index in range(count)}


def _within(kind: inspect.FloatType, value: float) -> bool:
    return (
        math.isfinite(value)
        and (kind.ge is None or value >= kind.ge)
        and (kind.gt is None or value > kind.gt)
        and (kind.le is None or value <= kind.le)
        and (kind.lt is None or value < kind.lt)
    )

"""Reading a configuration file: TOML in, frozen typed structs out, and every fault named.

The hazard is the silent default. A misspelt key that is ignored leaves the operator sure of a setting that was never
made, and a number in the wrong unit is found on a mountain. So an unknown key, a wrong type and a value out of range
are all refused, with the file, the key, what is allowed there and, for a misspelling, the key that was probably meant.
"""

import difflib
import functools
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
from msgspec import inspect

from edge.common.errors import ConfigError
from edge.common.toml_text import read_toml

Settings = TypeVar("Settings", bound=msgspec.Struct)

# A struct's class attribute of this name says of keys that it had once where they went: {key: (what, action)}.
MOVED: Final = "MOVED"
FIX_IT: Final = "correct it and start again"
_UNKNOWN: Final = re.compile(r"unknown field `(?P<key>[^`]*)`")
_MISSING: Final = re.compile(r"missing required field `(?P<key>[^`]*)`")
_NAMED: Final = re.compile(r"^field `(?P<key>[^`]*)`: ")  # what a struct's own check found
_AT: Final = re.compile(r" - at `\$(?P<path>[^`]*)`$")
_STEP: Final = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")


def load(path: Path | str, kind: type[Settings]) -> Settings:
    """The settings in a TOML file. Raises ConfigError naming file, key, what is allowed and the nearest valid key."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8-sig")  # some editors begin a file with an invisible mark
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"cannot be read ({error})", where=str(file), action="give the path of a readable TOML file"
        ) from error
    return parse(text, kind, where=str(file))


def parse(text: str, kind: type[Settings], *, where: str) -> Settings:
    """The settings in TOML text; `where` names its origin in errors. Raises ConfigError as `load` does."""
    try:
        tree = read_toml(text)
    except ValueError as error:
        raise ConfigError(f"is not TOML ({error})", where=where, action=FIX_IT) from error
    return build(tree, kind, where=where)


def build(tree: dict[str, Any], kind: type[Settings], *, where: str) -> Settings:
    """The settings in an already parsed tree. Raises ConfigError as `load` does."""
    _refuse_non_finite(tree, where)
    try:
        return msgspec.convert(tree, kind)
    except msgspec.ValidationError as error:
        raise _explain(str(error), tree, kind, where) from error


def _refuse_non_finite(node: object, where: str, key: str = "") -> None:
    """TOML can say nan and inf, and a comparison against a range lets nan through."""
    if isinstance(node, dict):
        for name, value in node.items():
            _refuse_non_finite(value, where, f"{key}.{name}".lstrip("."))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            _refuse_non_finite(value, where, f"{key}[{index}]")
    elif isinstance(node, float) and not math.isfinite(node):
        raise ConfigError(f"key {key} is {node}", where=where, action="give a finite number")


def _explain(message: str, tree: dict[str, Any], kind: type[msgspec.Struct], where: str) -> ConfigError:
    """Our own sentence for msgspec's: the key in full, what is allowed there, and the nearest valid key."""
    at = _AT.search(message)
    path = at["path"] if at else ""
    fault = _AT.sub("", message)
    if unknown := _UNKNOWN.search(message):
        return _unknown_key(unknown["key"], path, kind, where)
    if missing := _MISSING.search(message):
        key = _join(path, missing["key"])
        wanted = _in_words(_type_at(kind, f"{path}.{missing['key']}"))
        return ConfigError(f"key {key} is missing", where=where, action=f"add it: {wanted}")
    if named := _NAMED.search(fault):
        path, fault = f"{path}.{named['key']}", fault[named.end() :]
    key = path.lstrip(".") or "(the whole file)"
    value = _value_at(tree, path)
    refused = f"key {key} = {value!r} is not allowed ({fault[:1].lower()}{fault[1:]})"
    return ConfigError(refused, where=where, action=f"give {_in_words(_type_at(kind, path))}")


def _in_words(kind: inspect.Type) -> str:
    note = description(kind)
    return f"{allowed(kind)} ({note})" if note else allowed(kind)


def _unknown_key(key: str, path: str, kind: type[msgspec.Struct], where: str) -> ConfigError:
    there = _bare(_type_at(kind, path))
    moved = getattr(there.cls, MOVED, {}) if isinstance(there, inspect.StructType) else {}
    if key in moved:
        what, action = moved[key]
        return ConfigError(f"{_join(path, key)} {what}", where=where, action=action)
    names = _field_names(there)
    near = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
    meant = f'did you mean "{near[0]}"? ' if near else ""
    return ConfigError(
        f"unknown key {_join(path, key)}", where=where, action=f"{meant}allowed here: {', '.join(names)}"
    )


def _join(path: str, key: str) -> str:
    return f"{path}.{key}".lstrip(".")


def _type_at(kind: type[msgspec.Struct], path: str) -> inspect.Type:
    """The declared type at a path such as `.camera[0].source`."""
    found: inspect.Type = inspect.type_info(kind)
    for name, index in _STEP.findall(path):
        found = _inside(found, name, index)
    return found


def _inside(parent: inspect.Type, name: str, index: str) -> inspect.Type:
    """One step down: the field `name`, or where `name` is empty the item `index`, or any."""
    if isinstance(parent, inspect.Metadata):
        return _inside(parent.type, name, index)
    if isinstance(parent, inspect.UnionType):
        wanted = inspect.StructType if name else (inspect.VarTupleType, inspect.TupleType, inspect.ListType)
        options = [option for option in map(_bare, parent.types) if isinstance(option, wanted)]
        return _inside(options[0], name, index) if options else parent
    if isinstance(parent, inspect.StructType):
        return next((field.type for field in parent.fields if field.encode_name == name), parent)
    if isinstance(parent, inspect.VarTupleType | inspect.ListType):
        return parent.item_type
    if isinstance(parent, inspect.TupleType):
        return parent.item_types[int(index) if index.isdigit() else 0]
    return parent


def _bare(kind: inspect.Type) -> inspect.Type:
    return kind.type if isinstance(kind, inspect.Metadata) else kind


def _field_names(kind: inspect.Type) -> list[str]:
    kind = _bare(kind)
    if isinstance(kind, inspect.UnionType):
        return [name for option in kind.types for name in _field_names(option)]
    return [field.encode_name for field in kind.fields] if isinstance(kind, inspect.StructType) else []


def _value_at(tree: object, path: str) -> object:
    for name, index in _STEP.findall(path):
        if isinstance(tree, dict):
            tree = tree.get(name)
        elif isinstance(tree, list) and index.isdigit():
            tree = tree[int(index)]
    return tree


def description(kind: inspect.Type) -> str:
    """What a key is for: the sentence in its type, or that of its table; empty if nobody wrote one."""
    if isinstance(kind, inspect.Metadata):
        return str((kind.extra_json_schema or {}).get("description", "")) or description(kind.type)
    return " ".join((kind.cls.__doc__ or "").split()) if isinstance(kind, inspect.StructType) else ""


@functools.singledispatch
def allowed(kind: inspect.Type) -> str:
    """What a key may hold, in words."""
    return type(kind).__name__.removesuffix("Type").lower()


@allowed.register
def _(kind: inspect.Metadata) -> str:
    names = (kind.extra_json_schema or {}).get("enum")
    return _one_of(names) if names else allowed(kind.type)


@allowed.register
def _(kind: inspect.UnionType) -> str:
    return " or ".join(allowed(option) for option in kind.types if not isinstance(option, inspect.NoneType))


@allowed.register
def _(kind: inspect.LiteralType) -> str:
    return _one_of(kind.values)


def _one_of(values: Iterable[object]) -> str:
    return "one of " + ", ".join(f'"{value}"' for value in values)


@allowed.register(inspect.IntType)
@allowed.register(inspect.FloatType)
def _(kind: inspect.IntType | inspect.FloatType) -> str:
    word = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
    limits = ((">", kind.gt), (">=", kind.ge), ("<", kind.lt), ("<=", kind.le))
    bounds = " and ".join(f"{sign} {limit:.15g}" for sign, limit in limits if limit is not None)
    return f"{word} {bounds}".rstrip()


@allowed.register
def _(kind: inspect.StrType) -> str:
    return f'text matching "{kind.pattern}"' if kind.pattern else "text"


@allowed.register
def _(kind: inspect.BoolType) -> str:
    return "true or false"


@allowed.register
def _(kind: inspect.DictType) -> str:
    return "a table"


@allowed.register
def _(kind: inspect.StructType) -> str:
    return f"a table with {', '.join(_field_names(kind))}"


@allowed.register(inspect.VarTupleType)
@allowed.register(inspect.ListType)
def _(kind: inspect.VarTupleType | inspect.ListType) -> str:
    return f"a list, each {allowed(kind.item_type)}"


@allowed.register
def _(kind: inspect.TupleType) -> str:
    items = [allowed(item) for item in kind.item_types]
    return f"[{', '.join(items)}]" if len(set(items)) > 1 else f"a list of {len(items)}, each {items[0]}"

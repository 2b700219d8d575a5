"""TOML text as a tree: whatever the text holds, either that or a ValueError.

The hazard is the file that ends a program at every start. Brackets in brackets exhaust the stack of whoever follows
them, here or later, and a number of five thousand digits is no ValueError of the parser's own kind: neither is caught
where "this is not TOML" is.
"""

import tomllib
from typing import Any, Final

DEEPEST: Final = 20  # levels: no file of ours has more than six


def read_toml(text: str) -> dict[str, Any]:
    """The tree. Raises ValueError, with the place where the text goes wrong, if it is none or nested too deeply."""
    try:
        tree = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(_too_deep()) from error
    level: list[object] = [tree]
    for _ in range(DEEPEST):
        level = [below for node in level for below in _below(node)]
        if not level:
            return tree
    raise ValueError(_too_deep())


def _below(node: object) -> list[object]:
    if isinstance(node, dict):
        return list(node.values())
    return list(node) if isinstance(node, list) else []


def _too_deep() -> str:
    return f"nested more than {DEEPEST} levels deep"

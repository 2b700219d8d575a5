"""One observation about one thing, and which of two levels is worse: the words in which every part says how it is."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

HealthLevel = Literal["ok", "warn", "fail"]
SEVERITY: Final[dict[HealthLevel, int]] = {"ok": 0, "warn": 1, "fail": 2}


@dataclass(frozen=True)
class Check:
    """One observation about one thing, as of now. `action` is what the operator should do; empty if nothing."""

    name: str
    level: HealthLevel
    reason: str
    action: str = ""


def worst(levels: Iterable[HealthLevel]) -> HealthLevel:
    """The worst of some levels; "ok" of none."""
    return max(levels, key=SEVERITY.__getitem__, default="ok")

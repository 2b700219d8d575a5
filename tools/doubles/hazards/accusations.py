"""Which cameras an answer says something is wrong with: its findings, and what it left out.

The hazard is a count that punishes honesty. A sentence that gives several cameras and says that they cannot be told
apart accuses all of them together, and is right if the guilty one is among them; one that lists the cameras that are
fine accuses nobody. Findings say which cameras they are of; a refusal is read by a rule that is written down here.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from calib.solving.solution import SolutionReport

# What a refusal says next to a camera's name when it accuses it, and not only lists it.
ACCUSING: Final = re.compile(
    r"does not fit|looks? (wrong|swapped)|is wrong|are exchanged|is off|out of line|without it|left out|its own bound"
    r"|has no pose as it is|no pose explains|another camera's|is a copy|was (moved|turned|knocked)|has stepped"
)
# Cameras are given, but not told apart.
UNDECIDED: Final = re.compile(r"cannot be (excluded|told)|cannot tell|one of|nobody can|do not know enough")


@dataclass(frozen=True)
class Accusation:
    """cameras: said to be at fault. undecided: one of them, and the sentence says that it does not know which."""

    cameras: frozenset[str]
    undecided: bool
    sentence: str

    def innocent(self, guilty: frozenset[str]) -> frozenset[str]:
        """Those of whom it is wrong."""
        if self.undecided:
            return frozenset() if self.cameras & guilty else self.cameras
        return self.cameras - guilty


def in_report(report: SolutionReport, cameras: tuple[str, ...]) -> list[Accusation]:
    """What was left out, and what was found."""
    found = [Accusation(frozenset(each.cameras), each.undecided, each.sentence) for each in report.findings]
    found += [Accusation(frozenset([name]), undecided=False, sentence=why) for name, why in report.left_out]
    return [accusation for accusation in found if accusation.cameras]


def in_refusal(message: str, cameras: tuple[str, ...]) -> list[Accusation]:
    """What the words of a refusal accuse."""
    if not ACCUSING.search(message):
        return []
    accusation = _of(message, cameras)
    return [accusation] if accusation.cameras else []


def _of(sentence: str, cameras: Iterable[str]) -> Accusation:
    named = frozenset(name for name in cameras if re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", sentence))
    if len(named) == len(tuple(cameras)):
        named = frozenset()  # everybody is nobody
    return Accusation(named, bool(UNDECIDED.search(sentence)), sentence)

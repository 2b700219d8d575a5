"""What a calibration found to be wrong: the sentence for people, and for programs what of which camera it speaks of.

The hazard is a program that reads names out of sentences: "cam2 or cam3, nobody can tell which" accuses neither of
them, and a sentence that lists the cameras that are well accuses nobody.
"""

from dataclasses import dataclass
from enum import StrEnum


class Cause(StrEnum):
    """What of a camera, or of the whole site, is wrong."""

    POSITION = "position"  # surveyed elsewhere than it stands
    LENS = "lens"  # the lens file is another's, or of another picture size
    CLOCK = "clock"  # offset, rate or step of its stamps
    POSE = "pose"  # turned or moved in flight
    TRACKS = "tracks"  # its rows are not of what it saw: another camera's, mirrored, of two objects, sentinels
    VIEWS = "views"  # nothing is wrong with it, but it shares too little with the others


@dataclass(frozen=True)
class Found:
    """cameras: of which `cause` is wrong, all of them together; none: it is of the site. undecided: one of them is the
    one, and the observations cannot tell which. cure: what to do about it, where that can be said.
    """

    cause: Cause
    cameras: tuple[str, ...]
    sentence: str
    undecided: bool = False
    cure: str = ""

    def __str__(self) -> str:
        return f"{self.sentence}: {self.cure}" if self.cure else self.sentence

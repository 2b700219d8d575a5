"""The last seconds of evidence, slice by slice, and which objects of one slice are those of the slice before.

The hazard is an object counted twice: its box is off by the same in all its slices, and only the camera's own track
number tells that they are its slices. An object keeps its number here as long as any camera keeps its.
"""

from collections import Counter, deque
from dataclasses import dataclass

from calib.guarding.evidence import ObjectEvidence, without_camera


@dataclass(frozen=True)
class Slice:
    """Evidence of one slice that ends at t_unix_ns, each object's with its number."""

    t_unix_ns: int
    objects: tuple[tuple[int, ObjectEvidence], ...]


class EvidenceMemory:
    """Slices, newest last: those of the longest window, and the older ones that they are compared with."""

    def __init__(self, longest_ns: int, older_ns: int = 0) -> None:
        self._longest_ns = longest_ns
        self._older_ns = older_ns
        self._slices: deque[Slice] = deque()
        self._number: dict[tuple[int, int], int] = {}
        self._next = 0

    def clear(self) -> None:
        """Forget all."""
        self._slices.clear()
        self._number.clear()

    def without(self, camera: int) -> None:
        """Forget what one camera (its number in the network) showed; what the others showed stays."""
        for at, one in enumerate(self._slices):
            left = ((number, without_camera(found, camera)) for number, found in one.objects)
            kept = tuple((number, found) for number, found in left if found is not None)
            self._slices[at] = Slice(one.t_unix_ns, kept)

    def add(self, t_unix_ns: int, found: list[ObjectEvidence]) -> list[Slice]:
        """Take a slice; returns those that the longest window no longer holds."""
        numbered = tuple((self._number_of(one), one) for one in found)
        self._number = {key: number for number, one in numbered for key in one.keys}
        last_ns = self._slices[-1].t_unix_ns if self._slices else t_unix_ns
        self._slices.append(Slice(t_unix_ns, numbered))
        while self._slices[0].t_unix_ns <= t_unix_ns - self._longest_ns - self._older_ns:
            self._slices.popleft()
        begin_ns, began_ns = t_unix_ns - self._longest_ns, last_ns - self._longest_ns
        return [one for one in self._slices if began_ns < one.t_unix_ns <= begin_ns]

    def _number_of(self, found: ObjectEvidence) -> int:
        votes = Counter(self._number[key] for key in found.keys if key in self._number)
        if votes:
            return votes.most_common(1)[0][0]
        self._next += 1
        return self._next

    def since(self, t_unix_ns: int) -> list[Slice]:
        """Slices with anything in them that ended after an instant, newest last."""
        return [one for one in self._slices if one.t_unix_ns > t_unix_ns and one.objects]

    def until(self, t_unix_ns: int) -> list[Slice]:
        """The others, that ended before or then."""
        return [one for one in self._slices if one.t_unix_ns <= t_unix_ns and one.objects]

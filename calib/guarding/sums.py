"""What all slices of some seconds say together of poses, clocks, and of what changed since an instant.

The hazard is a test that has to tell a knock from what a calibration never knew: a clock that states no bound may be
off by tens of milliseconds, an attitude by what the flight left open, a box by a share of its width. All these were
there before. So where slices from before an instant are at hand, they are witnesses too: every pose and clock is one
unknown through the whole time, and a change is what begins at that instant on top of it. A detector may go over to
another end of its object at that instant too, and stay there: so each object's boxes may have jumped, and one object is
worth one jump, however long it is seen after. Without slices from before, a change and an error that always was are the
same, and only what is expected of a network tells them apart.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.guarding.evidence import FAULT_SIZE, UNKNOWNS, ObjectEvidence
from calib.guarding.memory import Slice
from edge.common.arrays import Array
from edge.common.units import NS

DRIFTS_PER_S: Final = 0.3  # of its offset a box drifts a second: an object that turns shows another end
JUMPS: Final = 1.0  # of its offset a box may jump by at any instant: a detector goes over to another end
STRETCH_NS: Final = 3_000_000_000  # of flight, in which that drift is as good as straight
NEVER_NS: Final = 2**63 - 1  # of UTC: no slice is from after it
COURSES: Final = 2  # of an offset within a stretch: that it is there, that it drifts


@dataclass(frozen=True)
class Sums:
    """Normal equations of pose and clock of all cameras and of changes since an instant, boxes' offsets taken out.

    normal: (7 C, 7 C) of errors that always were; change: the same of changes, cross: (7 C, 7 C) of both, rows errors.
    right, right_change: (7 C,). squares: the sum of squares they can explain, of so many degrees of freedom.
    """

    normal: Array
    cross: Array
    change: Array
    right: Array
    right_change: Array
    squares: float
    freedom: int


@dataclass(frozen=True)
class _Dated:
    """One object's evidence of a slice that ended then, seconds from its stretch's middle."""

    t_unix_ns: int
    t_s: float
    found: ObjectEvidence


@dataclass(frozen=True)
class _Stretch:
    """An object's evidence of a stretch. whole: of all unknowns of `seen_by`, as if it were from after a change."""

    rows: list[_Dated]
    seen_by: NDArray[np.intp]
    whole: Sums


class Remembered:
    """All slices of some time, by object and stretch, to be asked what changed at an instant."""

    def __init__(self, slices: Sequence[Slice], cameras: int) -> None:
        self._cameras = cameras
        self._dated = _dated(slices)
        self._objects: defaultdict[int, list[_Stretch]] = defaultdict(list)

    def prepare(self) -> Iterator[None]:
        """Work out what does not depend on the instant, a stretch at a time, for the loop's sake."""
        for (number, _), rows in self._dated.items():
            self._objects[number].append(_Stretch(rows, *_without_offsets([], rows)))
            yield

    def until(self, t_unix_ns: int) -> Sums:
        """Of errors that always were, by what ended then or before."""
        return self.since(NEVER_NS, NEVER_NS - t_unix_ns)

    def since(self, t_unix_ns: int, apart_ns: int) -> Sums:
        """Of changes at an instant. What ended less than apart_ns before is nobody's witness: it is of both times."""
        total = _nothing(self._cameras * FAULT_SIZE)
        every = np.arange(self._cameras * FAULT_SIZE)
        for stretches in self._objects.values():
            total = _plus(total, every, self._of_object(stretches, t_unix_ns, apart_ns))
        return total

    def _of_object(self, stretches: Sequence[_Stretch], t_unix_ns: int, apart_ns: int) -> Sums:
        """Of pose and clock, by one object."""
        total = _nothing(self._cameras * UNKNOWNS)
        lasting, jumped = np.ones(self._cameras), False
        for stretch in stretches:
            before = [one for one in stretch.rows if one.t_unix_ns <= t_unix_ns - apart_ns]
            after = [one for one in stretch.rows if one.t_unix_ns > t_unix_ns]
            if not before and not after:
                continue
            seen_by, one = stretch.seen_by, stretch.whole
            if len(before) == len(stretch.rows):
                one = _unchanged(one)
            elif len(after) < len(stretch.rows):
                seen_by, one = _without_offsets(before, after)
            total = _plus(total, (seen_by[:, None] * UNKNOWNS + np.arange(UNKNOWNS)).ravel(), one)
            jumped |= bool(before)
            for dated in stretch.rows:
                lasting[dated.found.cameras] = dated.found.lasting_px
        return _without_jump(total, lasting if jumped else None)


def summed(slices: Sequence[Slice], cameras: int) -> Sums:
    """Of errors that were always there, by all slices."""
    remembered = Remembered(slices, cameras)
    for _ in remembered.prepare():
        pass
    return remembered.since(0, 0)


def _dated(slices: Sequence[Slice]) -> dict[tuple[int, int], list[_Dated]]:
    """Each object's evidence of each stretch."""
    found: defaultdict[tuple[int, int], list[_Dated]] = defaultdict(list)
    for one in slices:
        ago_ns = slices[-1].t_unix_ns - one.t_unix_ns
        t_s = (STRETCH_NS // 2 - ago_ns % STRETCH_NS) / NS
        for number, of_object in one.objects:
            found[number, ago_ns // STRETCH_NS].append(_Dated(one.t_unix_ns, t_s, of_object))
    return found


def _nothing(size: int) -> Sums:
    return Sums(
        np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), np.zeros(size), 0.0, 0
    )


def _plus(total: Sums, at: NDArray[np.intp], one: Sums) -> Sums:
    """Add what one says of the unknowns `at`, in place as far as arrays go."""
    block = np.ix_(at, at)
    total.normal[block] += one.normal
    total.cross[block] += one.cross
    total.change[block] += one.change
    total.right[at] += one.right
    total.right_change[at] += one.right_change
    return replace(total, squares=total.squares + one.squares, freedom=total.freedom + one.freedom)


def _unchanged(one: Sums) -> Sums:
    """The same, from before a change: it says nothing of it."""
    nothing = np.zeros_like(one.normal)
    return replace(one, cross=nothing, change=nothing, right_change=np.zeros_like(one.right))


def _without_jump(total: Sums, lasting_px: Array | None) -> Sums:
    """An object's sums of pose and clock, the jump of its boxes eliminated if they may have jumped."""
    unknowns = np.arange(len(total.right)).reshape(-1, UNKNOWNS)
    kept, gone = unknowns[:, :FAULT_SIZE].ravel(), unknowns[:, FAULT_SIZE:].ravel()
    block = np.ix_(kept, kept)
    plain = Sums(
        total.normal[block],
        total.cross[block],
        total.change[block],
        total.right[kept],
        total.right_change[kept],
        total.squares,
        total.freedom,
    )
    if lasting_px is None:
        return plain
    inner = total.change[np.ix_(gone, gone)] + np.diag(np.repeat(lasting_px * JUMPS, 2) ** -2.0)
    always, change, right = total.cross[np.ix_(kept, gone)], total.change[np.ix_(kept, gone)], total.right_change[gone]
    solved = np.linalg.solve(inner, np.column_stack([always.T, change.T, right]))
    size = len(kept)
    return Sums(
        plain.normal - always @ solved[:, :size],
        plain.cross - always @ solved[:, size:-1],
        plain.change - change @ solved[:, size:-1],
        plain.right - always @ solved[:, -1],
        plain.right_change - change @ solved[:, -1],
        plain.squares - float(right @ solved[:, -1]),
        plain.freedom,
    )


def _without_offsets(before: Sequence[_Dated], after: Sequence[_Dated]) -> tuple[NDArray[np.intp], Sums]:
    """The cameras (C,) that saw a stretch and its sums of their 9 C unknowns, the stretch's own offsets and how they
    drift eliminated, each with its prior.
    """
    stretch = [*before, *after]
    seen_by = np.unique(np.concatenate([one.found.cameras for one in stretch]))
    normals, rights, lasting = _stacked(stretch, seen_by)
    size, count, gone = len(seen_by) * UNKNOWNS, 2 * len(seen_by), slice(FAULT_SIZE, UNKNOWNS)
    courses = np.column_stack([np.ones(len(stretch)), [one.t_s for one in stretch]])
    both = np.column_stack([courses[:, 0], np.repeat([0.0, 1.0], [len(before), len(after)])])  # always, and changed
    inner = _weighed(courses, courses, normals[:, :, gone][..., gone].reshape(-1, count, count))
    sigma = np.repeat(lasting, 2)
    diagonal = np.arange(COURSES * count)
    inner[diagonal, diagonal] += np.concatenate([sigma, sigma * DRIFTS_PER_S]) ** -2.0
    coupled = _weighed(courses, both, normals[:, :, gone].reshape(-1, count, size))
    pulled = (courses.T @ rights[:, :, gone].reshape(-1, count)).ravel()
    solved = np.linalg.solve(inner, np.column_stack([coupled, pulled]))
    left = _weighed(both, both, normals.reshape(-1, size, size)) - coupled.T @ solved[:, :-1]
    right = (both.T @ rights.reshape(-1, size)).ravel() - coupled.T @ solved[:, -1]
    return seen_by, Sums(
        left[:size, :size],
        left[:size, size:],
        left[size:, size:],
        right[:size],
        right[size:],
        sum(one.found.squares for one in stretch) - float(pulled @ solved[:, -1]),
        sum(one.found.freedom for one in stretch),
    )


def _stacked(stretch: Sequence[_Dated], seen_by: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Normal matrices (K, C, 9, C, 9), right sides (K, C, 9) and lasting_px (C,) of the cameras that saw any of it."""
    shape = (len(seen_by), UNKNOWNS)
    normals, rights = np.zeros((len(stretch), *shape, *shape)), np.zeros((len(stretch), *shape))
    lasting = np.ones(len(seen_by))
    for k, one in enumerate(stretch):
        at = np.searchsorted(seen_by, one.found.cameras)
        normals[k, at[:, None], :, at[None], :] = one.found.normal.transpose(0, 2, 1, 3)
        rights[k, at] = one.found.right
        lasting[at] = one.found.lasting_px
    return normals, rights, lasting


def _weighed(rows: Array, columns: Array, blocks: Array) -> Array:
    """(P I, Q J): blocks (K, I, J) added up, with each pair of weights of rows (K, P) and columns (K, Q)."""
    count, height, width = blocks.shape
    weights = (rows[:, :, None] * columns[:, None]).reshape(count, -1)
    total = (weights.T @ blocks.reshape(count, -1)).reshape(rows.shape[1], columns.shape[1], height, width)
    return total.transpose(0, 2, 1, 3).reshape(rows.shape[1] * height, -1)

"""Which sequence numbers of which camera this station has, and so which it lacks. Pure: messages are handed in.

A box numbers its Tracks messages within one run of its program, its epoch. A number above the last one received is not
yet missing: it may be on its way. So a number counts as lacking only once the box itself announces it, and did so
already one inventory earlier.
"""

from collections.abc import Iterable
from typing import Final, NamedTuple

import msgspec

from calib.station.core.ranges import Ranges
from edge.messages import SpooledEpoch

MAX_EPOCHS: Final = 256  # remembered of one camera; a box that restarts every ten minutes for two days


class Gap(NamedTuple):
    """Sequence numbers first to last of one epoch that the box has and the station has not."""

    epoch: int
    first_seq: int
    last_seq: int

    def __len__(self) -> int:
        return self.last_seq - self.first_seq + 1


class _Saved(msgspec.Struct):
    cameras: dict[str, dict[str, list[tuple[int, int]]]]


class Ledger:
    """What the station has of every camera, live or late."""

    def __init__(self) -> None:
        self._have: dict[str, dict[int, Ranges]] = {}
        self._announced: dict[str, dict[int, int]] = {}  # camera, epoch: the last number of the inventory before

    def have(self, camera: str, epoch: int, first_seq: int, last_seq: int) -> None:
        """The station has these numbers, or knows them gone for good: never ask for them again."""
        epochs = self._have.setdefault(camera, {})
        if epoch not in epochs:
            while len(epochs) >= MAX_EPOCHS:
                del epochs[next(iter(epochs))]
            epochs[epoch] = Ranges()
        epochs[epoch].add(first_seq, last_seq)

    def gaps(self, camera: str, inventory: Iterable[SpooledEpoch]) -> list[Gap]:
        """What this camera's box has and the station lacks, newest epoch first. inventory: oldest epoch first."""
        announced = self._announced.get(camera, {})
        inventory = list(inventory)
        self._announced[camera] = {kept.epoch: kept.last_seq for kept in inventory}
        return [
            Gap(kept.epoch, first, last)
            for kept in reversed(inventory)
            for first, last in self._ranges(camera, kept.epoch).missing(
                kept.first_seq, min(kept.last_seq, announced.get(kept.epoch, -1))
            )
        ]

    def _ranges(self, camera: str, epoch: int) -> Ranges:
        return self._have.get(camera, {}).get(epoch, Ranges())

    def to_json(self) -> bytes:
        """All of it, to be read by `from_json` after a restart."""
        cameras = {
            camera: {str(epoch): list(ranges) for epoch, ranges in epochs.items()}
            for camera, epochs in self._have.items()
        }
        return msgspec.json.encode(_Saved(cameras))

    @classmethod
    def from_json(cls, saved: bytes) -> "Ledger":
        """A ledger that was saved. Raises msgspec.MsgspecError or ValueError if it is not one."""
        ledger = cls()
        for camera, epochs in msgspec.json.decode(saved, type=_Saved).cameras.items():
            ledger._have[camera] = {int(epoch): Ranges(ranges) for epoch, ranges in epochs.items()}
        return ledger

"""One station, one state folder: a lock that ends with its process, however that ends.

The hazard is the second start: by hand beside the service, or from a copied configuration. Both would count starts and
tracks from one file and write over each other's calibration. The kernel lets go of an flock when its process is gone,
so that a station that was killed keeps nobody out; the number in the file is for the sentence only.
"""

import fcntl
import logging
import os
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from edge.common.errors import SkyfixError

log = logging.getLogger(__name__)

LOCK: Final = "lock"
PID_BYTES: Final = 32  # of the file: more is no number of a process


class StateLock:
    """Holds a state folder. Entering raises SkyfixError if another process holds it."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:  # a disk that cannot be written is a fault of its own, and no reason not to track
            log.warning("%s: cannot be locked (%s); start no second station on this folder", self._path, error)
            return self
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.pread(descriptor, PID_BYTES, 0).decode("ascii", "replace").strip()
            os.close(descriptor)
            raise SkyfixError(
                f"another station uses this state folder (process {holder or 'unknown'})",
                where=str(self._path.parent),
                action="end that one, or give this one a state_folder of its own",
            ) from error
        except OSError as error:  # a network's file system that has no locks
            log.warning("%s: cannot be locked (%s); start no second station on this folder", self._path, error)
            os.close(descriptor)
            return self
        self._descriptor = descriptor
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        except OSError as error:  # a full disk: it is locked all the same
            log.warning("%s: the process's number cannot be written (%s)", self._path, error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

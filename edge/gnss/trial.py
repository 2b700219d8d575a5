"""A receiver tried as it will be used: read until it is clear how it is, and how that ends.

The hazard is the first impression. A tenth of a second after opening, a healthy receiver, one without corrections, a
silent one and noise all look the same: no position yet. So each verdict waits for what would tell it apart: a fix for
the epochs that make one, silence for seconds of it, noise for as long as a sentence would take, a solution that is not
fixed for whether it stays so.
"""

import time
from collections.abc import Callable
from typing import Final

from edge.gnss.diagnosis import ReceiverState, ReceiverStatus
from edge.gnss.receiver import Receiver

TRIAL_S: Final = 25.0  # a fix takes nine seconds at 1 Hz, every usual rate is tried in eighteen
UNFIXED_S: Final = 5.0  # so long a receiver may be without a fix before that is what is said of it
FINAL: Final = frozenset(
    {ReceiverState.ABSENT, ReceiverState.DENIED, ReceiverState.BUSY, ReceiverState.REFUSED, ReceiverState.LOST,
     ReceiverState.ENDED}
)  # fmt: skip  # what the port itself says needs no patience
TRYING_RATES: Final = frozenset({ReceiverState.SILENT, ReceiverState.UNREADABLE})

Telling = Callable[[str], None]  # told what is waited for, and how it stands


def silent(_: str) -> None:
    """Nobody watches."""


def try_receiver(receiver: Receiver, progress: Telling = silent) -> ReceiverStatus:
    """Start a receiver, read it until its state is clear, and close it."""
    began_s, unfixed_since_s = time.monotonic(), None
    status = receiver.status()
    with receiver:
        while (now_s := time.monotonic()) < began_s + TRIAL_S:
            receiver.wait(0.5)
            status = receiver.status()
            progress(f"gnss: {now_s - began_s:.0f} of at most {TRIAL_S:.0f} s: {status.state}: {status.reason}")
            unfixed = status.state is ReceiverState.NO_FIX
            unfixed_since_s = (unfixed_since_s or now_s) if unfixed else None
            if _clear(receiver, status) or (unfixed_since_s and now_s - unfixed_since_s > UNFIXED_S):
                break
    return status


def _clear(receiver: Receiver, status: ReceiverStatus) -> bool:
    if status.state in TRYING_RATES:
        return not receiver.tries_rates
    doubted = status.state is ReceiverState.DOUBTED and status.level == "fail"
    return receiver.fix() is not None or doubted or status.state in FINAL

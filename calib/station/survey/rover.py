"""A rover on a tripod: occupy, watch sigma fall, fix anew, occupy again, and take it or leave it.

The hazard is a re-initialisation that never was: the operator presses a key, the receiver has kept its (false)
ambiguities all along, and two occupations agree about the wrong place. So the second occupation does not begin before
the receiver has been seen to lose its fix.
"""

import math
from collections.abc import Callable
from typing import Final

from calib.errors import CalibrationError
from calib.station.inputs.input import PositionInput
from calib.station.survey.store import AntennaTable, OccupationTable
from edge.gnss.diagnosis import ReceiverState
from edge.gnss.gates import Reason
from edge.gnss.session import Surveyed, t_unix_ns

NEWS_S: Final = 1.0  # the receiver publishes twice a second; without news the line is drawn again
PATIENCE_S: Final = 600.0  # for a fix to come, or to be lost: longer and something is wrong
HOPELESS: Final = frozenset(
    {ReceiverState.ENDED, ReceiverState.DENIED, ReceiverState.BUSY}
)  # states that waiting does not mend

Progress = Callable[[str], None]  # draws the line that an operator watches


def occupy(
    receiver: PositionInput, seconds: float, antenna: AntennaTable, *, unix_ns: Callable[[], int], progress: Progress
) -> OccupationTable:
    """One occupation of at least `seconds` of accepted epochs.

    Raises CalibrationError, naming the receiver's reason, if none can be had.
    """
    receiver.restart()
    waited_s = 0.0
    while waited_s < PATIENCE_S + seconds:
        if not receiver.wait(NEWS_S):
            waited_s += NEWS_S
        surveyed, status = receiver.surveyed(), receiver.status()
        progress(progress_line(surveyed, seconds, f"{status.state}: {status.reason}"))
        if surveyed and not surveyed.mean.fault and surveyed.mean.duration_s >= seconds:
            return occupation_of(surveyed, antenna, unix_ns())
        if surveyed and surveyed.mean.fault and not surveyed.mean.young:
            raise _refused(surveyed.mean.fault, "keep the antenna still, re-initialise the receiver, occupy again")
        if status.state in HOPELESS or not status.mends:
            raise _refused(status.reason, status.action)
    raise _refused(receiver.status().reason, receiver.status().action)


def wait_for_lost_fix(receiver: PositionInput, progress: Progress) -> None:
    """Return when the receiver has been seen without a fix. Raises CalibrationError if it keeps it."""
    before = _unfixed(receiver)
    waited_s = 0.0
    while waited_s < PATIENCE_S:
        if not receiver.wait(NEWS_S):
            waited_s += NEWS_S
        if _unfixed(receiver) > before:
            return
        progress("break the corrections or cover the antenna until the fix is lost ...")
    raise _refused("the receiver kept its fix", "break the corrections for a minute, or restart the receiver")


def progress_line(surveyed: Surveyed | None, seconds: float, otherwise: str) -> str:
    """What an operator watches: how long, how many, how good."""
    if surveyed is None:
        return otherwise
    mean = surveyed.mean
    horizontal_mm = math.hypot(*mean.sigma_m[:2]) * 1000
    line = (
        f"{min(mean.duration_s, seconds):4.0f} of {seconds:.0f} s, {mean.samples} epochs, {mean.clipped} clipped, "
        f"sigma {horizontal_mm:.0f} mm horizontal, {mean.sigma_m[2] * 1000:.0f} mm vertical"
    )
    return f"{line}; {'; '.join(mean.warnings)}" if mean.warnings else line


def occupation_of(surveyed: Surveyed, antenna: AntennaTable, host_unix_ns: int) -> OccupationTable:
    """The session as the survey file keeps it."""
    mean = surveyed.mean
    return OccupationTable(
        t_unix_ns=t_unix_ns(surveyed.latest, host_unix_ns),
        duration_s=round(mean.duration_s, 3),
        samples=mean.samples,
        position=(surveyed.lat_deg, surveyed.lon_deg, surveyed.height_m),
        scatter_m=_three(mean.scatter_m.tolist()),
        floor_m=_three(mean.floor_m.tolist()),
        fixed_m=_three(mean.fixed_m.tolist()),
        antenna=antenna,
    )


def _three(values: list[float]) -> tuple[float, float, float]:
    east, north, up = (round(value, 6) for value in values)
    return east, north, up


def _unfixed(receiver: PositionInput) -> int:
    return receiver.status().counters.get(f"refused: {Reason.QUALITY}", 0)


def _refused(reason: str, action: str) -> CalibrationError:
    return CalibrationError(reason, where="rover", action=action)

"""What is asked of the station from outside: by a command on an output, or by the operator at the page.

The hazard is an order that means one thing here and another there. So both ways end in the same few lines, and what
can't be done now is answered so, not kept for later.
"""

import logging

from calib.station.archive.station_recording import StationRecording
from calib.station.core.station import Station
from calib.station.page.wire import OperatorCommand
from calib.station.worker import Worker

log = logging.getLogger(__name__)


class Orders:
    """Does what is asked, where it can be done."""

    def __init__(self, station: Station, worker: Worker, recording: StationRecording) -> None:
        self._station, self._worker, self._recording = station, worker, recording

    def command(self, wanted: str) -> bool:
        """An output's command, "calibrate"; whether it can be done now."""
        if wanted != "calibrate" or self._worker.busy:
            return False
        self._station.calibration.ask()
        return True

    def obey(self, command: OperatorCommand) -> None:
        """The operator's."""
        log.info("the operator: %s %s", command.do, command.camera)
        if command.do == "calibrate":
            self.command("calibrate")
        elif command.do in ("record", "stop"):
            self._recording.switch(command.do == "record")
        elif command.camera in self._station.intake.cameras:
            muted = self._station.muted
            (muted.add if command.do == "mute" else muted.discard)(command.camera)

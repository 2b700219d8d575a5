"""Asking the station that runs on this machine how it is, over its own /status.json.

The hazard is a check that fights a healthy station for its ports and calls it a fault: whoever finds a port taken asks
here first who holds it.
"""

import http.client
from pathlib import Path
from typing import Final

import msgspec

from calib.station.config import BaseConfig
from calib.station.status.access import read_token
from calib.station.status.https import asking, https_of
from calib.station.status.status import EndpointStatus
from edge.common.errors import ConfigError
from edge.link.ports import EVERYWHERE, LOOPBACK
from edge.link.settings import TlsSettings

ANSWERS_WITHIN_S: Final = 10.0  # the page's process may have to be started for the answer


class RunningFinding(msgspec.Struct, frozen=True, kw_only=True):
    """One finding of its health. level: a word of its version's, which may be a later one."""

    name: str
    level: str
    reason: str
    action: str = ""


class RunningHealth(msgspec.Struct, frozen=True, kw_only=True):
    """Its findings."""

    items: list[RunningFinding] = []


class RunningCamera(msgspec.Struct, frozen=True, kw_only=True):
    """One of its cameras, and what that one's box says of its receiver."""

    id: str
    receiver: RunningFinding | None = None


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """What of a running station's status is asked for; the rest is not read."""

    site: str
    version: str
    phase: str
    reason: str
    action: str = ""
    endpoints: list[EndpointStatus]
    health: RunningHealth = RunningHealth()
    cameras: list[RunningCamera] = []


def running_station(config: BaseConfig, folder: Path) -> Running | None:
    """The station that answers at this configuration's status port; None if none does, or nobody who is one."""
    status = config.status
    if not status.port:
        return None
    try:
        connection = _connection(LOOPBACK if status.host in EVERYWHERE else status.host, status.port, https_of(config))
    except OSError:  # of an authority that cannot be read
        return None
    try:
        token = read_token(folder / status.token_file) if status.token_file else ""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        connection.request("GET", "/status.json", headers=headers)
        return msgspec.json.decode(connection.getresponse().read(), type=Running)
    except (OSError, http.client.HTTPException, msgspec.MsgspecError, ConfigError):
        return None
    finally:
        connection.close()


def _connection(host: str, port: int, tls: TlsSettings | None) -> http.client.HTTPConnection:
    if tls is None:
        return http.client.HTTPConnection(host, port, timeout=ANSWERS_WITHIN_S)
    return http.client.HTTPSConnection(host, port, timeout=ANSWERS_WITHIN_S, context=asking(tls))

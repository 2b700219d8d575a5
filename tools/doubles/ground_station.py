"""What QGroundControl says to a vehicle that it meets, remade from its source (master of 2024 and 2025; not run).

It takes what beats as autopilot, component 1, for the vehicle, and asks that for versions, modes and component
metadata, all of the system for parameters, and it for mission, fence and rally points. And whatever else beats under
the vehicle's system id is asked whether it is a camera (by two commands in turn, again with each beat, 10 times) or a
gimbal's manager (6 times).
"""

from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import common

SYSTEM, COMPONENT = 255, 190  # MAV_COMP_ID_MISSIONPLANNER: QGroundControl's too
CAMERA_TRIES, GIMBAL_TRIES = 10, 6
COMPONENT_INFORMATION, COMPONENT_METADATA, AVAILABLE_MODES = 395, 397, 435
ASKED_OF_AUTOPILOT: Final = (148, COMPONENT_METADATA, COMPONENT_INFORMATION, AVAILABLE_MODES)


def _command(number: int, system: int, component: int, asked: int = 0) -> common.MAVLink_command_long_message:
    return common.MAVLink_command_long_message(system, component, number, 0, asked, 0, 0, 0, 0, 0, 0)


def connecting(system: int) -> Iterator[common.MAVLink_message]:
    """What is said to the vehicle, in order."""
    yield common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    for message in ASKED_OF_AUTOPILOT:
        yield _command(common.MAV_CMD_REQUEST_MESSAGE, system, 1, message)
    for component in (0, 1):
        yield common.MAVLink_request_data_stream_message(system, component, 0, 4, 1)
        yield common.MAVLink_param_request_list_message(system, component)
    for kind in (0, 1, 2):  # mission, fence, rally points
        yield common.MAVLink_mission_request_list_message(system, 1, kind)
    yield _command(common.MAV_CMD_SET_MESSAGE_INTERVAL, system, 1, 30)


def asking(system: int, component: int) -> Iterator[common.MAVLink_message]:
    """What another component is asked that beats."""
    for turn in range(CAMERA_TRIES):
        if turn % 2:
            yield _command(common.MAV_CMD_REQUEST_CAMERA_INFORMATION, system, component, 1)
        else:
            yield _command(common.MAV_CMD_REQUEST_MESSAGE, system, component, common.MAVLINK_MSG_ID_CAMERA_INFORMATION)
    for _ in range(GIMBAL_TRIES):
        asked = common.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
        yield _command(common.MAV_CMD_REQUEST_MESSAGE, system, component, asked)

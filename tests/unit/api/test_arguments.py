"""Invalid arguments: one clear error before any byte is sent and any port is opened."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import bridge
from bridge.api.remote import RemoteRobot
from bridge.api.robot import Robot
from bridge.errors import ArgumentError, BridgeError, PortError

HUGE = 10**400
NOBODY = "/nowhere/at/all"


@pytest.mark.parametrize(
    ("call", "arguments", "problem"),
    [
        ("reboot", {"factory_reset": "no"}, "factory_reset = 'no': must be True or False"),
        ("reboot", {"factory_reset": 1}, "factory_reset = 1: must be True or False"),
        ("enable", {"clear_stop": "no"}, "clear_stop = 'no': must be True or False"),
        ("get_parameter", {"name": None}, "name = None: must be a parameter's name or number"),
        ("get_parameter", {"name": True}, "name = True: must be a parameter's name or number"),
        ("set_parameter", {"name": [], "value": 1}, "name = []: must be a parameter's name"),
        ("set_parameter", {"name": "x", "value": None}, "value = None: must be a number, a"),
        ("stream_rate", {"stream": 3, "rate_hz": 1}, "stream = 3: must be a text"),
        ("stream_rate", {"stream": "imu", "rate_hz": "1"}, "rate_hz = '1': must be a number"),
        ("set_key", {"key": "0" * 16}, "key: must be 16 bytes that are not all 0, or None"),
        ("set_key", {"key": bytes(16)}, "key: must be 16 bytes that are not all 0, or None"),
        ("drive", {"v_m_s": math.nan, "yaw_rate_rad_s": 0}, "v_m_s = nan: must be a finite"),
        ("drive", {"v_m_s": 0, "yaw_rate_rad_s": HUGE}, "yaw_rate_rad_s = (an integer of 1329 b"),
        ("record", {"path": None}, "path = None: must be a path"),
        ("record", {"path": "a.mcap", "room": "case-1"}, "room = 'case-1': must be a FloorPlan"),
        ("record", {"path": "a.mcap", "force": "no"}, "force = 'no': must be True or False"),
        ("wait_for_status", {"timeout_s": math.inf}, "timeout_s = inf: must be a number of sec"),
        ("wait_for_link", {"timeout_s": -1}, "timeout_s = -1: must be a number of seconds, 0"),
    ],
)
def test_the_error_names_the_value_and_the_valid_ones(
    call: str, arguments: dict[str, Any], problem: str
) -> None:
    robot = Robot.__new__(Robot)  # no device is contacted
    with pytest.raises(ArgumentError) as caught:
        getattr(robot, call)(**arguments)
    assert str(caught.value).startswith(problem)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"port": None}, "port = None: must be a text"),
        ({"node": HUGE}, "node = (an integer of 1329 bits): must be an integer from 1 to 15"),
        ({"node": "1"}, "node = '1': must be an integer from 1 to 15, or None"),
        ({"baud": 0}, "baud = 0: must be an integer from 1 to"),
        ({"bitrate": 5e5}, "bitrate = 500000.0: must be an integer from 1 to"),
        ({"dtr": "off"}, "dtr = 'off': must be True or False"),
        ({"model": "robot.toml"}, "model = 'robot.toml': must be a RobotModel, or None"),
        ({"sink": Path("a.mcap")}, "sink = PosixPath('a.mcap'): must be an object with write"),
        ({"key": b"short"}, "key: must be 16 bytes"),
        ({"timeout_s": None}, "timeout_s = None: must be a number of seconds, 0 or more"),
    ],
)
def test_nothing_is_opened(options: dict[str, Any], problem: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        bridge.open(**{"port": NOBODY} | options)
    assert str(caught.value).startswith(problem)


def test_a_valid_request_reaches_the_port() -> None:
    with pytest.raises(PortError):
        bridge.open(NOBODY, node=15, baud=115_200, key=bytes(range(16)), timeout_s=0)


def test_an_owner_is_not_asked_either() -> None:
    with pytest.raises(ArgumentError, match="factory_reset = 'no'"):
        RemoteRobot(NOBODY).reboot(factory_reset="no")  # type: ignore[arg-type]


def test_it_is_an_error_of_both_kinds() -> None:
    assert issubclass(ArgumentError, BridgeError)
    assert issubclass(ArgumentError, ValueError)
    assert ArgumentError.exit_status == 2

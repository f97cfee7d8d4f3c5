"""Your own controller, tested against the virtual sweeper; see docs/ci.md."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

import bridge
from bridge.errors import StoppedForSafetyError

if TYPE_CHECKING:
    from bridge.api.robot import Robot
    from tools.virtual.simulated_sweeper import SimulatedSweeper


def go_to(x_m: float, y_m: float, robot: SimulatedSweeper | Robot) -> tuple[float, float]:
    """The controller: turn towards a point, and drive there; speed (m/s) and yaw rate (rad/s)."""
    pose = robot.pose
    dx, dy = x_m - pose.x_m, y_m - pose.y_m
    bearing = math.remainder(math.atan2(dy, dx) - pose.theta_rad, math.tau)
    speed = min(0.2, math.hypot(dx, dy)) * max(0.0, math.cos(bearing))
    return speed, 1.5 * bearing


@pytest.mark.sweeper(room="empty", noise="typical", seed=3, record=True)
def test_it_arrives(sweeper: SimulatedSweeper) -> None:
    sweeper.enable()
    target = (1.5, 1.2)

    def near() -> bool:
        return math.dist(sweeper.truth.pose[:2], target) < 0.03

    assert sweeper.follow(lambda robot: go_to(*target, robot), 30.0, until=near)
    assert sweeper.truth.collisions == 0
    assert sweeper.pose_error_m < 0.02


@pytest.mark.sweeper(room="empty", noise="none")
def test_a_wheel_that_jams_is_noticed(sweeper: SimulatedSweeper) -> None:
    sweeper.enable()
    sweeper.fault("wheel-stuck:side=left")
    sweeper.drive(0.1, 0.0, for_s=2.0)
    assert sweeper.truth.path_m < 0.15
    assert abs(sweeper.truth.heading_rad) > 0.1


@pytest.mark.sweeper(room="empty", noise="none")
def test_a_stalled_motor_stops_the_robot(sweeper: SimulatedSweeper) -> None:
    sweeper.enable()
    sweeper.fault("wheel-stuck:side=left")
    with pytest.raises(StoppedForSafetyError, match="hardware, motor_stall"):
        sweeper.drive(0.15, 0.0, for_s=6.0)
    assert sweeper.stop_cause.name == "HARDWARE"


@pytest.mark.sweeper(room="empty", noise="none")
def test_a_program_of_mine_talks_to_it(sweeper_port: str) -> None:
    """The same in real time, over a port, as your own program would open it."""
    with bridge.open(sweeper_port) as robot:
        robot.enable()
        robot.drive(0.1, 0.0)

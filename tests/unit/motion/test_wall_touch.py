"""Contact with the followed wall: lateral slip that the wheels do not measure."""

from __future__ import annotations

import math

import pytest

from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.wall_follow import FollowState, Side, WallFollower
from bridge.motion.estimation.wall_track import WallTrack
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.kinematic_world import STEP_S
from support.observed import AT_REST

MODEL = RobotModel()
RADIUS_M = MODEL.radius_m


def test_contact_implies_lateral_slip() -> None:
    """A robot pressed against the wall, heading 3° into it, keeps a constant distance.

    The estimated direction must stay at 3°.
    """
    track = WallTrack(MODEL.infrared_left)
    heading = math.radians(3.0)
    reads = RADIUS_M - MODEL.infrared_left.y_m
    track.begin(reads, heading, math.radians(0.2))
    for _ in range(100):
        track.move(0.01, 0.0, RADIUS_M)
        touching = (RADIUS_M - MODEL.infrared_left.x_m * math.sin(heading)) / math.cos(heading)
        assert track.take(touching - MODEL.infrared_left.y_m, 4.0, 0.02)
    assert track.yaw_rad == pytest.approx(heading, abs=math.radians(0.7))
    assert track.distance_m == pytest.approx(RADIUS_M, abs=0.0015)


@pytest.mark.parametrize("start_gap_m", [0.02, 0.06, 0.14])
def test_a_robot_that_comes_to_a_wall_grazes_it_without_pressing(start_gap_m: float) -> None:
    """Integrator wind-up must not keep the heading of the robot pointed into the wall.

    With a heading 2° into a wall at its side, where no bumper is, the robot slips 3.5 cm per metre
    sideways, and its wheels do not measure it. Here the readings have a
    resolution of 1.25 mm, and the simulated wall stops the motion towards it.
    """
    mount = MODEL.infrared_left
    follower = WallFollower(MODEL, Side.LEFT, 0.0005)
    distance, yaw, reported = RADIUS_M + start_gap_m, 0.0, Pose2(0.0, 0.0, 0.0)
    free = AT_REST._replace(pose=reported, v_m_s=0.2)
    smooth = VelocitySmoother(MODEL.max_yaw_accel_rad_s2, 0.6)
    not_made_m, along_m, range_m = 0.0, 0.0, 0.0
    for i in range(600):
        if i % 2 == 0:  # the infrared is read every second step
            true_m = (distance - mount.x_m * math.sin(yaw)) / math.cos(yaw) - mount.y_m
            range_m = 0.00125 * round(true_m / 0.00125)
        seen = free._replace(time_s=i * STEP_S, pose=reported, infrared_left_m=range_m)
        step = follower.step(seen, STEP_S)
        v, w = step.command
        yaw += smooth.update(w, STEP_S) * STEP_S
        x_m, y_m = v * math.cos(yaw) * STEP_S, v * math.sin(yaw) * STEP_S
        reported = Pose2(reported.x_m + x_m, reported.y_m + y_m, yaw)
        not_made_m += max(RADIUS_M - (distance - y_m), 0.0)
        distance = max(distance - y_m, RADIUS_M)
        along_m += x_m if distance < RADIUS_M + 0.001 else 0.0
    assert step.state is FollowState.FOLLOWING
    assert along_m > 1.5, "the robot grazes the wall over 1.5 m"
    assert not_made_m < 0.005 * along_m

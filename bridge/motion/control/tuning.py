"""Gains and thresholds of the leg executor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bridge.motion.control.wall_follow import FollowTuning

FOLLOW_TUNING = FollowTuning(stop_gap_m=0.008, lookahead_m=0.11, round_rad=math.radians(420.0))
"""Tuning of wall following. The robot does not sweep the floor beyond its stopping point, so it
drives into inner corners. A table leg is too thin for the infrared beam, so the robot follows it
all around."""


@dataclass(frozen=True, slots=True)
class MotionTuning:
    """Gains and thresholds of the executor; lengths are in m, angles in rad."""

    brake_share: float = 0.75
    """Share of the acceleration limit in braking distances. The rest is a reserve for control."""
    lag_s: float = 0.10
    """Time from a command to the wheels' response, s: link, smoothing, motor."""
    creep_m_s: float = 0.025
    """Minimum approach speed, m/s. A contact at this speed is no collision (< 0.03 m/s)."""
    lookahead_m: float = 0.25
    """Distance from the robot to the point on the lane's line to which lane keeping steers, m."""
    turn_rate_share: float = 0.75
    """Share of the yaw rate limit in turns that end at standstill. The rest is for control."""
    min_turn_rad_s: float = 0.10
    """Minimum yaw rate of a turn, rad/s. At a lower rate, static friction stops the wheels."""
    heading_tolerance_rad: float = 0.004
    flow_rad: float = 0.02
    """Maximum heading error at which a turn may continue into the next leg without a stop, rad. The
    next leg corrects this error."""
    flow_rate_share: float = 0.9
    """Share of the yaw rate limit in a turn that continues into the next leg."""
    flow_brake_share: float = 0.75
    """Share of the yaw acceleration limit for braking in a turn that continues into the next
    leg."""
    min_arc: float = 0.1
    """Minimum of 1 - cos e, for the remaining angle e of an arc, at which the radius is corrected.
    At a smaller angle the robot hardly moves towards the line."""
    point_tolerance_m: float = 0.006
    lowpass: float = 0.6
    """Factor k of the velocity smoothing, per 20 ms step."""
    rest_m_s: float = 0.01
    rest_rad_s: float = 0.03
    settling_s: float = 0.6
    """Maximum time from a leg's stop command to its end, s. After it the leg ends even in
    motion."""
    stall_s: float = 1.5
    stall_m: float = 0.003
    stall_rad: float = 0.02
    stands_s: float = 0.5
    """Time after which a leg ends if the robot stands while its wheels turn, s. The check for
    spinning wheels compares wheels and gyro in this time: an earlier end delays it by 4 s."""
    follow: FollowTuning = FOLLOW_TUNING
    """Gains and limits of wall following."""

"""Gains and thresholds of the leg executor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.motion.control.braking import BrakingTuning
from bridge.motion.control.hidden_ahead import HiddenAheadTuning
from bridge.motion.control.point_to_point import BEARING_GAINS, DISTANCE_GAINS
from bridge.motion.control.rotary import ROTARY_GAINS
from bridge.motion.control.wall_follow import FollowTuning
from bridge.motion.estimation.range_filter import RangeAheadTuning

if TYPE_CHECKING:
    from bridge.motion.control.pid import PidGains


@dataclass(frozen=True, slots=True)
class MotionTuning:
    """Gains and thresholds of the executor; lengths are in m, angles in rad.

    A value without another source was chosen in runs of the virtual robot at the noise levels
    ``typical`` and ``harsh``.
    """

    braking: BrakingTuning = field(default_factory=BrakingTuning)
    """Braking of lanes, of drives to a point and of wall following."""
    lookahead_m: float = 0.25
    """Distance from the robot to the point on the lane's line to which lane keeping steers, m."""
    turn_rate_share: float = 0.75
    """Share of the yaw rate limit in turns that end at standstill. The rest is for control."""
    min_turn_rad_s: float = 0.10
    """Minimum yaw rate of a turn, rad/s. At a lower rate, static friction stops the wheels."""
    turn_brake_share: float = 0.5
    """Share of the yaw acceleration limit for braking in a turn that ends at standstill."""
    heading_tolerance_rad: float = 0.004
    """Maximum heading error at the end of a turn, rad."""
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
    """Maximum distance from a point at which the robot has reached it, m."""
    point_near: float = 5.0
    """Maximum distance from a point that is behind the robot at which the robot has reached it, in
    units of ``point_tolerance_m``."""
    turn_in_place_rad: float = math.radians(45.0)
    """Bearing error of a point above which the robot turns in place, rad."""
    lowpass: float = 0.6
    """Factor k of the velocity smoothing, per 20 ms step."""
    rest_m_s: float = 0.01
    """Speed below which the robot counts as standing, m/s."""
    rest_rad_s: float = 0.03
    """Yaw rate below which the robot counts as standing, rad/s."""
    settling_s: float = 0.6
    """Maximum time from a leg's stop command to its end, s. After it the leg ends even in
    motion."""
    stall_s: float = 1.5
    """Time without progress after which a leg ends as stalled, s."""
    stall_m: float = 0.003
    """Minimum path that counts as progress, m."""
    stall_rad: float = 0.02
    """Minimum turn that counts as progress, rad."""
    stands_s: float = 0.5
    """Time after which a leg ends if the robot stands while its wheels turn, s. The check for
    spinning wheels compares wheels and gyro in this time: an earlier end delays it by 4 s."""
    rotary: PidGains = ROTARY_GAINS
    """Gains of turns and of the heading on a lane."""
    distance: PidGains = DISTANCE_GAINS
    """Gains of the distance from a point."""
    bearing: PidGains = BEARING_GAINS
    """Gains of the bearing of a point."""
    hidden: HiddenAheadTuning = field(default_factory=HiddenAheadTuning)
    """Limits of obstacles that have left the ultrasonic sensor's cone."""
    follow: FollowTuning = field(default_factory=FollowTuning)
    """Gains and limits of wall following."""
    range_ahead: RangeAheadTuning = field(default_factory=RangeAheadTuning)
    """Filter of the ultrasonic range ahead."""

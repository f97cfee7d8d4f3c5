"""Options of the recovery planner: values tuned by experiments, where possible relative to a robot.

:mod:`bridge.coverage.recovery.geometry` derives the sizes for one robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class RecoveryOptions:
    """Tuned on drawn rooms. Lengths in m, angles in rad; shares have no unit."""

    cells_per_width: float = 8.0
    """Cells of the map per width of the mouth: 2 cm for the paper's robot."""
    mouth_margin: float = 1.0 / 16.0
    """Share of its width by which each end of the mouth counts less, for the pose's uncertainty:
    1 cm for the paper's robot, and never more."""
    inflation_margin_cells: float = 0.3
    """Cells by which obstacles are inflated less than the footprint's radius: passages that the
    robot just fits through must stay open in the map."""
    infrared_trust_m: float = 0.22
    """Infrared range beyond which readings are too noisy for the map."""
    perimeter_gap_m: float = 0.0005
    """Gap between rim and wall on a perimeter pass; 5 mm cost 1-2 % of the sweepable floor. Not 0:
    a robot that presses on a wall slips sideways, which no wheel measures."""
    stop_gap_m: float = 0.008
    """Gap between rim and wall at which a lane ends."""
    margin_m: float = 0.5
    """Distance from the driven path within which floor is assumed."""
    back_off_m: float = 0.015
    """Distance of backing off after a contact."""
    cliff_back_off_m: float = 0.03
    """Distance of backing off from a cliff, repeated until there is floor ahead."""
    fresh_share: float = 0.15
    """Unswept share of the strip ahead below which a perimeter pass ends."""
    min_area: float = 0.109375
    """New floor that a lane must promise, in widths of the mouth squared: 28 cm² for 16 cm."""
    min_rate: float = 3.0 / 14.0
    """Sweep rate that a choice must promise, in sweep rates of a full lane at cruise speed."""
    ahead_patience: float = 4.0
    """Growth of the patience with small pieces, per width of the mouth that it is ahead of the
    axle. The promised sweep rate is divided by one plus this. A mouth ahead leaves a piece at each
    corner, and each piece needs a short lane."""
    near_rate: float = 3.0 / 7.0
    """Sweep rate at which a choice is taken without a wider search, in the same unit."""
    hole_rate: float = 1.0 / 70.0
    """Sweep rate that suffices for a hole into which a disc of half the mouth's width fits, in the
    same unit; slivers are left."""
    gap_m: float = 0.28
    """Length of swept floor over which a lane continues."""
    frontier: float = 0.25
    """Cost of new frontier, in widths of the mouth times its length: it prevents slivers."""
    perimeter_length_m: float = 10.0 / 7.0
    """Length of a full strip that a perimeter pass is assumed to promise."""
    retry_length_m: float = 0.625
    """Length of a full strip of new floor after which a fruitless attempt may be repeated."""
    perimeter_pace: float = 1.2
    """Speed along a straight wall, in cruise speeds. A bend is followed at cruise speed, because
    the ultrasonic cannot detect obstacles behind it."""
    lane_pace: float = 1.4
    """Speed on a lane and in transit, in cruise speeds."""
    top_share: float = 14.0 / 15.0
    """Highest share of the robot's top speed on a lane: the rest is for control."""
    turn_share: float = 1.7
    """Cost of a turn relative to the time at the highest yaw rate. With 1.24, the cost of flowing
    legs, runs are as long."""
    stop_share: float = 9.0 / 7.0
    """Cost of a stop relative to the time of braking from a lane's speed. With 1, runs are as
    long."""
    looks_m: tuple[float, ...] = (2.2, 5.2)
    """Path lengths up to which the search looks, one after another, before it looks everywhere."""
    slice_cells: int = 50_000
    """Work of a search in one control step, cells: about 2 ms. On a large floor the robot waits for
    some steps."""
    tries: int = 2
    """Fruitless attempts after which a cell is abandoned."""
    heading_fix_apart_s: float = 20.0
    """Minimum time between two heading fixes, s; it doubles after each fix without effect."""
    max_decisions: int = 4000
    """Decisions after which a plan ends."""

    # -- lanes and contact -----------------------------------------------------------------------
    obstacle_unswept: float = 0.4
    """Unswept share of the floor before an obstacle from which the obstacle's perimeter is
    followed."""
    back_off_m_s: float = 0.05
    """Speed of backing off, m/s."""
    max_backs: int = 5
    """Maximum number of times that the robot backs off from a cliff before it continues."""
    cliff_clear_m: float = 0.05
    """Further path back once there is floor ahead, m, so that no wheel turns over the cliff:
    between two sensors a cliff may be as near as the outer ones look ahead, 9 cm."""

    # -- perimeter pass --------------------------------------------------------------------------
    perimeter_stuck_m: float = 0.02
    """Path along a wall below which an attempt counts as stuck, m."""
    perimeter_max_stuck: int = 8
    """Stuck attempts in a row after which the pass ends."""
    min_away_rad: float = math.radians(12.0)
    """Minimum turn away from a contact, rad. The robot may mistake the followed wall for the
    contact once. A repeat within ``same_bump_m`` makes the turn grow with each contact."""
    same_bump_m: float = 0.06
    """Path between two contacts that are at one place, m."""
    brisk_stop_s: float = 0.5
    """Time from a brisk speed to standstill, s: a robot that was faster was not rounding a corner,
    so it did not graze that corner."""
    min_turn_rad: float = math.radians(2.0)
    """Turn below which the next leg steers instead, rad."""
    fresher: float = 0.1
    """Difference of the unswept shares that decides for the left side."""

    # -- transit ---------------------------------------------------------------------------------
    bend_rad: float = math.radians(15.0)
    """Bend of a path below which the robot steers instead of turning in place, rad."""
    slight_rad: float = math.radians(10.0)
    """Maximum planned bend that stays below ``bend_rad`` from the actual place, rad."""
    bend_m_s: float = 0.12
    """Speed through a slight bend, m/s."""
    corner_m_s: float = 0.05
    """Speed into a turn in place, m/s; the turn takes the rest out."""
    blocked_m: float = 0.03
    """Missing length from which a piece of a path was blocked, m."""
    passage_m: float = 0.4
    """Minimum path along an obstacle that blocked the robot twice, for the paper's robot, m: round
    the edge of a door and through."""

    # -- heading fix -----------------------------------------------------------------------------
    fix_uncertain_rad: float = math.radians(0.8)
    """Heading standard deviation that makes a fix due, rad: 2 m of a lane end 3 cm aside."""
    fix_helped: float = 0.75
    """Remaining share of the standard deviation at which a run along a wall helped."""
    fix_enough_rad: float = math.radians(0.6)
    """Heading standard deviation after the transit that makes the run needless, rad."""
    fix_run_m_s: float = 0.15
    """Speed along the wall, m/s: slow, for more readings."""

    # -- each observation ------------------------------------------------------------------------
    check_m: float = 0.05
    """Path between two checks whether a perimeter pass is closed, m."""
    beside_unswept: float = 0.8
    """Unswept share of the floor before a wall beside the lane above which the lane ends."""
    straight_rad_s: float = 0.3
    """Yaw rate below which wall following is straight, rad/s."""
    steady_rad_s: float = 0.1
    """Yaw rate below which the heading counts for the walls' main direction, rad/s."""
    steady_m_s: float = 0.05
    """Speed above which the heading counts for that direction, m/s."""
    on_lane_m_s: float = 0.1
    """Speed from which the robot is on its lane, m/s."""
    brake_share: float = 0.75
    """Share of the acceleration limit that planned braking uses, as the controllers do."""
    latency_s: float = 0.10
    """Time from a command to the wheels, s."""
    brisk_m_s: float = 0.15
    """Minimum speed that only straight driving reaches, m/s; it is above that of any corner."""
    closed_after_m: float = 0.25
    """Path before a perimeter pass can be closed, m: it may begin on swept floor of a lane."""

    # -- stuck policy; lengths are those of the paper's robot and grow with the robot ------------
    max_fruitless: int = 20
    """Fruitless decisions in a row after which evidence is cleared."""
    max_blocked: int = 6
    """Blocks at one place after which evidence is cleared there."""
    spared: int = 8
    """Fruitless decisions in a row below which a block far from the target does not count against
    it."""
    far_m: float = 0.4
    """Distance of such a block from the target."""
    max_cleared: int = 3
    """Times that evidence is cleared without new floor."""
    clear_radius_m: float = 0.6
    """Radius in which evidence is cleared if nothing leads anywhere."""
    blocked_radius_m: float = 0.3
    """Radius in which evidence is cleared when one place blocks. Evidence farther away does not
    block the robot there, and without it the robot would bump into known chair legs again."""
    bump_radius_m: float = 0.2
    """Radius around bumps in which targets get one more try."""
    again: int = 2
    """Blocks at one place from which the passage is closed in the map, and followed."""
    closed_m: float = 0.03
    """Radius by which each block closes the passage."""
    wall_m: float = 0.2
    """Radius in which wall cells are counted."""
    little: float = 0.3
    """Share of the promised floor below which an attempt is fruitless for its target."""

    def for_model(self, model: RobotModel) -> RecoveryOptions:
        """Return the options for a robot that may lack sensors.

        Without side infrared a wall is touched again and again, which takes longer and makes the
        pose uncertain. Then a perimeter pass promises less, and the planner gives up earlier.
        """
        if model.infrared_left.fitted or model.infrared_right.fitted:
            return self
        return replace(
            self,
            perimeter_length_m=0.3 * self.perimeter_length_m,
            max_fruitless=max(self.max_fruitless // 2, 1),
            tries=1,
        )

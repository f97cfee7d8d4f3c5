"""Options of the recovery planner: values tuned by experiments. Most are relative to the robot.

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
    """Values tuned on drawn rooms. Lengths in m, angles in rad; shares have no unit."""

    cells_per_width: float = 8.0
    """Number of map cells per width of the mouth: 2 cm for the paper's robot."""
    mouth_margin: float = 1.0 / 16.0
    """Share of the mouth's width that does not count at each end, for the pose uncertainty: 1 cm
    for the paper's robot, and never more."""
    inflation_margin_cells: float = 0.3
    """Cells by which the inflation is smaller than the footprint's radius, so that narrow passages
    stay open in the map."""
    infrared_trust_m: float = 0.22
    """Infrared range beyond which readings are too noisy for the map."""
    perimeter_gap_m: float = 0.0005
    """Gap between rim and wall on a perimeter pass. A gap of 5 mm costs 1-2 % of the sweepable
    floor. With no gap the robot presses on the wall and slips sideways, which no wheel measures."""
    stop_gap_m: float = 0.008
    """Gap between rim and wall at which a lane ends."""
    margin_m: float = 0.5
    """Distance from the driven path within which floor is assumed."""
    back_off_m: float = 0.015
    """Distance to back off after a contact."""
    cliff_back_off_m: float = 0.03
    """Distance to back off from a cliff, repeated until there is floor ahead."""
    fresh_share: float = 0.15
    """Unswept share of the strip ahead below which a perimeter pass ends."""
    min_area: float = 0.109375
    """Minimum new floor for a lane, in widths of the mouth squared: 28 cm² for 16 cm."""
    min_rate: float = 3.0 / 14.0
    """Minimum sweep rate for a choice, relative to a full lane at cruise speed."""
    ahead_patience: float = 4.0
    """Increase of the acceptance of small pieces, for each width of the mouth by which the mouth is
    ahead of the axle. The minimum sweep rate is divided by one plus this value. A mouth ahead of
    the axle leaves a piece in each corner, and each piece needs a short lane."""
    near_rate: float = 3.0 / 7.0
    """Sweep rate at which a choice is taken without a wider search, relative to a full lane."""
    hole_rate: float = 1.0 / 70.0
    """Minimum sweep rate for a hole into which a disc of half the mouth's width fits, relative to a
    full lane. Smaller pieces are left."""
    gap_m: float = 0.28
    """Maximum length of swept floor over which a lane continues."""
    frontier: float = 0.25
    """Cost of new frontier, in widths of the mouth times its length. It prevents slivers."""
    perimeter_length_m: float = 10.0 / 7.0
    """Length of a full strip that a perimeter pass is expected to sweep."""
    retry_length_m: float = 0.625
    """Length of a full strip of new floor after which a fruitless attempt may be repeated."""
    perimeter_pace: float = 1.2
    """Speed along a straight wall, relative to cruise speed. A curve is followed at cruise speed,
    because the ultrasonic sensor cannot detect obstacles behind it."""
    lane_pace: float = 1.4
    """Speed on a lane and in transit, relative to cruise speed."""
    top_share: float = 14.0 / 15.0
    """Maximum share of the robot's top speed on a lane. The rest is for control."""
    turn_share: float = 1.7
    """Cost of a turn relative to the time at the maximum yaw rate. With 1.24, the cost of flowing
    legs, runs take the same time."""
    stop_share: float = 9.0 / 7.0
    """Cost of a stop relative to the time to brake from a lane's speed. With 1, runs take the same
    time."""
    looks_m: tuple[float, ...] = (2.2, 5.2)
    """Path lengths that limit the search, one after another. The last search has no limit."""
    slice_cells: int = 50_000
    """Work of a search in one control step, cells: about 2 ms. On a large floor the robot waits for
    some steps."""
    tries: int = 2
    """Number of fruitless attempts after which a cell is abandoned."""
    heading_fix_apart_s: float = 20.0
    """Minimum time between two heading fixes, s. It doubles after each fix without effect."""
    max_decisions: int = 4000
    """Maximum number of decisions in a plan."""

    # -- lanes and contact -----------------------------------------------------------------------
    obstacle_unswept: float = 0.4
    """Unswept share of the floor in front of an obstacle from which its perimeter is followed."""
    back_off_m_s: float = 0.05
    """Speed of backing off, m/s."""
    max_backs: int = 5
    """Maximum number of times that the robot backs off from one cliff."""
    cliff_clear_m: float = 0.05
    """Additional reverse path after the sensor detects floor, m. Between two of its barriers, a
    cliff may be as near as 9 cm, the distance at which the outer barriers detect it. This path
    keeps the wheels off the cliff."""

    # -- perimeter pass --------------------------------------------------------------------------
    perimeter_stuck_m: float = 0.02
    """Path along a wall below which an attempt counts as stuck, m."""
    perimeter_max_stuck: int = 8
    """Number of stuck attempts in a row after which the pass ends."""
    min_away_rad: float = math.radians(12.0)
    """Minimum turn away from a contact, rad. A first contact may be with the followed wall. A
    repetition within ``same_bump_m`` increases the turn with each contact."""
    same_bump_m: float = 0.06
    """Maximum path between two contacts at the same place, m."""
    brisk_stop_s: float = 0.5
    """Maximum time from a high speed to standstill, s. A robot with a higher speed before was not
    in a corner, so it did not graze that corner."""
    min_turn_rad: float = math.radians(2.0)
    """Turn below which the robot steers in the next leg instead, rad."""
    fresher: float = 0.1
    """Minimum difference of the unswept shares at which the robot chooses the left side."""

    # -- transit ---------------------------------------------------------------------------------
    bend_rad: float = math.radians(15.0)
    """Bend of a path below which the robot steers instead of turning in place, rad."""
    slight_rad: float = math.radians(10.0)
    """Maximum planned bend that remains below ``bend_rad`` from the robot's real place, rad."""
    bend_m_s: float = 0.12
    """Speed through a slight bend, m/s."""
    corner_m_s: float = 0.05
    """Speed into a turn in place, m/s. The turn stops the rest of the motion."""
    blocked_m: float = 0.03
    """Missing length from which a path segment counts as blocked, m."""
    passage_m: float = 0.4
    """Minimum path along an obstacle that blocked the robot twice, for the paper's robot, m. It
    leads round the edge of a door and through the door."""

    # -- heading fix -----------------------------------------------------------------------------
    fix_uncertain_rad: float = math.radians(0.8)
    """Heading standard deviation from which a fix is due, rad: a lane of 2 m ends 3 cm off."""
    fix_helped: float = 0.75
    """Maximum remaining share of the standard deviation after a fix that had an effect."""
    fix_enough_rad: float = math.radians(0.6)
    """Heading standard deviation after the transit at which the fix is no longer needed, rad."""
    fix_run_m_s: float = 0.15
    """Speed along the wall, m/s. It is low, for more readings."""

    # -- each observation ------------------------------------------------------------------------
    check_m: float = 0.05
    """Path between two checks whether a perimeter pass is complete, m."""
    beside_unswept: float = 0.8
    """Unswept share of the floor in front of a wall beside the lane above which the lane ends."""
    straight_rad_s: float = 0.3
    """Maximum yaw rate at which wall following is straight, rad/s."""
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

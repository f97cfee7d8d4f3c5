"""Options of the recovery planner: values tuned by experiments. Most are relative to the robot.

:mod:`bridge.coverage.recovery.geometry` converts them to lengths, areas and cells for one robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class RecoveryOptions:
    """Values tuned on generated rooms. Lengths are in m, angles in rad; shares have no unit."""

    cells_per_width: float = 8.0
    """Number of map cells per width of the mouth: 2 cm for the paper's robot."""
    cells_per_radius: float = 8.0
    """Minimum number of map cells per footprint radius. It limits the cell size of a robot with a
    wide mouth, because large cells close narrow passages."""
    min_cell_m: float = 0.01
    """Minimum length of a cell's edge, m. With smaller cells, a search on a large floor takes
    seconds."""
    max_cell_m: float = 0.025
    """Maximum length of a cell's edge, m. With larger cells, the map closes passages that the
    footprint fits through."""
    search_margin: float = 1.0 / 16.0
    """Share of the mouth's width at each end that the search does not expect to sweep. It is 1 cm
    for the paper's robot, and never more than ``max_search_margin_m``."""
    max_search_margin_m: float = 0.01
    """Maximum length at each end of the mouth that the search does not expect to sweep, m."""
    margin_sigmas: float = 0.4
    """Length at each end of the mouth that does not count as swept, in standard deviations of the
    position across the heading. Two lanes beside each other have a common part of the error, so
    less than one is enough. At typical noise, 0.5 gives 0.03 % more coverage and a path that is
    longer by 1 %."""
    min_margin_m: float = 0.003
    """Minimum length at each end of the mouth that does not count as swept, m."""
    max_margin: float = 0.125
    """Maximum length at each end of the mouth that does not count as swept, in widths of the
    mouth."""
    inflation_margin_cells: float = 0.3
    """Difference between the footprint's radius and the inflation, cells. It keeps narrow passages
    open in the map."""
    infrared_trust_m: float = 0.22
    """Infrared range beyond which readings are too noisy for the map, m."""
    perimeter_gap_m: float = 0.0005
    """Gap between rim and wall on a perimeter pass, m. A gap of 5 mm costs 1-2 % of the sweepable
    floor. Without a gap the robot presses against the wall and slips sideways, and the wheel
    encoders do not measure this slip."""
    stop_gap_m: float = 0.008
    """Gap between rim and wall at which a lane ends, m."""
    margin_m: float = 0.5
    """Distance from the driven path within which floor is assumed, m."""
    back_off_m: float = 0.015
    """Distance to back off after a contact, m."""
    fresh_share: float = 0.15
    """Unswept share of the strip ahead below which a perimeter pass ends."""
    min_area: float = 0.109375
    """Minimum new floor for a lane, in units of the mouth's width squared: 28 cm² for 16 cm."""
    min_rate: float = 1.5 / 14.0
    """Minimum sweep rate of a choice, relative to a full lane at cruise speed."""
    ahead_patience: float = 4.0
    """Tolerance for small pieces per distance of the mouth ahead of the axle. The minimum sweep
    rate is divided by 1 + ``ahead_patience`` * distance / width of the mouth. A mouth ahead of the
    axle leaves a small piece in each corner, and each piece needs a short lane."""
    near_radii: float = 0.5
    """Distance up to which a lane begins at the robot's place, in radii of the footprint. The
    search then counts one turn, and no additional cost of transit."""
    near_rate: float = 3.0 / 7.0
    """Sweep rate at which the search ends with a choice, relative to a full lane."""
    hole_rate: float = 1.0 / 70.0
    """Minimum sweep rate of a choice for a hole, relative to a full lane. A disc of half the
    mouth's width fits into a hole. Smaller pieces are not swept."""
    gap_m: float = 0.28
    """Maximum length of swept floor within a lane, m."""
    frontier: float = 0.25
    """Cost per length of new frontier, in widths of the mouth. It prevents narrow unswept
    strips."""
    perimeter_length_m: float = 10.0 / 7.0
    """Length of a strip of full width that a perimeter pass is expected to sweep, m."""
    fruitful_length_m: float = 0.1
    """Expected length of a strip of full width in the test whether a perimeter pass was fruitful,
    m."""
    retry_length_m: float = 0.625
    """Length of a strip of full width after which a fruitless attempt may be repeated, m. It is an
    area of new floor."""
    perimeter_pace: float = 1.2
    """Speed along a straight wall, relative to cruise speed. Along a curve the robot drives at
    cruise speed, because its ultrasonic sensor cannot detect obstacles behind the curve."""
    lane_pace: float = 1.4
    """Speed on a lane and in transit, relative to cruise speed."""
    top_share: float = 14.0 / 15.0
    """Maximum share of the robot's top speed on a lane. The rest is a reserve for control."""
    turn_share: float = 1.7
    """Cost of a turn, relative to its time at the maximum yaw rate. A test with 1.24, the cost with
    flowing legs, gave the same run times."""
    stop_share: float = 9.0 / 7.0
    """Cost of a stop, relative to the time to brake from a lane's speed. A test with 1 gave the
    same run times."""
    transit_share: float = 4.0
    """Cost of transit in the comparison of targets, relative to its time. The robot must sweep all
    targets, so a distant target is not better because it is large: it is swept later, with less
    transit. With 1 the path is 1 % longer. With 4, one of 100 random robots did not get through a
    door that is 1 cm wider than the robot; with 2, each did."""
    return_m: float = 1.0
    """Transit that a return to a small piece of unswept floor costs, m. A lane that leaves no such
    piece saves it. With 0 the path is 2 % longer."""
    small_area: float = 1.0
    """Area of a piece from which the whole return counts, in units of the mouth's width squared.
    The robot does not return to each smaller piece."""
    search_lengths_m: tuple[float, ...] = (2.2, 5.2)
    """Maximum path lengths of the search, tried one after another, m. The last search has no
    limit."""
    snap_m: float = 0.12
    """Maximum distance from the robot to the passable cell in which the search starts, for the
    paper's robot and smaller robots, m. It is used if the robot's own cell is not passable."""
    unreachable_m: float = 1.0
    """Minimum visited but unreachable path that shows wrong evidence, m."""
    slice_cells: int = 50_000
    """Number of cells that a search processes in one control step: about 2 ms. On a large floor the
    robot waits for some steps."""
    max_attempts: int = 2
    """Number of fruitless attempts after which a cell is abandoned."""
    heading_fix_apart_s: float = 20.0
    """Minimum time between two heading fixes, s. It doubles after each fix without effect."""
    max_decisions: int = 4000
    """Maximum number of decisions in a plan."""
    moved_cells: float = 0.25
    """Motion after which the floor under the mouth is marked, cells."""
    jump_s: float = 1.0
    """Motion between two observations from which it is a jump of the pose, in s of driving at top
    speed. A loss of the link of 1 s ends the drive."""
    turned_rad: float = 0.02
    """Turn after which the floor under the mouth is marked, rad."""
    strong_m: float = 0.12
    """Infrared range below which a reading has double weight, m. One such reading marks a cell as
    occupied. The sensor's noise grows with the square of the range."""
    contact_uncertain_m: float = 0.035
    """Pose uncertainty within which evidence near the rim may be the cause of a contact, m."""
    look_rad_s: float = 1.0
    """Maximum yaw rate at which infrared readings are added to the map, rad/s."""
    beam_end_m: float = 0.03
    """Length of the end of an infrared beam in which it removes no evidence, m."""
    range_rim_m: float = 0.01
    """Distance from the rim at which an obstacle that the ultrasonic sensor detects is mapped,
    m."""
    occlusion_min_m: float = 0.15
    """Minimum missing length of a lane that counts as an occluded region, m."""
    occlusion_closed_share: float = 0.5
    """Share of the length that later lanes must sweep to close an occluded region."""

    # -- lanes and contact -----------------------------------------------------------------------
    approach_margin_m: float = 0.02
    """Difference between the infrared sensor's maximum range and the range at which the robot
    starts to follow the first wall, m."""
    contact_ahead_min: float = 0.125
    """Minimum distance of the checked floor in front of an obstacle, in the direction of the
    obstacle, in widths of the mouth."""
    contact_ahead_max: float = 0.46875
    """Maximum distance of the checked floor in front of an obstacle, in the direction of the
    obstacle, in widths of the mouth."""
    contact_beside: float = 0.25
    """Half the width of the checked floor in front of an obstacle, in widths of the mouth."""
    obstacle_unswept: float = 0.4
    """Minimum unswept share of the floor in front of an obstacle whose perimeter is followed."""
    back_off_m_s: float = 0.05
    """Speed of backing off, m/s."""

    # -- cliffs ----------------------------------------------------------------------------------
    cliff_back_off_m: float = 0.03
    """Distance to back off from a cliff, m. It is repeated until the sensor detects floor ahead."""
    max_backs: int = 5
    """Maximum number of times that the robot backs off from the same cliff."""
    cliff_clear_m: float = 0.05
    """Additional distance to back off from a cliff after the sensor detects floor, m. Between two
    of the light barriers, a cliff may come as near as 9 cm to the wheels. The outer barriers detect
    a cliff only at this distance. The additional distance keeps the wheels off the cliff."""
    known_floor_inside_m: float = 0.015
    """Difference between half the wheel base and the distance from the axle's path within which the
    floor is known to exist, m. The wheels drove on both sides of this floor."""
    cliff_reach_m: float = 0.105
    """Maximum distance that a cliff can extend inwards between two sensors, for the paper's robot,
    m."""
    cliff_slow_m: float = 0.19
    """Distance from the footprint to a cliff at which the speed limit begins, m."""
    cliff_perimeter_m: float = 0.26
    """Minimum distance from the footprint to a cliff at which a perimeter pass may begin, m."""
    cliff_same_m: float = 0.02
    """Distance within which a new detection counts as the same cliff, m."""
    cliff_same_rad: float = math.radians(15.0)
    """Turn within which a new detection counts as the same cliff, rad."""
    cliff_floor_min_m: float = 0.01
    """Minimum distance ahead of the mark of a cliff at which detected floor removes the mark, m."""
    cliff_floor_max_m: float = 0.06
    """Maximum distance ahead of the mark of a cliff at which detected floor removes the mark, m."""
    cliff_floor_aside_m: float = 0.02
    """Maximum distance to the side of the mark of a cliff at which detected floor removes the mark,
    m."""
    cliff_m_s: float = 0.10
    """Maximum speed near a cliff, m/s. Stopping from 0.28 m/s takes 5 cm. The outer barriers detect
    a cliff only 9 cm before the wheels reach it."""

    # -- perimeter pass --------------------------------------------------------------------------
    band_inner: float = 0.1875
    """Inner limit of the strip that a perimeter pass sweeps, from the axle's line, in widths of the
    mouth. This strip is at the end of the mouth next to the wall."""
    band_outer: float = 0.40625
    """Outer limit of the strip that a perimeter pass sweeps, from the axle's line, in widths of the
    mouth."""
    band_ahead_min_m: float = 0.03
    """Distance ahead of the mouth at which the strip begins that is checked to detect a complete
    pass, m."""
    band_ahead_max_m: float = 0.25
    """Distance ahead of the mouth at which the strip ends that is checked to detect a complete
    pass, m."""
    round_m_s: float = 0.0825
    """Minimum speed that means a corner during wall following, m/s. It is converted to a yaw rate
    with the radius on which the axle drives round a corner: 0.5 rad/s, nine tenths of the yaw rate
    in a corner."""
    perimeter_stuck_m: float = 0.02
    """Path along a wall below which the attempt counts as stuck, m."""
    perimeter_max_stuck: int = 8
    """Number of stuck attempts in a row after which the pass ends."""
    min_away_rad: float = math.radians(12.0)
    """Minimum turn away from a contact, rad. A first contact may be with the followed wall. Each
    further contact within ``same_bump_m`` increases the turn."""
    same_bump_m: float = 0.06
    """Maximum path between two contacts that count as contacts at the same place, m."""
    oblique_rad: float = math.radians(65.0)
    """Minimum bearing of a contact with a wall to which the robot drives at a small angle, rad."""
    abeam_rad: float = math.radians(60.0)
    """Bearing beyond which evidence near the rim belongs to the followed wall, rad."""
    beside_share: float = 0.9
    """Share of the radius beyond which an obstacle at the side is the followed wall. Used in a
    corner."""
    beside_straight_share: float = 0.6
    """Share of the radius beyond which an obstacle at the side is the followed wall. Used along a
    straight wall, where older evidence may be some centimetres wrong after a pose correction."""

    # -- transit ---------------------------------------------------------------------------------
    min_leg_m: float = 0.01
    """Maximum length of a path segment that is too short to drive, m."""
    bend_rad: float = math.radians(15.0)
    """Minimum bend of a path for a turn in place, rad. In a smaller bend the robot steers."""
    slight_rad: float = math.radians(10.0)
    """Maximum planned bend that counts as slight, rad. From the robot's real place this bend is
    still smaller than ``bend_rad``."""
    bend_m_s: float = 0.12
    """Speed through a slight bend, m/s."""
    corner_m_s: float = 0.05
    """Speed at the beginning of a turn in place, m/s. The turn ends this motion."""
    u_turn_widths: tuple[float, float] = (0.5, 1.5)
    """Minimum and maximum distance between two lanes for a U-turn, in widths of the mouth."""
    u_turn_behind: float = 1.0
    """Maximum distance of the next lane's beginning behind the robot for a U-turn, in widths of the
    mouth. The robot then drives this distance on swept floor before the lane."""
    u_turn_ahead: float = 3.0
    """Maximum distance of the next lane's beginning ahead of the robot for a U-turn, in widths of
    the mouth. The robot drives it before the U-turn."""
    u_turn_radii: tuple[float, ...] = (0.5, 0.35, 0.225)
    """Radii of a U-turn, relative to the distance between the lanes: the first with which the path
    is free. A smaller radius needs less floor ahead, and more time."""
    blocked_m: float = 0.03
    """Minimum missing length with which a path segment counts as blocked, m."""
    passage_m: float = 0.4
    """Minimum path along an obstacle that blocked the robot twice, for the paper's robot, m. This
    path leads round the edge of a door and through the door."""

    # -- heading fix -----------------------------------------------------------------------------
    fix_uncertain_rad: float = math.radians(0.8)
    """Minimum heading standard deviation for a fix, rad. With it a lane of 2 m ends 3 cm off."""
    fix_helped: float = 0.75
    """Maximum ratio of the standard deviations after and before a fix that counts as successful."""
    fix_enough_rad: float = math.radians(0.6)
    """Heading standard deviation below which the fix is not needed after the transit, rad."""
    fix_run_m: float = 0.48
    """Length of a drive along a wall, m: 40 cm for the measurement, and 8 cm for the approach. It
    measures the direction with an error of a third of a degree, with a noisy infrared sensor."""
    fix_run_m_s: float = 0.15
    """Speed along the wall in a heading fix, m/s. A low speed gives more readings."""
    fix_off_m: float = 0.035
    """Additional gap to the wall compared with a perimeter pass, m. It allows for the position
    error. A robot that grazes the wall turns parallel to it and would take this as its own
    heading."""
    fix_read_s: float = 0.15
    """Standstill after the drive, s. The last infrared reading arrives in this time."""
    fix_wall_m: float = 0.5
    """Minimum length of a wall segment that is stored for heading fixes, m."""
    fix_bent_rad: float = math.radians(10.0)
    """Turn of the heading that ends a wall segment, rad."""
    fix_tries: int = 2
    """Number of drives in a row without effect after which a wall segment is removed."""

    # -- each observation ------------------------------------------------------------------------
    check_m: float = 0.05
    """Path between two checks whether a perimeter pass is complete, m."""
    beside_unswept: float = 0.8
    """Minimum unswept share of the floor in front of a wall beside the lane for which the lane
    ends."""
    straight_rad_s: float = 0.3
    """Maximum yaw rate at which a followed wall counts as straight, rad/s."""
    steady_rad_s: float = 0.1
    """Maximum yaw rate at which the heading is used for the main direction of the walls, rad/s."""
    steady_m_s: float = 0.05
    """Minimum speed at which the heading is used for the main direction of the walls, m/s."""
    on_lane_m_s: float = 0.1
    """Minimum speed from which the robot counts as on its lane, m/s."""
    correction_m: float = 0.008
    """Minimum motion of the estimate beyond the driven path that counts as a pose correction, m.
    The robot drives 6 mm in a control step at top speed."""
    reported_rad: float = math.radians(0.3)
    """Minimum heading standard deviation whose reduction is reported, rad. A wall reduces it."""
    reported_share: float = 0.5
    """Maximum ratio of the standard deviations after and before a reduction that is reported."""
    beside_lane_min: float = 0.09375
    """Inner limit of the strip that a wall beside a lane occupies, measured from the gap to the
    wall, in widths of the mouth."""
    beside_lane_max: float = 0.40625
    """Outer limit of the strip that a wall beside a lane occupies, measured from the gap to the
    wall, in widths of the mouth."""
    beside_lane_gap: float = 0.875
    """Maximum gap between rim and wall at which the wall makes the lane narrower, in widths of the
    mouth."""
    beside_lane_ahead_m: float = 0.03
    """Length ahead of a side infrared sensor in which floor counts as beside the lane, m."""
    closed_after_m: float = 0.25
    """Minimum path before a perimeter pass can be complete, m. The pass may begin on floor that a
    lane has swept."""

    # -- stuck policy; lengths are for the paper's robot and scale with the robot's size -----------
    max_fruitless: int = 20
    """Number of fruitless decisions in a row after which evidence is cleared."""
    max_blocked: int = 6
    """Number of blocks at one place after which evidence is cleared there."""
    patient_decisions: int = 8
    """Number of fruitless decisions in a row from which every block counts against the target.
    Before that, a block far from the target does not count."""
    same_place_m: float = 0.15
    """Distance within which two places count as the same place, m. It allows for the position
    uncertainty. A place is a block, or the beginning of a wall."""
    worth_length_m: float = 0.1875
    """Length of a strip of full width for which the robot spends 5 s to search for a passage, m. It
    is an area of new floor, and does not scale with the robot's size."""
    min_wall_m: float = 0.24
    """Minimum length of an obstacle that the robot follows, m. It does not scale with the robot's
    size. A chair leg is smaller. Following it leads back to the same place."""
    far_m: float = 0.4
    """Minimum distance of a block that is far from the target, m."""
    max_cleared: int = 3
    """Maximum number of times that evidence is cleared without new floor."""
    clear_radius_m: float = 0.6
    """Half the edge of the square in which evidence is cleared if the robot finds no way to
    continue, m. Blocked cells are always cleared in this square, and cliffs in a circle with this
    radius."""
    blocked_radius_m: float = 0.3
    """Half the edge of the square in which occupied cells are cleared if one place blocks the
    robot, m. Obstacles farther away do not block it. Without them in the map, the robot would bump
    into known chair legs again."""
    bump_radius_m: float = 0.2
    """Radius around bumps within which targets get one more attempt, m."""
    blocks_to_close: int = 2
    """Number of blocks at one place from which the map closes the passage and the robot follows the
    obstacle."""
    closed_m: float = 0.03
    """Increase of the closed radius for each block at the same place, m. It does not scale with the
    robot's size."""
    wall_m: float = 0.2
    """Radius within which wall cells are counted, m. It does not scale with the robot's size."""
    fruitless_share: float = 0.3
    """Share of the expected new floor below which an attempt is fruitless for its target."""

    def for_model(self, model: RobotModel) -> RecoveryOptions:
        """Return the options for a robot that may lack sensors.

        A robot without side infrared follows a wall by repeated contacts. This takes longer and
        makes the pose uncertain. For such a robot a perimeter pass has a lower expected gain, and
        the planner abandons a target earlier.
        """
        if model.infrared_left.fitted or model.infrared_right.fitted:
            return self
        return replace(
            self,
            perimeter_length_m=0.3 * self.perimeter_length_m,
            max_fruitless=max(self.max_fruitless // 2, 1),
            max_attempts=1,
        )

"""Values of the recovery planner that depend on the robot: size, mouth, sensor mounts and speeds.

They are computed here, once, from the robot file and the tuned ratios of :class:`RecoveryOptions`.
No other module of the planner contains a length of the robot. The grid's cell is an eighth of the
mouth's width. So every robot needs about the same number of cells for an area relative to its
mouth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.motion.control.wall_follow import FollowTuning

if TYPE_CHECKING:
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.robot_model import RobotModel

_EXACT = 9
"""Number of decimals of rounded values: a nanometre. Products then equal the documented values."""


_TUNED_RADIUS_M = 0.16
"""Radius of the robot for which the lengths of ``RecoveryOptions`` were tuned: the paper's, m."""


def _exact(value: float) -> float:
    return round(value, _EXACT)


@dataclass(frozen=True, slots=True)
class PlannerGeometry:
    """Sizes of one robot, for map, search and behaviours.

    Lengths are in m, areas in m². Names that end in ``_cells`` are in cells of the grid, possibly
    with a fraction. The number in brackets is the value for the paper's robot.
    """

    radius_m: float
    """Radius of the footprint (0.16)."""
    width_m: float
    """Width of the mouth (0.16)."""
    ahead_m: float
    """Distance of the mouth ahead of the axle (0)."""
    scale: float
    """Footprint diameter relative to the paper's robot (1). It scales distances that depend on the
    size of the footprint."""
    cell_m: float
    """Length of a cell's edge (0.02)."""

    # -- the map -------------------------------------------------------------------------------
    mouth_cells: float
    """Half width of the mouth that the search expects to sweep (3.5)."""
    half_width_cells: float
    """Half width of the mouth (4)."""
    margin_sigmas: float
    """Length at each end of the mouth that does not count as swept, in standard deviations of the
    position across the heading (0.4)."""
    margin_cells: tuple[float, float]
    """Minimum and maximum of this length (0.15 and 1)."""
    inflation_cells: float
    """Distance from an obstacle within which the axle cannot be (7.7). It is smaller than the
    radius by a third of a cell, so that narrow passages stay open in the grid."""
    clear_cells: float
    """Distance from the axle within which there is certainly no obstacle (7): the radius minus a
    cell."""
    rim_cells: float
    """Maximum distance from the rim at which evidence may be the cause of a contact (1.75). This is
    a pose uncertainty of 3.5 cm."""
    known_floor_m: float
    """Distance from the axle's path within which the floor is known to exist (0.10). The wheels
    drove on both sides of it."""
    cliff_m: float
    """Minimum distance of the axle from missing floor (0.22): half the wheel base, plus the maximum
    distance that a cliff can extend inwards between two sensors."""
    cliff_slow_m: float
    """Distance of the axle from a cliff at which the speed limit begins (0.35)."""
    cliff_perimeter_m: float
    """Minimum distance of the axle from a cliff at which a perimeter pass may begin (0.42)."""

    # -- the search ----------------------------------------------------------------------------
    lane_rows: int
    """Maximum number of rows that a lane sweeps (7)."""
    ahead_cells: int
    """Distance of the mouth ahead of the axle, in whole cells (0)."""
    turning_cells_2: int
    """Square of the maximum distance from the axle at which the mouth sweeps a cell during a turn
    in place (12). It is larger if the mouth is ahead of the axle."""
    beside_cells: int
    """Radius of the floor beside a wall that is searched for unswept cells (4): half the mouth's
    width."""
    hole_cells: int
    """Diameter of the disc that must fit into a hole in the swept area (4): half the mouth's
    width."""
    snap_cells: int
    """Maximum distance from the robot to the passable cell in which the search starts (6). Used if
    the robot's own cell is not passable."""
    unreachable_cells: int
    """Minimum number of visited but unreachable cells that shows wrong evidence (50): 1 m of
    path."""
    min_cells: int
    """Minimum number of new cells for a lane (7, 28 cm²): a ninth of the mouth's width squared."""
    floor_cells: int
    """Number of new cells after which a fruitless attempt may be repeated (250): 0.1 m² at the
    paper's width."""
    gap_cells: int
    """Maximum length of swept floor within a lane (14): 28 cm."""
    frontier: float
    """Cost per cell edge of new frontier, cells (2): a quarter of the mouth's width. A frontier is
    an edge between swept and unswept floor."""
    full_rate: float
    """Number of cells that the mouth sweeps per second at cruise speed (70)."""
    min_rate: float
    """Minimum number of new cells per second of a choice (7.5)."""
    near_rate: float
    """Number of new cells per second at which the search ends with a choice (30)."""
    hole_rate: float
    """Minimum number of new cells per second of a choice that sweeps a hole (1)."""
    perimeter_cells: float
    """Number of new cells that a perimeter pass is expected to sweep (500)."""
    fruitful_cells: float
    """Expected new cells of a perimeter pass in the test whether the pass was fruitful (40)."""
    path_costs: tuple[int, ...]
    """Maximum path costs of the search, tried one after another (1100, 2600, unlimited)."""
    near_cost: float
    """Path cost up to which a lane begins at the robot's place (40): half a radius."""
    turn_s_rad: float
    """Cost of a turn, s/rad (0.85)."""
    stop_s: float
    """Cost of a stop, s (0.9)."""
    transit_share: float
    """Cost of transit in the comparison of targets, relative to its time (4)."""
    return_cells: float
    """Number of cells that the mouth sweeps in the time of a return to a small piece of unswept
    floor (250)."""
    small_cells: int
    """Number of cells from which a piece has the whole additional weight of a return (64): the
    mouth's width squared."""

    # -- behaviours ----------------------------------------------------------------------------
    lane_speed_m_s: float
    """Speed on a lane and in transit (0.28)."""
    perimeter_speed_m_s: float
    """Speed along a straight wall (0.24)."""
    stop_range_m: float
    """Ultrasonic range at which a lane ends (0.048): a gap of 8 mm between rim and wall."""
    approach_range_m: float
    """Infrared range at which the robot starts to follow the first wall (0.28)."""
    band_m: tuple[float, float]
    """Lateral limits of the strip that a perimeter pass sweeps, from the axle's line (0.03 to
    0.065). This strip is at the end of the mouth next to the wall."""
    band_ahead_m: tuple[float, float]
    """Limits ahead of the axle of the strip that is checked to detect a complete pass (0.03 to
    0.25)."""
    contact_ahead_m: tuple[float, float]
    """Limits of the checked floor in front of an obstacle, in the direction of the obstacle (0.02
    to 0.075)."""
    contact_beside_m: float
    """Half the width of the checked floor in front of an obstacle (0.04)."""
    beside_lane_m: tuple[float, float]
    """Limits of the strip that a wall beside a lane occupies, measured from the gap to the wall
    (0.015 to 0.065)."""
    beside_lane_ahead_m: tuple[float, float]
    """Limit ahead of the axle of the floor beside a lane, for the left and the right side infrared
    sensor (0.08)."""
    beside_lane_gap_m: float
    """Maximum gap between rim and wall at which the wall makes the lane narrower (0.14)."""
    beside_m: tuple[float, float]
    """Distance from the axle's line beyond which an obstacle is the followed wall: in a corner
    (0.144), and along a straight wall (0.096)."""
    range_point_m: float
    """Distance from the axle at which an obstacle that the ultrasonic sensor detects is mapped
    (0.17)."""
    round_rad_s: float
    """Minimum yaw rate that means a corner during wall following (0.5): nine tenths of the yaw rate
    in a corner."""
    same_place_m: float
    """Distance within which two places count as the same place (0.15). It allows for the position
    uncertainty. A place is a block, or the beginning of a wall."""
    worth_m2: float
    """Minimum new floor for which the robot spends 5 s to search for a passage (0.03)."""
    min_wall_cells: int
    """Minimum number of occupied cells at an obstacle that the robot follows (12): 24 cm of wall. A
    chair leg is smaller. Following it leads back to the same place."""

    @classmethod
    def from_model(cls, model: RobotModel, options: RecoveryOptions) -> PlannerGeometry:
        """Compute all values from a robot and the tuned ratios."""
        radius_m, width_m = model.radius_m, model.cleaning_width_m
        scale = _exact(radius_m / _TUNED_RADIUS_M)
        cell_m = min(width_m / options.cells_per_width, radius_m / options.cells_per_radius)
        cell_m = _exact(min(max(cell_m, options.min_cell_m), options.max_cell_m))
        half_m = 0.5 * width_m - min(options.search_margin * width_m, options.max_search_margin_m)
        half = _exact(half_m / cell_m)
        full_rate = _exact(2.0 * half * model.cruise_speed_m_s / cell_m)
        lane_speed = min(
            options.lane_pace * model.cruise_speed_m_s, options.top_share * model.max_speed_m_s
        )
        perimeter_speed = options.perimeter_pace * model.cruise_speed_m_s
        if not model.ultrasonic.fitted:  # obstacles are detected only by contact
            lane_speed = min(lane_speed, model.cruise_speed_m_s)
            perimeter_speed = min(perimeter_speed, model.cruise_speed_m_s)

        ahead_m = max(model.mouth_offset_m, 0.0)
        patience = 1.0 + options.ahead_patience * ahead_m / width_m

        def per_cell(area_m2: float) -> float:
            return _exact(area_m2 / cell_m**2)

        return cls(
            radius_m=radius_m,
            width_m=width_m,
            ahead_m=model.mouth_offset_m,
            scale=scale,
            cell_m=cell_m,
            mouth_cells=half,
            half_width_cells=_exact(0.5 * width_m / cell_m),
            margin_sigmas=options.margin_sigmas,
            margin_cells=(
                _exact(options.min_margin_m / cell_m),
                _exact(options.max_margin * width_m / cell_m),
            ),
            inflation_cells=_exact(radius_m / cell_m - options.inflation_margin_cells),
            clear_cells=_exact(radius_m / cell_m - 1.0),
            rim_cells=_exact(options.contact_uncertain_m / cell_m),
            known_floor_m=_exact(0.5 * model.wheel_base_m - options.known_floor_inside_m),
            cliff_m=_exact(0.5 * model.wheel_base_m + options.cliff_reach_m * scale),
            cliff_slow_m=_exact(radius_m + options.cliff_slow_m),
            cliff_perimeter_m=_exact(radius_m + options.cliff_perimeter_m),
            lane_rows=2 * max(min(round(half - 0.5), int(_exact(0.5 * width_m / cell_m - 0.5))), 1)
            + 1,
            ahead_cells=round(ahead_m / cell_m),
            turning_cells_2=int((ahead_m**2 + half_m**2) / cell_m**2),
            beside_cells=max(round(0.5 * width_m / cell_m), 2),
            hole_cells=max(round(0.5 * width_m / cell_m), 2),
            snap_cells=round(options.snap_m * max(scale, 1.0) / cell_m),
            unreachable_cells=round(options.unreachable_m / cell_m),
            min_cells=round(per_cell(options.min_area * width_m**2)),
            floor_cells=round(per_cell(options.retry_length_m * width_m)),
            gap_cells=round(options.gap_m / cell_m),
            frontier=_exact(options.frontier * width_m / cell_m),
            full_rate=full_rate,
            min_rate=_exact(options.min_rate * full_rate / patience),
            near_rate=_exact(options.near_rate * full_rate),
            hole_rate=_exact(options.hole_rate * full_rate),
            perimeter_cells=_exact(options.perimeter_length_m * 2.0 * half / cell_m),
            fruitful_cells=per_cell(options.fruitful_length_m * width_m),
            path_costs=(*(round(10.0 * m / cell_m) for m in options.search_lengths_m), 1 << 24),
            near_cost=_exact(10.0 * options.near_radii * radius_m / cell_m),
            turn_s_rad=_exact(options.turn_share / model.max_yaw_rate_rad_s),
            stop_s=_exact(options.stop_share * lane_speed / model.max_accel_m_s2),
            transit_share=options.transit_share,
            return_cells=_exact(full_rate * options.return_m / lane_speed),
            small_cells=round(per_cell(options.small_area * width_m**2)),
            lane_speed_m_s=_exact(lane_speed),
            perimeter_speed_m_s=perimeter_speed,
            stop_range_m=model.ultrasonic.stop_range_m(radius_m, options.stop_gap_m),
            approach_range_m=_exact(_farthest(model) - options.approach_margin_m),
            band_m=(_exact(options.band_inner * width_m), _exact(options.band_outer * width_m)),
            band_ahead_m=(
                _exact(model.mouth_offset_m + options.band_ahead_min_m),
                _exact(model.mouth_offset_m + options.band_ahead_max_m),
            ),
            contact_ahead_m=(
                _exact(options.contact_ahead_min * width_m),
                _exact(options.contact_ahead_max * width_m),
            ),
            contact_beside_m=_exact(options.contact_beside * width_m),
            beside_lane_m=(
                _exact(options.beside_lane_min * width_m),
                _exact(options.beside_lane_max * width_m),
            ),
            beside_lane_ahead_m=(
                model.infrared_left.x_m + options.beside_lane_ahead_m,
                model.infrared_right.x_m + options.beside_lane_ahead_m,
            ),
            beside_lane_gap_m=_exact(options.beside_lane_gap * width_m),
            beside_m=(
                options.beside_share * radius_m,
                options.beside_straight_share * radius_m,
            ),
            range_point_m=radius_m + options.range_rim_m,
            round_rad_s=_exact(options.round_m_s / (radius_m + FollowTuning().corner_gap_m)),
            same_place_m=_exact(options.same_place_m * scale),
            worth_m2=_exact(options.worth_length_m * width_m),
            min_wall_cells=round(options.min_wall_m / cell_m),
        )

    def swept_cells(self, lateral_sigma_m: float) -> float:
        """Return half the width of the strip that counts as swept, cells.

        ``lateral_sigma_m`` is the standard deviation of the position across the heading, m.
        """
        low, high = self.margin_cells
        margin = self.margin_sigmas * lateral_sigma_m / self.cell_m
        return self.half_width_cells - min(max(margin, low), high)

    def area_m2(self, cells: float) -> float:
        """Return the area of a number of cells, m²."""
        return cells * self.cell_m**2


def _farthest(model: RobotModel) -> float:
    return min(model.infrared_left.max_range_m, model.infrared_right.max_range_m)

"""All values of the recovery planner that depend on the robot: size, mouth, mounts and speeds.

They are computed here, once, from the robot file and the tuned ratios of :class:`RecoveryOptions`.
No other module of the planner contains a length of the robot. The grid follows the mouth: a cell is
an eighth of the mouth's width. So an area relative to the mouth has about the same number of cells
for every robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.motion.robot_model import RangerMount, RobotModel

_MIN_CELL_M, _MAX_CELL_M = 0.01, 0.025
"""Limits of a cell's edge, m. With smaller cells, a search on a large floor takes seconds. Larger
cells close passages that the footprint fits through."""
_CELLS_PER_RADIUS = 8.0
"""Minimum number of cells per radius of the footprint, so that a wide mouth does not give a coarse
map of passages."""
_MAX_MARGIN_M = 0.01
"""Maximum length that does not count at each end of the mouth, for the pose uncertainty, m."""
_EXACT = 9
"""Number of decimals: a nanometre. Rounded products then equal the documented values exactly."""


def _exact(value: float) -> float:
    return round(value, _EXACT)


@dataclass(frozen=True, slots=True)
class PlannerGeometry:
    """Sizes of one robot, for map, search and behaviours.

    Lengths are in m and areas in m². Names that end in ``_cells`` are in cells of the grid, which
    may be fractional. Numbers in brackets are for the paper's robot.
    """

    radius_m: float
    """Radius of the footprint (0.16)."""
    width_m: float
    """Width of the mouth (0.16)."""
    ahead_m: float
    """Distance of the mouth ahead of the axle (0)."""
    scale: float
    """Diameter relative to the paper's robot (1). It scales distances that depend on the size of
    the footprint."""
    cell_m: float
    """Edge of a cell (0.02)."""

    # -- the map -------------------------------------------------------------------------------
    mouth_cells: float
    """Half width of the mouth minus the margin for the pose uncertainty (3.5)."""
    inflation_cells: float
    """Distance from an obstacle within which the axle cannot be (7.7). It is a third of a cell less
    than the radius, so that narrow passages stay open in the grid."""
    clear_cells: float
    """Distance from the axle within which there is no obstacle (7). It is a cell less than the
    radius."""
    rim_cells: float
    """Maximum distance from the rim at which evidence may be a contact (1.75): a pose uncertainty
    of 3.5 cm."""
    known_floor_m: float
    """Distance from the axle's path within which there must be floor (0.10): between the wheels."""
    cliff_m: float
    """Minimum distance of the axle from missing floor (0.22): half the wheel base, plus the
    distance that a cliff can reach between two sensors."""
    cliff_slow_m: float
    """Distance of the rim from a cliff at which the speed becomes limited (0.35)."""
    cliff_perimeter_m: float
    """Minimum distance from a cliff at which a perimeter pass may begin (0.42)."""

    # -- the search ----------------------------------------------------------------------------
    lane_cells: int
    """Number of rows on each side of a lane's row that the mouth sweeps (3)."""
    ahead_cells: int
    """Distance of the mouth ahead of the axle, cells (0)."""
    target_cells_2: int
    """Square of the distance from the axle at which the mouth sweeps a cell (12)."""
    turning_cells_2: int
    """The same square while the robot turns in place (12). A mouth ahead of the axle reaches
    farther."""
    beside_cells: int
    """Radius of the floor searched beside a wall (4): half the mouth's width."""
    hole_cells: int
    """Diameter of the disc that must fit into a hole in the swept area (4): half the mouth's
    width."""
    snap_cells: int
    """Maximum distance to a passable cell that replaces the robot's place as a start (6)."""
    unreachable_cells: int
    """Number of visited but unreachable cells that proves wrong evidence (50): a metre of path."""
    min_cells: int
    """Minimum number of new cells for a lane (7, 28 cm²): a ninth of the mouth's width squared."""
    floor_cells: int
    """Number of new cells after which a fruitless attempt may be repeated (250): 0.1 m² at the
    paper's width."""
    gap_cells: int
    """Maximum number of swept cells over which a lane continues (14): 28 cm."""
    frontier: float
    """Cost of each cell edge of new frontier, cells (2): a strip of a quarter of the mouth."""
    full_rate: float
    """Number of cells that the mouth sweeps per second at cruise speed (70)."""
    min_rate: float
    """Minimum number of new cells per second for a choice (15)."""
    near_rate: float
    """Number of new cells per second at which a choice is taken without a wider search (30)."""
    hole_rate: float
    """Minimum number of new cells per second for a hole (1)."""
    perimeter_cells: float
    """Number of new cells that a perimeter pass is expected to sweep (500)."""
    fruitful_cells: float
    """Number of new cells that the fruitful share of a perimeter pass refers to (40)."""
    path_costs: tuple[int, ...]
    """Path costs up to which the search looks, one after another (1100, 2600, unlimited)."""
    near_cost: float
    """Maximum cost of a path that need not be driven before a lane (40): a quarter of the
    footprint."""
    turn_s_rad: float
    """Cost of a turn, s/rad (0.85)."""
    stop_s: float
    """Cost of a stop, s (0.9)."""

    # -- behaviours ----------------------------------------------------------------------------
    lane_speed_m_s: float
    """Speed on a lane and in transit (0.28)."""
    perimeter_speed_m_s: float
    """Speed along a straight wall (0.24)."""
    stop_range_m: float
    """Ultrasonic range at which a lane ends (0.048): a gap of 8 mm between rim and wall."""
    approach_range_m: float
    """Infrared range from which the first wall is followed at once (0.28)."""
    band_m: tuple[float, float]
    """Strip beside the axle's line that a perimeter pass sweeps (0.03 to 0.065): the end of the
    mouth next to the wall."""
    band_ahead_m: tuple[float, float]
    """Limits ahead of the axle of the strip that shows whether a pass is complete (0.03 to
    0.25)."""
    contact_ahead_m: tuple[float, float]
    """Limits of the floor in front of an obstacle, towards the obstacle (0.02 to 0.075)."""
    contact_beside_m: float
    """Half the width of that floor (0.04)."""
    beside_lane_m: tuple[float, float]
    """Limits of the strip beside a lane that a wall occupies, counted from the gap to the wall
    (0.015 to 0.065)."""
    beside_lane_gap_m: float
    """Maximum gap between rim and wall at which the wall reduces the lane's width (0.14)."""
    round_rad_s: float
    """Minimum yaw rate at which wall following is in a corner (0.5): nine tenths of the corner's
    rate."""
    same_place_m: float
    """Distance within which two blocks, or a block and the beginning of a wall, count as one place
    (0.15). It allows for the uncertainty of the robot's position."""
    worth_m2: float
    """New floor that makes a search for a passage worth its 5 s (0.03)."""
    min_wall_cells: int
    """Minimum number of occupied cells at an obstacle that is worth following (12): 24 cm of wall.
    A chair leg is shorter, and following it leads back to the same place."""

    @classmethod
    def from_model(cls, model: RobotModel, options: RecoveryOptions) -> PlannerGeometry:
        """Derive every size from a robot and the tuned ratios."""
        radius_m, width_m = model.radius_m, model.cleaning_width_m
        scale = _exact(radius_m / 0.16)
        cell_m = min(width_m / options.cells_per_width, radius_m / _CELLS_PER_RADIUS)
        cell_m = _exact(min(max(cell_m, _MIN_CELL_M), _MAX_CELL_M))
        half_m = 0.5 * width_m - min(options.mouth_margin * width_m, _MAX_MARGIN_M)
        half = _exact(half_m / cell_m)
        full_rate = _exact(2.0 * half * model.cruise_speed_m_s / cell_m)
        lane_speed = min(
            options.lane_pace * model.cruise_speed_m_s, options.top_share * model.max_speed_m_s
        )
        perimeter_speed = options.perimeter_pace * model.cruise_speed_m_s
        if not model.ultrasonic.fitted:  # nothing is seen before it is touched
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
            inflation_cells=_exact(radius_m / cell_m - options.inflation_margin_cells),
            clear_cells=_exact(radius_m / cell_m - 1.0),
            rim_cells=_exact(0.035 / cell_m),
            known_floor_m=_exact(0.5 * model.wheel_base_m - 0.015),
            cliff_m=_exact(0.5 * model.wheel_base_m + 0.105 * scale),
            cliff_slow_m=_exact(radius_m + 0.19),
            cliff_perimeter_m=_exact(radius_m + 0.26),
            lane_cells=max(min(round(half - 0.5), int(_exact(0.5 * width_m / cell_m - 0.5))), 1),
            ahead_cells=round(ahead_m / cell_m),
            target_cells_2=int(half * half),
            turning_cells_2=int((ahead_m**2 + half_m**2) / cell_m**2),
            beside_cells=max(round(0.5 * width_m / cell_m), 2),
            hole_cells=max(round(0.5 * width_m / cell_m), 2),
            snap_cells=round(0.12 * scale / cell_m) if scale > 1.0 else round(0.12 / cell_m),
            unreachable_cells=round(1.0 / cell_m),
            min_cells=round(per_cell(options.min_area * width_m**2)),
            floor_cells=round(per_cell(options.retry_length_m * width_m)),
            gap_cells=round(options.gap_m / cell_m),
            frontier=_exact(options.frontier * width_m / cell_m),
            full_rate=full_rate,
            min_rate=_exact(options.min_rate * full_rate / patience),
            near_rate=_exact(options.near_rate * full_rate),
            hole_rate=_exact(options.hole_rate * full_rate),
            perimeter_cells=_exact(options.perimeter_length_m * 2.0 * half / cell_m),
            fruitful_cells=per_cell(0.1 * width_m),
            path_costs=(*(round(10.0 * m / cell_m) for m in options.looks_m), 1 << 24),
            near_cost=_exact(5.0 * radius_m / cell_m),
            turn_s_rad=_exact(options.turn_share / model.max_yaw_rate_rad_s),
            stop_s=_exact(options.stop_share * lane_speed / model.max_accel_m_s2),
            lane_speed_m_s=_exact(lane_speed),
            perimeter_speed_m_s=perimeter_speed,
            stop_range_m=_stop_range(model, options.stop_gap_m),
            approach_range_m=_exact(_farthest(model) - 0.02),
            band_m=(_exact(0.1875 * width_m), _exact(0.40625 * width_m)),
            band_ahead_m=(
                _exact(model.mouth_offset_m + 0.03),
                _exact(model.mouth_offset_m + 0.25),
            ),
            contact_ahead_m=(_exact(0.125 * width_m), _exact(0.46875 * width_m)),
            contact_beside_m=_exact(0.25 * width_m),
            beside_lane_m=(_exact(0.09375 * width_m), _exact(0.40625 * width_m)),
            beside_lane_gap_m=_exact(0.875 * width_m),
            round_rad_s=_exact(0.0825 / (radius_m + 0.005)),
            same_place_m=_exact(0.15 * scale),
            worth_m2=_exact(0.1875 * width_m),
            min_wall_cells=round(0.24 / cell_m),
        )

    def area_m2(self, cells: float) -> float:
        """Return the area of a number of cells, m²."""
        return cells * self.cell_m**2


def _farthest(model: RobotModel) -> float:
    return min(model.infrared_left.max_range_m, model.infrared_right.max_range_m)


def _stop_range(model: RobotModel, gap_m: float) -> float:
    """Return the ultrasonic range at a gap between rim and wall, at least its minimum range."""
    mount: RangerMount = model.ultrasonic
    return _exact(max(mount.hull_distance_m(model.radius_m) + gap_m, mount.min_range_m + gap_m))

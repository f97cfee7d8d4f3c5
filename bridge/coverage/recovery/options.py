"""Options of the recovery planner."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecoveryOptions:
    """Lengths in m, angles in rad; areas in cells where stated. Tuned on drawn rooms."""

    cell_m: float = 0.02
    mouth_margin_m: float = 0.01
    """Length by which each end of the mouth counts less, for the pose's uncertainty."""
    body_margin_m: float = 0.006
    """Length by which obstacles are inflated less than the footprint's radius: passages that the
    robot just fits through must stay open in a map of 2 cm cells."""
    infrared_trust_m: float = 0.22
    """Infrared range beyond which readings are too noisy for the map."""
    perimeter_gap_m: float = 0.0005
    """Gap between rim and wall on a perimeter pass; 5 mm cost 1-2 % of the sweepable floor. Not 0:
    a robot that presses on a wall slips sideways, which no wheel measures."""
    stop_range_m: float = 0.048
    """Ultrasonic reading at which a lane ends: 8 mm between rim and wall."""
    margin_m: float = 0.5
    """Distance from the driven path within which floor is assumed."""
    back_off_m: float = 0.015
    """Distance of backing off after a contact."""
    cliff_back_off_m: float = 0.03
    """Distance of backing off from a cliff, repeated until there is floor ahead."""
    fresh_share: float = 0.15
    """Unswept share of the strip ahead below which a perimeter pass ends."""
    min_cells: int = 7
    """New cells that a lane must promise: 28 cm²."""
    min_rate: float = 15.0
    """New cells per second that a choice must promise; a full lane gives 70."""
    hole_rate: float = 1.0
    """New cells per second that suffice for a hole into which a disc of 4 cm fits; slivers are
    left."""
    gap_cells: int = 14
    """Swept cells over which a lane continues."""
    frontier: float = 2.0
    """Cost of each cell edge of new frontier, cells: it prevents slivers."""
    perimeter_cells: float = 500.0
    """New cells that a perimeter pass is assumed to promise."""
    perimeter_pace: float = 1.2
    """Speed along a straight wall, times the cruise speed. A bend is followed at the cruise speed,
    because the ultrasonic does not see what stands behind it."""
    lane_speed_m_s: float = 0.28
    """Speed on a lane."""
    travel_speed_m_s: float = 0.28
    """Speed in transit."""
    turn_s_rad: float = 0.85
    """Cost of a turn, s/rad. With 0.62, the cost of flowing legs, runs are as long."""
    stop_s: float = 0.9
    """Cost of a stop, s. With 0.7 runs are as long."""
    looks: tuple[int, ...] = (1100, 2600, 1 << 24)
    """Path costs (1 m is 500) up to which the search looks, one after another."""
    near_rate: float = 30.0
    """New cells per second at which a choice is taken without a wider search."""
    slice_cells: int = 50_000
    """Work of a search in one control step, cells: about 2 ms. On a large floor the robot stands
    for some steps."""
    tries: int = 2
    """Fruitless attempts after which a cell is abandoned."""
    heading_fix_apart_s: float = 20.0
    """Least time between two heading fixes, s; it doubles after each that did not help."""
    max_decisions: int = 4000
    """Decisions after which a plan ends."""

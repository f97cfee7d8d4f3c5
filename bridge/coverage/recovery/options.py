"""The planner's figures, each with its unit and why."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecoveryOptions:
    """Lengths in metres, angles in radians, areas in cells of the map where they say so."""

    cell_m: float = 0.02
    mouth_margin_m: float = 0.01
    """Each end of the mouth counts this much short: what the pose is unsure of."""
    body_margin_m: float = 0.006
    """Evidence forbids the axle a disc of the body's radius less this: passages that the
    robot just fits through must stay open in a map of 2 cm cells."""
    infrared_trust_m: float = 0.22
    """Farther readings are too noisy to map with."""
    perimeter_gap_m: float = 0.0005
    """Between rim and wall on an outline; 5 mm cost 1-2 % of what is sweepable. Not 0: who presses
    on slides aside, which no wheel tells."""
    stop_range_m: float = 0.048
    """Ultrasonic reading at which a lane ends: 8 mm between rim and wall."""
    margin_m: float = 0.5
    """Floor this far beyond what was driven over is believed to exist."""
    back_off_m: float = 0.015
    cliff_back_off_m: float = 0.03
    """From an edge, again and again until there is floor ahead."""
    fresh_share: float = 0.15
    """An outline ends where less than this of the mouth's next way is unswept."""
    min_cells: int = 7
    """A lane must promise this many new cells: 28 cm²."""
    min_rate: float = 15.0
    """... and this many per second of all it takes; at full mouth a lane gives 70."""
    hole_rate: float = 1.0
    """This many are enough where a disc of 4 cm would be left: slivers are not gone back for, a
    hole is."""
    gap_cells: int = 14
    """A lane goes on over so many cells with nothing new."""
    frontier: float = 2.0
    """Cells that a cell's edge of new frontier costs: so that no slivers are left."""
    perimeter_cells: float = 500.0
    """What beginning an outline is taken to promise."""
    perimeter_pace: float = 1.2
    """Times the robot's cruise speed, along a wall that is straight. A bend is followed at the
    cruise speed: the ultrasonic looks past what stands behind it."""
    lane_speed_m_s: float = 0.28
    travel_speed_m_s: float = 0.28
    turn_s_rad: float = 0.85
    stop_s: float = 0.9
    """Prices of a turn and a stop. With 0.62 and 0.7, as legs that flow cost, runs are as long."""
    looks: tuple[int, ...] = (1100, 2600, 1 << 24)
    """Ways up to these costs (1 m is 500) are looked at, one after the other ..."""
    near_rate: float = 30.0
    """... and taken without looking farther if they give this many cells per second."""
    slice_cells: int = 50_000
    """Work of a search in one control step, in cells: about 2 ms. On a larger floor the robot
    stands for some steps."""
    tries: int = 2
    """A place that so often gave nothing is set aside."""
    heading_fix_apart_s: float = 20.0
    """Least time between two heading fixes, s; it doubles after each that did not help."""
    max_decisions: int = 4000

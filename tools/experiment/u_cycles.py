"""The paper's test of path keeping (section 5.1, Figs. 14 and 15): U-shaped cycles as legs.

A cycle is a lane, a side step, the lane back and a side step. Fig. 15 of the paper shows the
distance of the robot from the planned end of each cycle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Leg, Turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

PAPER_CYCLES = 7
"""Number of cycles in the paper's test."""
PAPER_LANE_M = 1.77
"""Length of a lane, m. The paper does not give the length. It is chosen so that seven cycles with
side steps of 0.16 m have 27 m, the distance that the paper's robot drives in 160 s."""


class CycleOffset(NamedTuple):
    """One point of Fig. 15: true pose minus planned pose at the end of a cycle."""

    cycle: int
    """Number of the cycle, from 1."""
    time_s: float
    """Time at the end of the cycle, s."""
    along_m: float
    """Offset along the lanes, m."""
    across_m: float
    """Offset across the lanes, m, positive in the direction of the side steps."""
    heading_rad: float
    """Offset of the heading, rad."""

    @property
    def offset_m(self) -> float:
        """Distance from the planned position, m."""
        return math.hypot(self.along_m, self.across_m)


class UCycles:
    """Plan of U-shaped cycles from a start pose, with side steps to the left."""

    def __init__(
        self,
        start: Pose2,
        *,
        cycles: int = PAPER_CYCLES,
        lane_m: float = PAPER_LANE_M,
        step_m: float = 0.16,
    ) -> None:
        """Plan lanes along the heading of the start.

        Args:
            start: pose at the start of the first lane.
            cycles: number of cycles.
            lane_m: length of a lane, m.
            step_m: length of a side step, m.

        Raises:
            ValueError: a length or the number is not positive.

        """
        if cycles < 1 or not lane_m > 0.0 or not step_m > 0.0:
            raise ValueError(
                f"cycles, lane and step must be positive, not {cycles}, {lane_m}, {step_m}"
            )
        self.start, self.cycles = start, cycles
        self.lane_m, self.step_m = lane_m, step_m

    @property
    def path_m(self) -> float:
        """Path length of all cycles, m."""
        return 2.0 * self.cycles * (self.lane_m + self.step_m)

    def legs(self) -> Iterator[tuple[int, Leg]]:
        """Yield each leg with the number of complete cycles after it."""
        out = self.start.theta_rad
        aside, back = wrap_angle(out + 0.5 * math.pi), wrap_angle(out + math.pi)
        for cycle in range(self.cycles):
            yield cycle, Drive(out, self.lane_m, purpose="lane")
            yield cycle, Turn(aside)
            yield cycle, Drive(aside, self.step_m, purpose="step")
            yield cycle, Turn(back)
            yield cycle, Drive(back, self.lane_m, purpose="lane")
            yield cycle, Turn(aside)
            yield cycle, Drive(aside, self.step_m, purpose="step")
            yield cycle + 1, Turn(out)

    def end(self, cycle: int) -> Pose2:
        """Return the planned pose at the end of a cycle."""
        x_m, y_m = self.start.transform(0.0, 2.0 * cycle * self.step_m)
        return Pose2(x_m, y_m, self.start.theta_rad)

    def offsets(self, ends: Iterable[tuple[float, Pose2]]) -> list[CycleOffset]:
        """Return the points of Fig. 15 from time, s, and true pose at the end of each cycle."""
        found = []
        for cycle, (time_s, pose) in enumerate(ends, start=1):
            plan = self.end(cycle)
            dx, dy = pose.x_m - plan.x_m, pose.y_m - plan.y_m
            c, s = math.cos(plan.theta_rad), math.sin(plan.theta_rad)
            turn = wrap_angle(pose.theta_rad - plan.theta_rad)
            found.append(CycleOffset(cycle, time_s, dx * c + dy * s, dy * c - dx * s, turn))
        return found

"""The paper's test of path keeping (section 5.1, Fig. 14 and 15): U-shaped cycles, as legs.

One cycle is a lane, a step aside, the lane back and a step aside. Where a cycle should end is
known beforehand; how far the robot then stands from there is the paper's Fig. 15.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Leg, Turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

PAPER_CYCLES = 7
PAPER_LANE_M = 1.77
"""Not given; with it and steps of 0.16 m seven cycles are the 27 m of the paper's 160 s."""


class CycleOffset(NamedTuple):
    """One point of Fig. 15."""

    cycle: int
    """From 1."""
    time_s: float
    along_m: float
    """Where the robot is less where it should be, along the lanes."""
    across_m: float
    """The same across them, positive to the side that the steps go to."""
    heading_rad: float
    """Heading less the planned one."""

    @property
    def offset_m(self) -> float:
        """Distance from the planned place."""
        return math.hypot(self.along_m, self.across_m)


class UCycles:
    """Plan of some U-shaped cycles from a start pose, stepping to the left."""

    def __init__(
        self,
        start: Pose2,
        *,
        cycles: int = PAPER_CYCLES,
        lane_m: float = PAPER_LANE_M,
        step_m: float = 0.16,
    ) -> None:
        """Lanes along the start's heading.

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
        """Length of all cycles."""
        return 2.0 * self.cycles * (self.lane_m + self.step_m)

    def legs(self) -> Iterator[tuple[int, Leg]]:
        """Each leg with the number of cycles that are complete once it is done."""
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
        """Pose in which a cycle should end."""
        x_m, y_m = self.start.transform(0.0, 2.0 * cycle * self.step_m)
        return Pose2(x_m, y_m, self.start.theta_rad)

    def offsets(self, ends: Iterable[tuple[float, Pose2]]) -> list[CycleOffset]:
        """Fig. 15: from the time (s) and true pose at the end of each cycle, in order."""
        found = []
        for cycle, (time_s, pose) in enumerate(ends, start=1):
            plan = self.end(cycle)
            dx, dy = pose.x_m - plan.x_m, pose.y_m - plan.y_m
            c, s = math.cos(plan.theta_rad), math.sin(plan.theta_rad)
            turn = wrap_angle(pose.theta_rad - plan.theta_rad)
            found.append(CycleOffset(cycle, time_s, dx * c + dy * s, dy * c - dx * s, turn))
        return found

"""Rules by which the recovery planner abandons a path, a target, map evidence, or the plan."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

from bridge.motion.geometry import Pose2
from bridge.motion.legs import StopReason

if TYPE_CHECKING:
    from bridge.coverage.planner import PlannerReports
    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.coverage.recovery.search import Choice
    from bridge.coverage.recovery.window import Point
    from bridge.motion.legs import LegResult


class Verdict(Enum):
    """Decision of the planner before it executes a choice."""

    GO_ON = "go on"
    CLEARED = "evidence was cleared: choose again"
    ENCLOSED = "end the plan"


class StuckPolicy:
    """Decides which passages to close, and which targets and map evidence to abandon."""

    def __init__(
        self,
        options: RecoveryOptions,
        evidence_map: EvidenceMap,
        record: PlannerReports,
    ) -> None:
        """Begin without attempts."""
        self._options, self._geometry = options, evidence_map.geometry
        self._evidence_map, self._record = evidence_map, record
        self._fruitless = 0
        """Number of decisions in a row that swept almost nothing."""
        self._cleared = 0
        """Number of times that evidence was cleared since the last new floor."""
        self._cleared_at = 0
        """Number of new cells when evidence was cleared last."""
        self._bumps_cleared_at = -self._geometry.floor_cells
        """Number of new cells when evidence of bumps was cleared last."""
        self._blocks = 0
        """Number of blocks in a row at ``_blocked_at``."""
        self._blocked_at: Pose2 | None = None
        self._passages: list[tuple[Pose2, bool, int]] = []
        """Places where the robot sought a passage. Each has the side, and the number of new cells
        at that time."""
        self._left_path_at: Pose2 | None = None
        """Place where the robot left the present transit to seek a passage; None: not left."""

    def clear_bumps(self) -> bool:
        """Clear evidence that comes from bumps only. Return True if there was any.

        The planner calls this method before it ends.
        """
        if self._evidence_map.new_cells - self._bumps_cleared_at < self._geometry.floor_cells:
            return False
        self._bumps_cleared_at = self._evidence_map.new_cells
        if not self._evidence_map.clear_bumps(self._options.bump_radius_m * self._geometry.scale):
            return False
        self._blocks = self._fruitless = 0
        self._record.decide("clear", "before the end: evidence from bumps alone cleared")
        return True

    def judge(self, pose: Pose2, *, enclosed: bool, unreachable_at: Point | None) -> Verdict:
        """Decide whether to continue from a pose.

        Args:
            pose: the robot's pose.
            enclosed: the search found no start cell, or no path to visited places.
            unreachable_at: nearest visited place that the search could not reach, m.

        """
        stuck = self._fruitless >= self._options.max_fruitless or enclosed
        if not stuck and self._blocks <= self._options.max_blocked:
            return Verdict.GO_ON
        place = self._uncertain_place(pose, unreachable_at)
        self._blocks = 0
        if self._evidence_map.new_cells - self._cleared_at > self._geometry.floor_cells:
            self._cleared = 0
        if self._cleared < self._options.max_cleared:
            scale = self._geometry.scale
            radius_m = (
                self._options.clear_radius_m if stuck else self._options.blocked_radius_m
            ) * scale
            self._evidence_map.clear(place, radius_m, self._options.clear_radius_m * scale)
            self._record.decide(
                "clear",
                f"{'no target is reachable' if stuck else 'blocked repeatedly at one place'}: "
                "evidence cleared there",
                x_m=round(place.x_m, 3),
                y_m=round(place.y_m, 3),
            )
            self._fruitless, self._cleared_at = 0, self._evidence_map.new_cells
            self._cleared += 1
            return Verdict.CLEARED
        return Verdict.ENCLOSED if stuck else Verdict.GO_ON

    def begin_transit(self) -> None:
        """Discard the place where the robot left the last transit."""
        self._left_path_at = None

    def blocked(self, result: LegResult, heading_rad: float) -> None:
        """Handle a blocked transit. Each repeated block closes more of the passage in the map."""
        pose, last = result.pose, self._blocked_at
        again = last is not None and pose.distance_m(last) < self._geometry.same_place_m
        self._blocks = self._blocks + 1 if again else 1
        self._blocked_at = pose
        if self._blocks >= self._options.blocks_to_close:
            radius_m = min(self._options.closed_m * self._blocks, self._geometry.radius_m)
            c, s = math.cos(heading_rad), math.sin(heading_rad)
            ahead_m = radius_m + self._geometry.cell_m
            self._evidence_map.block(pose.x_m + ahead_m * c, pose.y_m + ahead_m * s, radius_m)
            self._record.decide(
                "passage-shut",
                "path closed: blocked twice at one place",
                x_m=round(pose.x_m, 3),
                y_m=round(pose.y_m, 3),
                times=self._blocks,
            )

    def seeks_passage(self, result: LegResult, new_m2: float) -> bool:
        """Return True if the robot should follow the obstacle, as in the Bug algorithms.

        A wall leads the robot to the edge of a door and through the door, even if the map shows the
        door in a wrong place (Lumelsky and Stepanov 1987). The robot follows the obstacle at a
        place once per side. It may follow it again after it has swept new floor.

        Args:
            result: end of the blocked transit.
            new_m2: expected new floor at the target, m².

        """
        left, right = result.bumper_left, result.bumper_right
        if result.reason is not StopReason.BUMPER or left == right:
            return False
        if self._blocks < self._options.blocks_to_close or new_m2 <= self._geometry.worth_m2:
            return False
        pose, floor = result.pose, self._evidence_map.new_cells
        bearing, rim_m = self._evidence_map.bearing_rad(result), self._geometry.radius_m
        contact = pose.transform(rim_m * math.cos(bearing), rim_m * math.sin(bearing))
        wall_cells = self._evidence_map.count_occupied(*contact, self._options.wall_m)
        if wall_cells < self._geometry.min_wall_cells:
            return False
        for before, side, cells in self._passages:
            same_place = side == left and before.distance_m(pose) < self._geometry.same_place_m
            if same_place and floor - cells < self._geometry.floor_cells:
                return False
        self._passages.append((pose, left, floor))
        self._left_path_at = pose
        self._record.decide(
            "passage-sought", "perimeter pass along the obstacle that blocked the path"
        )
        return True

    def take(self, choice: Choice, new_cells: int, pose: Pose2, *, arrived: bool) -> None:
        """Rate the result of a choice.

        Args:
            choice: The executed choice.
            new_cells: Number of cells that it swept.
            pose: Pose at the end of the choice.
            arrived: True if the robot reached the start of the choice.

        """
        self._judge_target(choice, new_cells, pose, arrived=arrived)
        fruitless = new_cells < self._geometry.min_cells
        self._fruitless = self._fruitless + 1 if fruitless else 0

    def _judge_target(self, choice: Choice, new_cells: int, pose: Pose2, *, arrived: bool) -> None:
        """Count a fruitless attempt at a target. Abandon the target after several attempts.

        A block far from the target does not count against the target, because there may be another
        path. :meth:`blocked` handles it.
        """
        promised = choice.new_m2 / self._geometry.cell_m**2
        if choice.kind == "perimeter":
            promised = self._geometry.fruitful_cells
        if new_cells > self._options.fruitless_share * promised:
            return
        x, y = choice.path[-1]
        far = (
            math.dist((self._left_path_at or pose)[:2], (x, y))
            > self._options.far_m * self._geometry.scale
        )
        if far and not arrived and self._fruitless < self._options.patient_decisions:
            return
        c, s = math.cos(choice.heading_rad), math.sin(choice.heading_rad)
        done_m = 0.0
        if arrived:  # floor beyond an obstacle may be reachable on another path
            done_m = min(max((pose.x_m - x) * c + (pose.y_m - y) * s, 0.0), choice.length_m)
        at_m, width_m = 0.0, self._geometry.width_m
        if choice.kind == "lane":  # the mouth may be ahead of the axle
            x, y = x + self._geometry.ahead_m * c, y + self._geometry.ahead_m * s
        while at_m <= done_m:
            self._evidence_map.abandon(x + at_m * c, y + at_m * s, 0.5 * width_m)
            at_m += width_m
        reason = (
            "target abandoned: almost nothing gained" if arrived else "target abandoned: no path"
        )
        self._record.decide("abandon", reason, x_m=round(x, 3), y_m=round(y, 3))

    def _uncertain_place(self, pose: Pose2, unreachable_at: Point | None) -> Pose2:
        """Return the place at which the evidence is probably wrong."""
        if unreachable_at is not None:
            return Pose2(*unreachable_at, 0.0)
        if self._blocks > self._options.max_blocked and self._blocked_at is not None:
            return self._blocked_at
        return pose

"""The paper's algorithm without changes: U-shaped lanes and one memory slot (section 3.2).

This planner is the reference for comparisons. Do not improve it: it must fail where the paper's
algorithm fails. The paper does not define every detail. Each such detail is an option. The defaults
reproduce the paper's tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bridge.coverage.baselines.lanes import LaneOptions, LaneSweep
from bridge.coverage.planner import ScriptedPlanner
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import GoTo, Leg, LegResult

if TYPE_CHECKING:
    from collections.abc import Generator

    from bridge.coverage.planner import Script, Step
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class PaperOptions(LaneOptions):
    """Options for details that the paper does not define."""

    equal_tolerance_m: float = 0.02
    """Maximum difference of D and Prev-D in case 1, m. Real lanes never have exactly equal
    lengths."""
    count_turns: Literal["whole_step", "every_turn", "on_equal"] = "whole_step"
    """Condition under which the turn count T grows. Pseudo-code 1 counts after "turn, move distance
    W, turn". This may mean every turn (``every_turn``) or a complete step of W (``whole_step``).
    W·T equals the distance of the side steps only with ``whole_step``. Pseudo-code 2 counts in case
    1 only (``on_equal``). This counts one lane too few after case 2."""
    between: Literal["count", "keep", "reset"] = "count"
    """Effect on T if tolerance < |D - Prev-D| ≤ Φ, with ``count_turns="on_equal"``. The paper does
    not define this. ``count`` treats it as case 1."""
    clear_after_recovery: bool = True
    """True: set T to 0 after the recovery of case 3. If False, a second case 3 without a case 2
    between counts the same lanes again."""
    recovery_lanes: Literal["unobserved", "observed"] = "unobserved"
    """``observed``: D, Prev-D and T also follow the lanes inside the occluded region. The algorithm
    has only one memory slot, so a second obstacle in that region overwrites the first one's
    values."""
    return_by: Literal["leave_point", "nearest"] = "leave_point"
    """Place at which the sweep continues after recovery. ``leave_point``: the place of case 3.
    ``nearest``: the end of the last lane in the occluded region."""


class PaperPlanner(ScriptedPlanner):
    """Sweeps with the paper's cases 1 to 3. D and Prev-D are the lengths of the last two lanes.

    Case 1, D = Prev-D: increase the turn count T. Case 2, D + Φ < Prev-D: an obstacle has shortened
    the lane; restart the count. Case 3, D - Φ > Prev-D: the robot has passed the obstacle, and the
    occluded region has Length = W·T. The robot drives back by Length against the stepping
    direction. It sweeps the region up to the lane from which it drove back, and continues.
    """

    def __init__(self, model: RobotModel, options: PaperOptions | None = None) -> None:
        """Create the planner. The plan begins when ``start`` is called."""
        super().__init__(model)
        self.options = options or PaperOptions()
        self._sweep = LaneSweep(model, self.options, Pose2(0.0, 0.0, 0.0))
        self._first_lane = True

    def script(self, obs: Observation) -> Script:
        """Return the plan from the pose in ``obs``."""
        width = self.model.cleaning_width_m
        self._sweep = LaneSweep(self.model, self.options, obs.pose)
        self._first_lane = True
        heading = obs.pose.theta_rad
        self.record.decide("start", "lanes along the start heading", side=self.options.side)
        while True:
            self.record.change(state="lane")
            lane = yield from self._sweep.lane(heading)
            case = self._compare(lane)
            if case == 3:  # noqa: PLR2004 - the paper's own number
                yield from self._recover(heading, lane)
            self.record.change(state="step", target=None)
            step = yield from self._sweep.side_step(lane.pose, width)
            blocked = self._sweep.is_short(step)
            if blocked:
                self._report_blocked(step)
            reason = self._sweep.stuck(lane, blocked=blocked)
            if reason is not None:
                return reason
            counting = self.options.count_turns
            if counting == "every_turn" or (counting == "whole_step" and not blocked):
                self.record.change(turn_count=self.record.state.turn_count + 1)
            heading = wrap_angle(heading + math.pi)

    # -- the three cases -------------------------------------------------------------------

    def _compare(self, lane: LegResult) -> int:
        """Record D, compare it with Prev-D and update T. Return the case; 0: no case applies."""
        options, state = self.options, self.record.state
        distance = lane.distance_m
        previous = distance if self._first_lane else state.previous_lane_distance_m
        self._first_lane = False
        diameter = self.model.robot_diameter_m
        turns = state.turn_count
        length = state.length_m
        counting = options.count_turns == "on_equal"
        if distance + diameter < previous:
            case, turns = 2, 0
            reason = "D + Φ < Prev-D: an obstacle, T starts again"
        elif distance - diameter > previous:
            case, length = 3, self.model.cleaning_width_m * turns
            reason = "D - Φ > Prev-D: past an obstacle, its occluded Length = W·T"
        elif abs(distance - previous) <= options.equal_tolerance_m:
            case, turns = 1, turns + counting
            reason = "D = Prev-D: the lanes are equally long"
        else:
            case = 0
            if counting:
                turns = {"count": turns + 1, "keep": turns, "reset": 0}[options.between]
            reason = "D and Prev-D differ, by less than Φ: none of the cases"
        self.record.change(
            turn_count=turns,
            lane_distance_m=distance,
            previous_lane_distance_m=distance,
            length_m=length,
            case=case,
        )
        self.record.decide(
            "lane",
            reason,
            case=case,
            ended=str(lane.reason),
            distance_m=distance,
            previous_m=previous,
            turns=turns,
        )
        return case

    # -- recovery of the occluded region ---------------------------------------------------

    def _recover(self, heading: float, lane: LegResult) -> Generator[Leg, Step]:
        """Drive back by Length, sweep the region up to the lane of case 3, and return to it."""
        leave = lane.pose
        length = self.record.state.length_m
        width = self.model.cleaning_width_m
        self.record.decide(
            "recovery-begin",
            "return to the occluded region",
            length_m=length,
            x_m=leave.x_m,
            y_m=leave.y_m,
        )
        if length > 0.0:
            self.record.change(state="recovery-back")
            line_m = self._sweep.line_m
            back = yield from self._sweep.side_step(leave, -length)
            if self._sweep.is_short(back):
                self._report_blocked(back)
            pose = yield from self._sweep_occlusion(
                wrap_angle(heading + math.pi), back.pose, self._sweep.offset_m(leave) - 0.5 * width
            )
            if self.options.return_by == "leave_point":
                yield from self._return_to(leave, pose)
                self._sweep.line_m = line_m
        if self.options.clear_after_recovery:
            self.record.change(turn_count=0)
        self.record.decide("recovery-end", "occluded region swept as far as possible")

    def _sweep_occlusion(
        self,
        heading: float,
        pose: Pose2,
        until_m: float,
    ) -> Generator[Leg, Step, Pose2]:
        """Sweep lanes from the pose until the side step reaches ``until_m``.

        A blocked side step ends it as ``LaneOptions.end`` defines.
        """
        width = self.model.cleaning_width_m
        self._sweep.blocked_steps = 0
        while self._sweep.offset_m(pose) < until_m:
            self.record.change(state="recovery-lane")
            lane = yield from self._sweep.lane(heading)
            if self.options.recovery_lanes == "observed":
                self._compare(lane)
            else:
                self.record.decide(
                    "recovery-lane",
                    f"lane in the occluded region ended: {lane.reason}",
                    distance_m=lane.distance_m,
                )
            self.record.change(state="recovery-step")
            step = yield from self._sweep.side_step(lane.pose, width)
            pose = step.pose
            blocked = self._sweep.is_short(step)
            if blocked:
                self._report_blocked(step)
            if self._sweep.stuck(lane, blocked=blocked) is not None:
                break
            heading = wrap_angle(heading + math.pi)
        self._sweep.blocked_steps = 0
        return pose

    def _return_to(self, leave: Pose2, pose: Pose2) -> Generator[Leg, Step]:
        """Drive back to the place of case 3, or until an obstacle blocks the robot."""
        if leave.distance_m(pose) < self.options.short_step_m:
            return
        self.record.change(state="recovery-return", target=(leave.x_m, leave.y_m))
        leg = GoTo(leave.x_m, leave.y_m, stop_range_m=self._sweep.stop_range_m, purpose="return")
        step = yield leg
        if step.result.reason.blocked:
            self._report_blocked(step.result)
        yield from self._sweep.back_off(step.obs.pose.theta_rad, step.result)

    def _report_blocked(self, result: LegResult) -> None:
        self.record.decide(
            "blocked",
            f"{result.leg.purpose} ended early: {result.reason}",
            distance_m=result.distance_m,
        )

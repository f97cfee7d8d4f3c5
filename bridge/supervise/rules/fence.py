"""Condition on the position: the robot stays inside a radius and a polygon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.floor_plan.floor_plan import contains

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import FenceRule


class Fence:
    """The robot is outside its fence."""

    grave = False
    _pose: Pose2
    _how: str

    def __init__(self, rule: FenceRule) -> None:
        """Set the fence."""
        self._rule = rule
        self._start: Pose2 | None = None

    def restart(self) -> None:
        """Keep the fence and its centre."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Compare the estimated pose with the fence."""
        del measured
        rule = self._rule
        pose = self._pose = inputs.pose
        if self._start is None:
            self._start = pose
        if 0.0 < rule.radius_m < self._start.distance_m(pose):
            self._how = f"more than {rule.radius_m:g} m from its start"
            return True
        if rule.polygon and not contains(rule.polygon, pose.x_m, pose.y_m):
            self._how = "outside the fence"
            return True
        return False

    def evidence(self) -> Evidence:
        """Return the position."""
        data: dict[str, Scalar] = {
            "x_m": round(self._pose.x_m, 3),
            "y_m": round(self._pose.y_m, 3),
        }
        return f"the robot is {self._how}", data

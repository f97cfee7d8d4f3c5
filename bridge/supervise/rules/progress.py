"""Condition on progress: the robot leaves a small square within a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import ProgressRule


class Progress:
    """The robot has not left a small square for a long time."""

    grave = False
    _box: tuple[float, float, float, float]

    def __init__(self, rule: ProgressRule) -> None:
        """Set the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Start a new square at the next step."""
        self._since_s: float | None = None

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Extend the square to the pose; start a new square if it is larger than the limit."""
        del measured
        x, y, _ = inputs.pose
        if self._since_s is None:
            self._since_s, self._box = inputs.time_s, (x, y, x, y)
        left, low, right, high = self._box
        left, low, right, high = min(left, x), min(low, y), max(right, x), max(high, y)
        self._box = left, low, right, high
        if max(right - left, high - low) > self._rule.min_side_m:
            self._since_s, self._box = inputs.time_s, (x, y, x, y)
        self._for_s = inputs.time_s - self._since_s
        return self._for_s > self._rule.window_s

    def evidence(self) -> Evidence:
        """Return the duration."""
        side_cm = 100.0 * self._rule.min_side_m
        text = f"the robot stayed within {side_cm:.0f} cm for {self._for_s:.0f} s"
        return text, {"for_s": round(self._for_s, 1), "min_side_m": self._rule.min_side_m}

"""Conditions of plug-ins. A condition that raises an exception is disabled and reported."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.supervise.settings import RULE_PLUGINS

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Condition, Evidence
    from bridge.supervise.settings import PluggedRule

_PARTS = ("grave", "holds", "evidence", "restart")
"""Attributes and methods that a condition must have."""


class PluggedCondition:
    """The condition of a plug-in's rule."""

    def __init__(self, name: str, rule: PluggedRule, model: RobotModel) -> None:
        """Create the rule's condition."""
        self.grave = False
        self._name = name
        self._evidence: Evidence = ("", {})
        self._report: str | None = None
        self._condition: Condition | None = None
        try:
            condition: Any = rule.condition(model)
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
            self._disable(error)
            return
        lacks = [part for part in _PARTS if not hasattr(condition, part)]
        if lacks:
            self._disable(TypeError(f"its condition lacks {', '.join(lacks)}"))
        else:
            self._condition = condition

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Evaluate a control step."""
        condition = self._condition
        if condition is None:
            return False
        try:
            if not condition.holds(inputs, measured):
                return False
            text, data = condition.evidence()
            self._evidence, self.grave = (str(text), dict(data)), bool(condition.grave)
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
            self._disable(error)
            return False
        return True

    def evidence(self) -> Evidence:
        """Return the finding of the last step."""
        return self._evidence

    def restart(self) -> None:
        """Discard the state from before a gap."""
        if self._condition is not None:
            try:
                self._condition.restart()
            except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
                self._disable(error)

    def take_report(self) -> str | None:
        """Return the reason once after the condition was disabled, else None."""
        report, self._report = self._report, None
        return report

    def _disable(self, error: Exception) -> None:
        self._condition, self.grave = None, False
        plugin = RULE_PLUGINS.get(self._name, f"rule {self._name!r}")
        self._report = f"{plugin} raised {type(error).__name__}: {error}; it is disabled"

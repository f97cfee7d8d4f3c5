"""A rule of supervision: the robot has driven farther than it should in one run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.supervise.settings import Level, PluggedRule, limited

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence


@dataclass(frozen=True, slots=True)
class TooFar(PluggedRule):
    """The robot has driven too far in one run."""

    reaction: Level = Level.REPORT
    then: Level = Level.REPORT
    distance_m: float = limited(500.0, 1.0, 100_000.0, "m", "distance driven")

    def condition(self, model: RobotModel) -> Condition:
        """What detects it; ``model`` is the robot."""
        del model
        return Condition(self.distance_m)


class Condition:
    """Evaluated at each control step."""

    grave = False

    def __init__(self, distance_m: float) -> None:
        self._limit_m, self._driven_m = distance_m, 0.0

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Whether the robot has driven farther than the limit."""
        del inputs
        self._driven_m = measured.travel_m
        return self._driven_m > self._limit_m

    def evidence(self) -> Evidence:
        """Return the findings, for people and for the log."""
        text = f"driven {self._driven_m:.1f} m, more than {self._limit_m:g} m"
        return text, {"driven_m": self._driven_m}

    def restart(self) -> None:
        """Nothing to discard: the distance counts on."""

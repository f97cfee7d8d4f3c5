"""The supervisor: evaluates the rules over time and returns reactions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.supervise.inputs import Reaction
from bridge.supervise.measured import Measured
from bridge.supervise.rules.bodily import Bump, Cliff, Lifted, Tilt
from bridge.supervise.rules.electric import Battery, Reset, Sensor, Silence, Stall
from bridge.supervise.rules.fence import Fence
from bridge.supervise.rules.planner_check import PlannerCheck
from bridge.supervise.rules.plugged import PluggedCondition
from bridge.supervise.rules.progress import Progress
from bridge.supervise.rules.slip import Slip
from bridge.supervise.settings import Level, PluggedRule, default_settings

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.rules.conditions import Condition
    from bridge.supervise.settings import Rule, SuperviseSettings

CALM_S = 1.0
"""Time without the condition after which the next detection is a new occurrence, s."""


class _Graded:
    """One rule and the state of its current occurrence."""

    __slots__ = ("_calm_s", "_done_s", "_since_s", "active", "condition", "done", "kind", "rule")
    _since_s: float
    """Start of the condition, s."""
    _calm_s: float
    """Last time at which the condition held, s."""
    _done_s: float
    """Time of the last reaction, s."""

    def __init__(self, kind: str, rule: Rule, condition: Condition) -> None:
        self.kind, self.rule, self.condition = kind, rule, condition
        self.forget()

    def forget(self) -> None:
        """End the current occurrence."""
        self.active = False
        self.done = Level.OFF
        """Most severe reaction to this occurrence so far."""

    def due(self, now_s: float, *, holds: bool) -> Level:
        """Return the reaction that is due; ``OFF``: none."""
        rule = self.rule
        if not holds:
            if self.done is Level.OFF or now_s - self._calm_s >= CALM_S:
                self.forget()
            return Level.OFF
        if not self.active:
            self.active, self._since_s = True, now_s
        self._calm_s = now_s
        due = self.done
        if due is Level.OFF:
            if now_s - self._since_s >= rule.after_s:
                due = rule.reaction
        elif now_s - self._done_s >= rule.then_s:
            due = max(due, rule.then)
        if self.condition.grave:
            due = max(due, rule.reaction, rule.then)
        if due is self.done:
            return Level.OFF
        self.done, self._done_s = due, now_s
        return due


class Supervisor:
    """Supervises one run; call :meth:`step` at every control step."""

    _held_s: float
    """Start of the current pause, s."""

    def __init__(self, model: RobotModel, settings: SuperviseSettings | None = None) -> None:
        """Create the rules of ``settings``; None: the defaults."""
        self.settings = settings = settings or default_settings()
        self.holding = False
        """True from a ``PAUSE`` until :meth:`resume`. No motion is allowed in this time."""
        self._measured = Measured(model)
        self._slow_until_s = -math.inf
        self._now_s = -math.inf
        made: dict[str, Condition] = {
            "stall": Stall(settings.stall),
            "slip": Slip(settings.slip),
            "tilt": Tilt(settings.tilt),
            "lifted": Lifted(),
            "bump": Bump(settings.bump),
            "cliff": Cliff(settings.cliff),
            "battery": Battery(settings.battery),
            "silence": Silence(settings.silence),
            "progress": Progress(settings.progress),
            "fence": Fence(settings.fence),
            "disagreement": PlannerCheck(settings.disagreement, model),
            "sensor": Sensor(),
            "reset": Reset(),
        }
        self._plugged = {
            kind: PluggedCondition(kind, rule, model)
            for kind, rule in settings.rules.items()
            if isinstance(rule, PluggedRule)
        }
        made |= self._plugged
        self._graded = [
            _Graded(kind, rule, made[kind])
            for kind, rule in settings.rules.items()
            if rule.reaction is not Level.OFF
        ]

    @property
    def factor(self) -> float:
        """Current factor of all speeds."""
        return self.settings.slow_factor if self._now_s < self._slow_until_s else 1.0

    def restart(self) -> None:
        """Restart all rules after a loss of the link or after the robot was moved by hand."""
        self._measured.restart()
        for graded in self._graded:
            graded.condition.restart()
            graded.forget()

    def resume(self, now_s: float) -> None:
        """End a pause after the operator's check. Conditions that persist are detected again."""
        self.holding = False
        self._now_s = now_s
        self.restart()

    def step(self, inputs: RuleInputs) -> list[Reaction]:
        """Evaluate a control step; return the reactions, most severe last."""
        self._now_s = now_s = inputs.time_s
        measured = self._measured
        measured.step(inputs)
        reactions: list[Reaction] = []
        for graded in self._graded:
            holds = graded.condition.holds(inputs, measured)
            if not holds and not graded.active:
                continue  # the usual case
            level = graded.due(now_s, holds=holds)
            if holds and graded.done is Level.SLOW:
                self._slow_until_s = now_s + self.settings.slow_for_s
            if level is not Level.OFF:
                text, data = graded.condition.evidence()
                factor = self.settings.slow_factor if level is Level.SLOW else 1.0
                reactions.append(Reaction(graded.kind, level, text, data, factor))
                if level is Level.PAUSE and not self.holding:
                    self.holding, self._held_s = True, now_s
        if self.holding and now_s - self._held_s > self.settings.pause_limit_s:
            self.holding = False
            text = f"paused for {self.settings.pause_limit_s:g} s without a resume by the operator"
            reactions.append(Reaction("pause", Level.STOP, text, {}))
        for kind, condition in self._plugged.items():
            report = condition.take_report()
            if report is not None:
                reactions.append(Reaction(kind, Level.REPORT, report, {}))
        reactions.sort(key=lambda reaction: reaction.level)
        return reactions

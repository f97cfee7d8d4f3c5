"""Joins the rules: conditions over time to reactions, and what pauses and slow driving come to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.supervise.inputs import Reaction
from bridge.supervise.measured import GAP_S, Measured
from bridge.supervise.rules.bodily import Bump, Cliff, Fence, Lifted, Progress, Tilt
from bridge.supervise.rules.electric import Battery, Reset, Sensor, Silence, Stall
from bridge.supervise.rules.planner_check import PlannerCheck
from bridge.supervise.rules.slip import Slip
from bridge.supervise.settings import Level, SuperviseSettings

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.rules.conditions import Condition
    from bridge.supervise.settings import Rule

CALM_S = 1.0
"""So long without its condition, and what comes next is a new occasion."""


class _Graded:
    """One rule's condition over time."""

    __slots__ = ("_calm_s", "_done_s", "_since_s", "active", "condition", "done", "kind", "rule")
    _since_s: float
    """When the condition began to hold,"""
    _calm_s: float
    """when it last held,"""
    _done_s: float
    """and when there was last a reaction."""

    def __init__(self, kind: str, rule: Rule, condition: Condition) -> None:
        self.kind, self.rule, self.condition = kind, rule, condition
        self.forget()

    def forget(self) -> None:
        """No occasion is under way."""
        self.active = False
        self.done = Level.OFF
        """The gravest reaction to this occasion so far."""

    def due(self, now_s: float, *, holds: bool) -> Level:
        """The reaction that is due now; ``OFF``: none."""
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
    """Watches one run; :meth:`step` at every control step of it."""

    _held_s: float
    """When the present pause began."""

    def __init__(self, model: RobotModel, settings: SuperviseSettings | None = None) -> None:
        """Begin with the first step."""
        self.settings = settings = settings or SuperviseSettings()
        self.holding = False
        """True from a ``PAUSE`` until :meth:`resume`: nothing may move."""
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
        self._graded = [
            _Graded(kind, rule, made[kind])
            for kind, rule in settings.rules.items()
            if rule.reaction is not Level.OFF
        ]

    @property
    def factor(self) -> float:
        """What speeds are to be scaled by now."""
        return self.settings.slow_factor if self._now_s < self._slow_until_s else 1.0

    def restart(self) -> None:
        """The link was lost, or the robot was moved by hand: judge anew from the next step on."""
        self._measured.restart()
        for graded in self._graded:
            graded.condition.restart()
            graded.forget()

    def resume(self, now_s: float) -> None:
        """Somebody looked, and the robot may go on; what still holds is judged anew."""
        self.holding = False
        self._now_s = now_s
        self.restart()

    def step(self, inputs: RuleInputs) -> list[Reaction]:
        """Take a control step; what is to be done now, gravest last, nearly always nothing."""
        now_s = inputs.time_s
        if now_s - self._now_s > GAP_S:
            self._measured.restart()
        self._now_s = now_s
        measured = self._measured
        measured.step(inputs)
        reactions: list[Reaction] = []
        for graded in self._graded:
            holds = graded.condition.holds(inputs, measured)
            if not holds and not graded.active:
                continue  # nearly always
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
            text = f"paused for {self.settings.pause_limit_s:g} s, and nobody let it go on"
            reactions.append(Reaction("pause", Level.STOP, text, {}))
        reactions.sort(key=lambda reaction: reaction.level)
        return reactions

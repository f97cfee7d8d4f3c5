"""A run in a person's hands: a plan that is started, held and taken over, and a drive by hand.

One runner for the whole run, so that the device is asked once for leave to move. It decides
what drives: nothing, the plan, or the hand. Whatever else the run has - stops, staleness, the
orderly end - stays with :class:`bridge.run.mission.Mission`.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

from bridge.coverage.planner import PlannerEvent, PlannerState
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.observation import HALT, Observation, VelocityCommand

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.runner import PlanRunner
    from bridge.motion.robot_model import RobotModel
    from bridge.run.dead_man import DeadMan

_STEP_S = 0.02
_LOWPASS = 0.6


class Hand(Enum):
    """What drives now."""

    NOTHING = "nothing"
    PLAN = "plan"
    HELD = "held"
    """A plan that waits to go on."""
    MANUAL = "manual"


_STATES = {hand: PlannerState(hand.value) for hand in Hand}


class Operator:
    """The runner.

    What a person asks for may be called from another thread than the loop's, which steps it: a
    lock makes each call and each step whole.
    """

    def __init__(
        self,
        model: RobotModel,
        dead_man: DeadMan,
        *,
        plan: PlanRunner | None = None,
        make_plan: Callable[[], PlanRunner] | None = None,
        manual: bool = False,
    ) -> None:
        """With a ``plan`` it runs at once; ``make_plan`` makes one when it is asked for."""
        self.dead_man = dead_man
        self._plan, self._make_plan = plan, make_plan
        self._hand = Hand.PLAN if plan is not None else Hand.NOTHING
        if manual:
            self._hand = Hand.MANUAL
        self._target = HALT
        self._smooth_v = VelocitySmoother(model.max_accel_m_s2, _LOWPASS)
        self._smooth_w = VelocitySmoother(model.max_yaw_accel_rad_s2, _LOWPASS)
        self._events: list[PlannerEvent] = []
        self._lock = threading.RLock()
        if self._hand is Hand.MANUAL and self._plan is not None:
            self._plan.pause()

    # ---- what a person asks for -----------------------------------------------------------

    @property
    def hand(self) -> Hand:
        """What drives now."""
        return self._hand

    @property
    def has_plan(self) -> bool:
        """Whether there is a plan, or one could be made."""
        return self._plan is not None or self._make_plan is not None

    def start(self) -> None:
        """Let the plan drive, from its beginning or from where it was held."""
        made = None
        if self._plan is None and self._make_plan is not None:
            made = self._make_plan()  # without the lock: it takes seconds, and the loop goes on
        with self._lock:
            if self._plan is None:
                self._plan = made
            if self._plan is None:
                return
            self.dead_man.let_go()
            self._plan.resume()
            self._go(Hand.PLAN, "the plan drives")

    def pause(self) -> None:
        """Hold the plan; again: let it go on."""
        with self._lock:
            if self._hand is Hand.PLAN and self._plan is not None:
                self._plan.pause()
                self._go(Hand.HELD, "the plan is held")
            elif self._hand is Hand.HELD:
                self.start()

    def take_over(self) -> None:
        """Drive by hand; again: no more."""
        with self._lock:
            if self._hand is Hand.MANUAL:
                self.dead_man.let_go()
                held = self._plan is not None
                self._go(Hand.HELD if held else Hand.NOTHING, "no longer driven by hand")
                return
            if self._plan is not None:
                self._plan.pause()
            self._go(Hand.MANUAL, "driven by hand")

    def _go(self, hand: Hand, text: str) -> None:
        self._hand = hand
        self._events.append(PlannerEvent("operator", text))

    # ---- a runner -------------------------------------------------------------------------

    @property
    def finished(self) -> bool:
        """Whether the plan has ended."""
        return self._hand is Hand.PLAN and self._plan is not None and self._plan.finished

    @property
    def finish_reason(self) -> str | None:
        """Why it ended."""
        return None if self._plan is None else self._plan.finish_reason

    @property
    def turns(self) -> int:
        """Turns in place that the plan began."""
        return 0 if self._plan is None else self._plan.turns

    @property
    def lane_length_m(self) -> float:
        """Sum of the plan's lanes (eq. 8)."""
        return 0.0 if self._plan is None else self._plan.lane_length_m

    @property
    def state(self) -> PlannerState:
        """The plan's, or what drives instead."""
        if self._plan is None or self._hand is Hand.NOTHING:
            return _STATES[self._hand]
        if self._hand is Hand.PLAN:
            return self._plan.state
        return replace(self._plan.state, state=self._hand.value)

    @property
    def target(self) -> VelocityCommand:
        """The velocity wanted, before smoothing."""
        if self._hand is Hand.PLAN and self._plan is not None:
            return self._plan.target
        return self._target

    def step(self, obs: Observation) -> VelocityCommand:
        """The velocity for one control step."""
        with self._lock:
            return self._step(obs)

    def _step(self, obs: Observation) -> VelocityCommand:
        hand = self._hand
        if hand is Hand.PLAN and self._plan is not None:
            return self._plan.step(obs)
        if hand is not Hand.MANUAL:
            return self._halt()
        wanted = self.dead_man.wanted(obs.time_s)
        if wanted.v_m_s > 0.0 and (obs.bumper_left or obs.bumper_right or obs.cliff):
            wanted = VelocityCommand(0.0, wanted.yaw_rate_rad_s)  # backwards is the way out
        self._target = wanted
        if wanted == HALT:
            return self._halt()  # the device's own ramp is the quickest to rest
        return VelocityCommand(
            self._smooth_v.update(wanted.v_m_s, _STEP_S),
            self._smooth_w.update(wanted.yaw_rate_rad_s, _STEP_S),
        )

    def _halt(self) -> VelocityCommand:
        self._target = HALT
        self._smooth_v.reset()
        self._smooth_w.reset()
        return HALT

    def drain_events(self) -> list[PlannerEvent]:
        """Decisions since the last call."""
        with self._lock:
            events, self._events = self._events, []
        return events if self._plan is None else [*events, *self._plan.drain_events()]

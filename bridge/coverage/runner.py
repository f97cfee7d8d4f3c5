"""Runs a planner and the leg executor together, with one step per observation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.gyro_standstill import GyroStandstill
from bridge.coverage.planner import (
    ORIGINS,
    Finish,
    ObservingPlanner,
    Planner,
    PlannerError,
    PlannerEvent,
    PlannerState,
    check_leg,
    check_planner,
)
from bridge.motion.control.executor import LegExecutor
from bridge.motion.legs import Drive, Turn

if TYPE_CHECKING:
    from bridge.motion.control.tuning import MotionTuning
    from bridge.motion.observation import Observation, VelocityCommand
    from bridge.motion.robot_model import RobotModel

_MAX_DECISIONS = 16
"""Maximum number of legs in a row that end in the control step in which they begin. More such legs
mean an endless loop."""


class PlanRunner:
    """Runs a plan to its end: one call of ``step`` per observation.

    Before the first leg, during a pause and after the end, the robot brakes to standstill within
    the acceleration limits. Only ``step`` begins legs. Between two legs of a planner with
    ``observe``, the runner may stand still to measure the gyro bias.
    """

    def __init__(
        self,
        planner: Planner,
        model: RobotModel,
        tuning: MotionTuning | None = None,
    ) -> None:
        """Create a runner for a planner that has not started.

        Raises:
            PlannerError: the planner lacks a method. The robot has not moved.

        """
        check_planner(planner)
        self._planner = planner
        self._observing = planner if isinstance(planner, ObservingPlanner) else None
        self._executor = LegExecutor(model, tuning)
        self._standstill = GyroStandstill()
        self._standstills: list[PlannerEvent] = []
        self._started = False
        self._paused = False
        self._finish: Finish | None = None
        self._turns = 0
        self._legs = 0
        self._lane_length_m = 0.0

    @property
    def finished(self) -> bool:
        """True if the plan has ended."""
        return self._finish is not None

    @property
    def finish_reason(self) -> str | None:
        """Reason for the plan's end; None while the plan runs."""
        return None if self._finish is None else self._finish.reason

    @property
    def follows_plan(self) -> bool:
        """True: a plan drives the robot."""
        return True

    @property
    def turns(self) -> int:
        """Number of turns in place that were started."""
        return self._turns

    @property
    def legs(self) -> int:
        """Number of legs that were started."""
        return self._legs

    @property
    def lane_length_m(self) -> float:
        """Total length of the lanes, m: Σ d of the paper's eq. 8."""
        return self._lane_length_m

    @property
    def state(self) -> PlannerState:
        """State of the planner."""
        return self._planner.state

    @property
    def executor(self) -> LegExecutor:
        """The leg executor."""
        return self._executor

    @property
    def target(self) -> VelocityCommand:
        """Target velocity before smoothing."""
        return self._executor.target

    @property
    def paused(self) -> bool:
        """True if ``pause`` stops the plan."""
        return self._paused

    def drain_events(self) -> list[PlannerEvent]:
        """Return the planner's decisions and standstills since the last call, oldest first."""
        standstills, self._standstills = self._standstills, []
        return [*self._planner.drain_events(), *standstills]

    def pause(self) -> None:
        """Brake to standstill and wait until ``resume``. The current leg is not dropped."""
        self._paused = True

    def resume(self) -> None:
        """Continue the paused leg on its line."""
        self._paused = False

    def step(self, obs: Observation) -> VelocityCommand:
        """Return the velocity command for an observation.

        Raises:
            PlannerError: the planner returned an invalid leg.

        """
        executor = self._executor
        if self._paused or self._finish is not None:
            return executor.brake(obs)
        if self._observing is not None:
            self._observe(self._observing, obs)
        if self._started and not self._standstill.held:
            command = executor.step(obs)
            if executor.result is None:
                return command
        if self._observing is not None and self._holds(obs):
            return executor.brake(obs)
        for _ in range(_MAX_DECISIONS):
            self._decide(obs)
            if self.finished:
                return executor.brake(obs)
            command = executor.step(obs)
            if executor.result is None:
                return command
        self._finish = Finish("planner made no progress")
        return executor.brake(obs)

    def _holds(self, obs: Observation) -> bool:
        """Return True if the robot must stand still in this control step."""
        was_held = self._standstill.held
        if self._standstill.holds(obs) and not was_held:
            uncertainty_deg_s = round(math.degrees(obs.gyro_bias_sigma_rad_s), 4)
            reason = "the gyro bias is uncertain: a standstill measures it"
            self._standstills.append(
                PlannerEvent("rest", reason, {"uncertainty_deg_s": uncertainty_deg_s})
            )
        return self._standstill.held

    def _observe(self, observing: ObservingPlanner, obs: Observation) -> None:
        """Pass an observation to a planner that receives all observations."""
        try:
            if observing.observe(obs):
                self._executor.cancel(obs)
            self._executor.speed_limit_m_s = observing.speed_limit_m_s
        except Exception as error:
            self._blame(error)
            raise

    def _blame(self, error: Exception) -> None:
        """Add the planner's name to its exception, if the planner is not part of the project."""
        origin = ORIGINS.get(type(self._planner))
        if origin is not None:
            error.add_note(f"raised by {origin}")

    def _decide(self, obs: Observation) -> None:
        result = self._executor.result
        try:
            if not self._started or result is None:
                self._started = True
                leg = self._planner.start(obs)
            else:
                if isinstance(result.leg, Drive) and result.leg.purpose == "lane":
                    self._lane_length_m += abs(result.distance_m)
                leg = self._planner.next(result, obs)
        except Exception as error:
            self._blame(error)
            raise
        if isinstance(leg, Finish):
            self._finish = leg
            return
        check_leg(self._planner, leg)
        self._legs += 1
        if isinstance(leg, Turn):
            self._turns += 1
        try:
            self._executor.start(leg, obs)
        except ValueError as error:
            name = type(self._planner).__name__
            raise PlannerError(
                f"{name}: its leg {type(leg).__name__} is impossible: {error}"
            ) from None

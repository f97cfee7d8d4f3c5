"""The onboard mode: the device runs the planner itself, from its own readings.

It uses the same components as the host (estimator, wall corrections, plan runner), but without a
link between them. The gyro is read at 100 Hz and the rangers at 20 Hz. Wheel counts are read and
decisions are made at 50 Hz. The start frame has its origin at the robot's place at the start of the
plan; its x axis is the heading at the start.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from bridge.coverage.registry import PLANNERS, make_planner
from bridge.coverage.runner import PlanRunner
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.geometry import Pose2
from bridge.motion.legs import GoTo, Turn
from bridge.motion.observation import HALT, Observation, VelocityCommand
from protocol.imu import NOMINAL_GYRO_RAD_S
from protocol.messages.device import PlannerState
from protocol.messages.values import OnboardPlanner, PlannerPhase

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.device.sampling import Around, Sampler

AT_REST_US = 2_500_000
"""Time at rest before the first move, µs. The gyro bias is the mean of 250 samples in this time."""
STEP_TICKS = 2
_TEMPERATURE_C = 1.0 / 340.0
"""Scale of the temperature register, °C per count (MPU6050 register map, section 4.18). Only
temperature changes are used, so the offset is not needed."""
_ORIGIN = Pose2(0.0, 0.0, 0.0)
_NAMES = {
    OnboardPlanner.PAPER: "paper",
    OnboardPlanner.RECOVERY: "recovery",
    OnboardPlanner.U_SHAPE: "u-shape",
    OnboardPlanner.RANDOM: "random",
}
_PHASES = {
    "lane": PlannerPhase.LANE,
    "drive": PlannerPhase.LANE,
    "turn": PlannerPhase.TURN,
    "step": PlannerPhase.STEP,
    "transit": PlannerPhase.STEP,
    "heading-fix": PlannerPhase.STEP,
    "recovery-transit": PlannerPhase.RECOVERY_BACK,
    "recovery-back": PlannerPhase.RECOVERY_BACK,
    "recovery-lane": PlannerPhase.RECOVERY_LANE,
    "recovery-step": PlannerPhase.RECOVERY_LANE,
    "recovery-return": PlannerPhase.RECOVERY_RETURN,
}
"""Phase in the message for each phase name of a planner. Any other name is reported as a lane."""
_SPLIT_BY_TURN = {PlannerPhase.LANE, PlannerPhase.STEP}
"""Phases in which a turn in place is reported as a turn."""


def planner_name(number: int) -> str | None:
    """Return the name of the planner with this number; None if the number is unknown."""
    if number not in set(OnboardPlanner):
        return None
    name = _NAMES[OnboardPlanner(number)]
    return name if name in PLANNERS else None


class Onboard:
    """Runs one plan, from its start to its end."""

    def __init__(self, model: RobotModel, planner: str, seed: int, now_us: int) -> None:
        """Rest for 2.5 s to estimate the gyro bias, then begin the first leg.

        ``seed`` is for planners that use random numbers.

        Raises:
            UnknownPlannerError: no planner has this name.

        """
        self.planner = planner
        self.estimator = PoseEstimator(model, _ORIGIN)
        self._walls = Relocaliser(model, self.estimator)
        self._runner = PlanRunner(make_planner(planner, model, random.Random(seed)), model)
        self._move_us = now_us + AT_REST_US
        self._moving = False
        self._around: Around | None = None
        self._command = HALT
        self._end: PlannerPhase | None = None

    @property
    def finish_reason(self) -> str | None:
        """Reason why the plan has ended by itself; None while it runs."""
        return self._runner.finish_reason

    def pause(self) -> None:
        """Stop the robot; the estimator continues."""
        self._runner.pause()
        self._command = HALT

    def resume(self) -> None:
        """Continue from the pause."""
        self._runner.resume()

    def end(self) -> None:
        """End the plan after its last leg or at an abort."""
        done = self._runner.finished
        self._end = PlannerPhase.FINISHED if done else PlannerPhase.ABORTED
        self._command = HALT

    def step(
        self, tick: int, now_us: int, sampler: Sampler, around: Around | None
    ) -> VelocityCommand:
        """Run one control period: process the readings and return the velocity.

        ``around`` is None in periods without a range measurement.
        """
        t_s = now_us * 1e-6
        imu = sampler.imu_nominal
        self.estimator.on_imu(
            t_s, imu.gyro_z * NOMINAL_GYRO_RAD_S, temperature_c=imu.temperature * _TEMPERATURE_C
        )
        decides = tick % STEP_TICKS == 0
        if decides:
            self.estimator.on_encoders(t_s, *sampler.counts)
        if around is not None:
            self._around = around
            self._see_walls(around, t_s)
        if decides:
            self._decide(t_s, now_us, sampler)
        return self._command

    def _decide(self, t_s: float, now_us: int, sampler: Sampler) -> None:
        estimator = self.estimator
        if not self._moving or self._around is None:
            self._moving = now_us >= self._move_us
            return
        front_m, left_m, right_m = self._around[:3]
        bumper_left, bumper_right, cliff = sampler.contacts()
        self._command = self._runner.step(
            Observation(
                t_s,
                estimator.pose,
                estimator.v_m_s,
                estimator.yaw_rate_rad_s,
                front_m,
                left_m,
                right_m,
                bumper_left,
                bumper_right,
                cliff,
                estimator.gyro_bias_sigma_rad_s,
                self._walls.walls.heading_sigma_rad,
                estimator.lateral_sigma_m,
            )
        )

    def _see_walls(self, around: Around, t_s: float) -> None:
        """Update the estimate with observations of known walls."""
        if self._moving:
            self._walls.update(
                around.ultrasonic_m,
                around.infrared_left_m,
                around.infrared_right_m,
                bumper_left=around.bumper_left,
                bumper_right=around.bumper_right,
                t_s=t_s,
                ultrasonic_age_s=1e-6 * around.ultrasonic_age_us,
            )

    def drain_decisions(self) -> list[str]:
        """Return the planner's decisions since the last call, one line per decision."""
        return [f"{event.kind}: {event.reason}" for event in self._runner.drain_events()]

    # ---- reports -------------------------------------------------------------------------

    @property
    def phase(self) -> PlannerPhase:
        """Present phase of the planner."""
        if self._end is not None:
            return self._end
        if self._runner.paused:
            return PlannerPhase.PAUSED
        if not self._moving:
            return PlannerPhase.IDLE
        phase = _PHASES.get(self._runner.state.state, PlannerPhase.LANE)
        turning = isinstance(self._runner.executor.leg, Turn)
        return PlannerPhase.TURN if turning and phase in _SPLIT_BY_TURN else phase

    def message(self) -> PlannerState:
        """Return the paper's variables and the target point.

        Without a target, the point is the robot's position.
        """
        state = self._runner.state
        x_m, y_m = state.target or self._leg_target()
        return PlannerState(
            self.phase,
            state.turn_count & 0xFF,
            _millimetres(x_m),
            _millimetres(y_m),
            _unsigned(state.lane_distance_m, 0.001, 0xFFFF),
            _unsigned(state.previous_lane_distance_m, 0.001, 0xFFFF),
            _unsigned(state.length_m, 0.02, 0xFF),
            state.case,
        )

    def _leg_target(self) -> tuple[float, float]:
        leg = self._runner.executor.leg
        if isinstance(leg, GoTo):
            return leg.x_m, leg.y_m
        pose = self.estimator.pose
        return pose.x_m, pose.y_m


NO_PLAN = PlannerState(PlannerPhase.IDLE, 0, 0, 0, 0, 0, 0, 0)
"""State reported before the first plan."""


def _millimetres(value_m: float) -> int:
    return min(32767, max(-32768, round(value_m * 1000.0)))


def _unsigned(value: float, step: float, high: int) -> int:
    return min(high, max(0, round(abs(value) / step)))

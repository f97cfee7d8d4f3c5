"""The onboard mode: the device runs the planner itself, from its own readings.

The same parts as on the host (estimator, wall corrections, plan runner) without the wire
between: gyro at 100 Hz, wheel counts and decisions at 50 Hz, rangers at 20 Hz. Positions are in
the frame of the start: the robot stands at its origin, heading along x, as the plan is started.
"""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

from bridge.coverage.registry import PLANNERS, make_planner
from bridge.coverage.runner import PlanRunner
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.geometry import Pose2
from bridge.motion.legs import GoTo, Turn
from bridge.motion.observation import HALT, Observation, VelocityCommand
from protocol.messages.device import PlannerState
from protocol.messages.values import OnboardPlanner, PlannerPhase

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from sim_device.device.sampling import Around, Sampler

AT_REST_US = 2_500_000
"""At rest before the first move: the gyro's bias is averaged over 250 samples."""
STEP_TICKS = 2
_GYRO_RAD_S = math.radians(1.0 / 131.0)
"""MPU6050 at ±250 °/s: 131 LSB for a degree a second."""
_TEMPERATURE_C = 1.0 / 340.0
"""Of its temperature register (map, section 4.18); the offset does not matter here."""
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
"""A planner's own word for what it does, as the wire names it; any other is a lane."""
_SPLIT_BY_TURN = {PlannerPhase.LANE, PlannerPhase.STEP}
"""Within these a turn in place is told as one."""


def planner_name(number: int) -> str | None:
    """The planner of this number; None where this firmware has none such."""
    if number not in set(OnboardPlanner):
        return None
    name = _NAMES[OnboardPlanner(number)]
    return name if name in PLANNERS else None


class Onboard:
    """One plan, from its start to its end."""

    def __init__(self, model: RobotModel, planner: str, seed: int, now_us: int) -> None:
        """Start to rest; the first leg begins 2.5 s later. ``seed`` is for those that roll dice.

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
        """Why the plan ended by itself; None while it has not."""
        return self._runner.finish_reason

    def pause(self) -> None:
        """Hold still; the estimate goes on."""
        self._runner.pause()
        self._command = HALT

    def resume(self) -> None:
        """Go on where it was held."""
        self._runner.resume()

    def end(self) -> None:
        """Let go of the plan: it has finished, or is aborted."""
        done = self._runner.finished
        self._end = PlannerPhase.FINISHED if done else PlannerPhase.ABORTED
        self._command = HALT

    def step(
        self, tick: int, now_us: int, sampler: Sampler, around: Around | None
    ) -> VelocityCommand:
        """One control period: readings in, the velocity wanted out.

        ``around`` is given in the periods in which the rangers were sounded.
        """
        t_s = now_us * 1e-6
        imu = sampler.imu_nominal
        self.estimator.on_imu(
            t_s, imu.gyro_z * _GYRO_RAD_S, temperature_c=imu.temperature * _TEMPERATURE_C
        )
        decides = tick % STEP_TICKS == 0
        if decides:
            self.estimator.on_encoders(t_s, *sampler.counts)
        if around is not None:
            self._around = around
            self._see_walls(around)
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
            )
        )

    def _see_walls(self, around: Around) -> None:
        """Let walls that are seen again correct the estimate."""
        if self._moving:
            self._walls.update(
                around.ultrasonic_m,
                around.infrared_left_m,
                around.infrared_right_m,
                bumper_left=around.bumper_left,
                bumper_right=around.bumper_right,
            )

    def drain_decisions(self) -> list[str]:
        """What the planner decided since the last call, a line each."""
        return [f"{event.kind}: {event.reason}" for event in self._runner.drain_events()]

    # ---- what is told ---------------------------------------------------------------------

    @property
    def phase(self) -> PlannerPhase:
        """What the planner is doing."""
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
        """The paper's variables and the point driven to; the robot's own where there is none."""
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
"""Told until a plan is started."""


def _millimetres(value_m: float) -> int:
    return min(32767, max(-32768, round(value_m * 1000.0)))


def _unsigned(value: float, step: float, high: int) -> int:
    return min(high, max(0, round(abs(value) / step)))

"""Drives legs one after another: from observations to velocity commands, without I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.control.braking import Braking
from bridge.motion.control.hidden_ahead import HiddenAhead
from bridge.motion.control.point_to_point import PointToPointController
from bridge.motion.control.rotary import RotaryController
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.control.wall_follow import FollowState, Side, WallFollower
from bridge.motion.estimation.noise_monitor import RangingNoise
from bridge.motion.estimation.range_filter import RangeAhead
from bridge.motion.geometry import wrap_angle
from bridge.motion.legs import (
    Drive,
    Dwell,
    FollowWall,
    GoTo,
    Leg,
    LegResult,
    StopReason,
    Turn,
)
from bridge.motion.observation import HALT, Observation, VelocityCommand

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

_MIN_RADIUS_M = 1e-6
"""Lower bound of an arc's radius, m. It avoids a division by zero."""
_MIN_TURN_LIMIT_S = 15.0
"""Minimum time limit of a turn, s."""
_MAX_STEP_S = 0.1
"""Maximum time between control steps, s. Filters and timeouts ignore the time beyond it, for
example after a pause."""


class LegExecutor:
    """Executes legs.

    Call ``start`` with a leg. Then call ``step`` with every observation and send the returned
    command, until ``result`` is set. A bumper switch or a cliff ends a drive or an arc immediately,
    without a ramp. It does not end backward legs and turns in place, because they lead away from
    the obstacle; but see ``Turn.ends_at_cliff``. ``WallFollower`` decides whether a switch ends
    wall following.
    """

    def __init__(self, model: RobotModel, tuning: MotionTuning | None = None) -> None:
        """Begin at standstill, without a leg."""
        self._model = model
        self._tuning = tune = tuning or MotionTuning()
        self._brake = tune.braking.of(model.max_accel_m_s2)
        rate = tune.turn_rate_share * model.max_yaw_rate_rad_s
        brake_rad_s2 = tune.turn_brake_share * model.max_yaw_accel_rad_s2
        self._rotary = RotaryController(rate, brake_rad_s2, tune.rotary)
        self._flow_rad_s = tune.flow_rate_share * model.max_yaw_rate_rad_s
        self._flow = Braking(tune.flow_brake_share * model.max_yaw_accel_rad_s2, tune.braking.lag_s)
        self._point = PointToPointController(
            model.max_speed_m_s, rate, tune.turn_in_place_rad, tune.distance, tune.bearing
        )
        self._target = HALT
        self._smooth_v = VelocitySmoother(model.max_accel_m_s2, tune.lowpass)
        self._smooth_w = VelocitySmoother(model.max_yaw_accel_rad_s2, tune.lowpass)
        self._ranging = RangingNoise(tune.follow.ranging)
        self._ahead = RangeAhead(tune.range_ahead)
        self._hidden = HiddenAhead(model, self._brake, tune.hidden)
        self._wary_m_s = math.inf
        self.speed_limit_m_s = math.inf
        """Maximum forward speed that the planner allows at present, m/s."""
        self._leg: Leg | None = None
        self._result: LegResult | None = None
        self._last_s = 0.0

    # -- present knowledge ------------------------------------------------------------------

    @property
    def result(self) -> LegResult | None:
        """Result of the last leg; None while a leg runs."""
        return self._result

    @property
    def leg(self) -> Leg | None:
        """The running leg, or the last leg."""
        return self._leg

    # -- running ---------------------------------------------------------------------------

    @property
    def target(self) -> VelocityCommand:
        """Velocity before smoothing (the paper's Fig. 12)."""
        return self._target

    def start(self, leg: Leg, obs: Observation) -> None:
        """Begin a leg at the observed pose. If another leg is running, it is dropped."""
        self._leg = leg
        self._result = None
        self._stopping: StopReason | None = None
        self._elapsed_s = 0.0
        self._stopped_s = 0.0
        self._last_s = obs.time_s
        self._origin = obs.pose
        self._along_m = 0.0
        self._stood_s = 0.0
        self._mark_s = 0.0
        self._mark = 0.0
        self._bumped = (False, False)
        self._had_cliff = obs.cliff
        self._rotary.reset()
        self._point.reset()
        self._ahead.reset()
        if isinstance(leg, Turn):
            self._timeout_s = (
                self._turn_limit_s(leg, obs) if leg.timeout_s is None else leg.timeout_s
            )
            return
        if isinstance(leg, Dwell):
            self._timeout_s = math.inf
            return
        if isinstance(leg, FollowWall):
            self._timeout_s = leg.timeout_s
            side = Side.LEFT if leg.left else Side.RIGHT
            self._follower = WallFollower(
                self._model,
                side,
                leg.gap_m,
                speed_m_s=leg.speed_m_s,
                tuning=self._tuning.follow,
                brake=self._brake,
                noise=self._ranging,
            )
            if leg.touching:
                self._follower.go_round(0.0, self._model.radius_m + leg.gap_m)
            return
        speed = self._model.cruise_speed_m_s if leg.speed_m_s is None else leg.speed_m_s
        self._speed = min(speed, self._model.max_speed_m_s)
        if isinstance(leg, Drive):
            heading = leg.heading_rad
            length = leg.distance_m
        else:
            dx, dy = leg.x_m - obs.pose.x_m, leg.y_m - obs.pose.y_m
            heading = math.atan2(dy, dx)
            length = math.hypot(dx, dy)
        self._cos, self._sin = math.cos(heading), math.sin(heading)
        self._backward = length is not None and length < 0.0
        if leg.timeout_s is not None:
            self._timeout_s = leg.timeout_s
        elif length is None:
            self._timeout_s = 600.0
        else:
            self._timeout_s = 5.0 + 2.0 * abs(length) / self._speed

    def step(self, obs: Observation) -> VelocityCommand:
        """Return the command of this control step. Return a halt if no leg is running."""
        leg = self._leg
        if leg is None or self._result is not None:
            return HALT
        dt = self._step_s(obs)
        self._elapsed_s += dt
        self._wary_m_s = self._hidden.update(
            obs.ultrasonic_m, obs.v_m_s * dt, obs.yaw_rate_rad_s * dt
        )
        if isinstance(leg, Drive | GoTo):
            pose, origin = obs.pose, self._origin
            self._along_m = (pose.x_m - origin.x_m) * self._cos + (
                pose.y_m - origin.y_m
            ) * self._sin
        if self._stopping is None:
            if self._elapsed_s > self._timeout_s:
                return self._stop(StopReason.TIMEOUT, obs, dt)
            return self._advance(leg, obs, dt)
        return self._come_to_rest(obs, dt)

    def cancel(self, obs: Observation) -> None:
        """End the current leg at the robot's position, without stopping the robot."""
        if self._leg is not None and self._result is None:
            self._stopping = StopReason.CANCELLED
            self._bumped = (False, False)
            self._finish(obs)

    def brake(self, obs: Observation) -> VelocityCommand:
        """Brake to standstill within the acceleration limits, and keep the current leg.

        Call this method once per observation until it returns a halt. The next ``step`` continues
        the leg. A bumper switch or a cliff halts the robot immediately.
        """
        dt = self._step_s(obs)
        if self._rolls_into(obs):
            self.halt()
            return HALT
        return self._slow_down(dt)

    def halt(self) -> None:
        """Record a stop by other code. The next ``step`` accelerates from standstill."""
        self._smooth_v.reset()
        self._smooth_w.reset()

    def _step_s(self, obs: Observation) -> float:
        """Return the time since the last step, including time in which other code drove."""
        since_s = max(obs.time_s - self._last_s, 0.0)
        self._last_s = obs.time_s
        if since_s <= _MAX_STEP_S:
            return since_s
        self._smooth_v.reset(obs.v_m_s)
        self._smooth_w.reset(obs.yaw_rate_rad_s)
        return _MAX_STEP_S

    # -- the kinds of leg -------------------------------------------------------------------

    def _advance(self, leg: Leg, obs: Observation, dt: float) -> VelocityCommand:
        if isinstance(leg, Drive):
            return self._drive(leg, obs, dt)
        if isinstance(leg, Turn):
            return self._turn(leg, obs, dt)
        if isinstance(leg, GoTo):
            return self._go_to(leg, obs, dt)
        if isinstance(leg, FollowWall):
            return self._follow(leg, obs, dt)
        if self._elapsed_s >= leg.duration_s:
            return self._stop(StopReason.DONE, obs, dt)
        return self._send(0.0, 0.0, dt)

    def _drive(self, leg: Drive, obs: Observation, dt: float) -> VelocityCommand:
        direction = -1.0 if self._backward else 1.0
        speed = self._speed
        if not self._backward:
            hit = self._hit(obs)
            if hit is not None:
                return self._stop(hit, obs, dt)
            speed = self._approach(leg.stop_range_m, obs, dt, speed)
            if speed <= 0.0:
                return self._stop(StopReason.RANGE, obs, dt)
            speed = min(speed, self._allowed(wary=leg.wary))
        if leg.distance_m is not None:
            remaining = (leg.distance_m - self._along_m) * direction
            if remaining <= self._brake.run_out(obs.v_m_s):
                if leg.end_m_s > 0.0:
                    return self._flow_on(StopReason.DISTANCE, obs)
                return self._stop(StopReason.DISTANCE, obs, dt)
            speed = min(speed, max(self._brake.speed(remaining), leg.end_m_s))
        if self._stands(obs, dt) or self._stalled(self._along_m, self._tuning.stall_m):
            return self._stop(StopReason.STALLED, obs, dt)
        pose, origin = obs.pose, self._origin
        across = (pose.y_m - origin.y_m) * self._cos - (pose.x_m - origin.x_m) * self._sin
        across -= leg.across_m
        aim = leg.heading_rad - direction * math.atan2(across, self._tuning.lookahead_m)
        rate = self._rotary.update(aim, pose.theta_rad, dt)
        error = wrap_angle(leg.heading_rad - pose.theta_rad)
        return self._send(direction * speed * max(math.cos(error), 0.0), rate, dt)

    def _turn(self, leg: Turn, obs: Observation, dt: float) -> VelocityCommand:
        tune = self._tuning
        if leg.across_m:
            hit = self._hit(obs)
            if hit is not None:
                return self._stop(hit, obs, dt)
        elif leg.ends_at_cliff and obs.cliff and not self._had_cliff:
            return self._stop(StopReason.CLIFF, obs, dt)
        elif self._rolls_into(obs):
            self._smooth_v.reset()  # a turn leads away; remaining forward motion does not
        self._had_cliff = obs.cliff
        error = _remaining_rad(leg, obs)
        run_out = 0.5 * tune.braking.lag_s * abs(obs.yaw_rate_rad_s)
        if leg.flowing and abs(error) < tune.flow_rad + run_out:
            return self._flow_on(StopReason.DONE, obs)
        if abs(error) < tune.heading_tolerance_rad + run_out:
            return self._stop(StopReason.DONE, obs, dt)
        if self._stalled(obs.pose.theta_rad, tune.stall_rad):
            return self._stop(StopReason.STALLED, obs, dt)
        if leg.flowing:
            rate = math.copysign(min(self._flow.speed(abs(error)), self._flow_rad_s), error)
        else:
            rate = self._rotary.update(leg.heading_rad, obs.pose.theta_rad, dt)
        if abs(rate) < tune.min_turn_rad_s:
            rate = math.copysign(tune.min_turn_rad_s, error)
        return self._arc(leg, obs, rate, dt) if leg.across_m else self._send(0.0, rate, dt)

    def _turn_limit_s(self, leg: Turn, obs: Observation) -> float:
        """Return the time limit of a turn, s."""
        turn_s = abs(_remaining_rad(leg, obs)) / self._flow_rad_s
        arc_s = math.pi * abs(leg.across_m) / self._model.cruise_speed_m_s
        return max(_MIN_TURN_LIMIT_S, 5.0 + 2.0 * (turn_s + arc_s))

    def _arc(self, leg: Turn, obs: Observation, rate: float, dt: float) -> VelocityCommand:
        error = _remaining_rad(leg, obs)
        radius = max(self._arc_radius_m(leg, obs, error), _MIN_RADIUS_M)
        speed = min(abs(rate) * radius, self._model.cruise_speed_m_s)
        # the robot turns no faster than its speed allows, so that it stays on the arc
        reached = self._smooth_v.output + self._model.max_accel_m_s2 * dt
        max_rate = max(min(speed, reached) / radius, self._tuning.min_turn_rad_s)
        rate = math.copysign(min(abs(rate), max_rate), error)
        return self._send(min(speed, self._allowed(wary=False)), rate, dt)

    def _arc_radius_m(self, leg: Turn, obs: Observation, error: float) -> float:
        """Return the radius of the arc that ends on the line of ``leg``.

        An arc of radius r that turns by an angle e moves r · (1 - cos e) towards the line.
        """
        pose, origin = obs.pose, self._origin
        across = (pose.y_m - origin.y_m) * math.cos(leg.heading_rad) - (
            pose.x_m - origin.x_m
        ) * math.sin(leg.heading_rad)
        remaining = (leg.across_m - across) * math.copysign(1.0, leg.across_m)
        radius = remaining / max(1.0 - math.cos(error), self._tuning.min_arc)
        return min(max(radius, 0.0), abs(leg.across_m))

    def _go_to(self, leg: GoTo, obs: Observation, dt: float) -> VelocityCommand:
        tune = self._tuning
        hit = self._hit(obs)
        if hit is not None:
            return self._stop(hit, obs, dt)
        command = self._point.update(leg.x_m, leg.y_m, obs.pose, dt)
        near = command.distance_m < tune.point_near * tune.point_tolerance_m
        behind = abs(command.bearing_error_rad) > 0.5 * math.pi
        if command.distance_m < tune.point_tolerance_m or (near and behind):
            return self._stop(StopReason.DONE, obs, dt)
        rate = command.yaw_rate_rad_s
        speed = command.vx_m_s
        if speed <= 0.0:
            # turn in place: an obstacle that is ahead now is not ahead after the turn
            self._ahead.reset()
            speed = 0.0
            if abs(rate) < tune.min_turn_rad_s:
                rate = math.copysign(tune.min_turn_rad_s, command.bearing_error_rad)
        else:
            max_speed = self._approach(leg.stop_range_m, obs, dt, self._speed)
            if max_speed <= 0.0:
                return self._stop(StopReason.RANGE, obs, dt)
            speed = max(speed, self._brake.creep)
            speed = min(speed, max_speed, self._brake.speed(command.distance_m))
            speed = min(speed, self._allowed(wary=False))
        # metres and radians are added on purpose: driving and turning are both progress
        progress = self._along_m + obs.pose.theta_rad
        if self._stands(obs, dt) or self._stalled(progress, tune.stall_m):
            return self._stop(StopReason.STALLED, obs, dt)
        return self._send(speed, rate, dt)

    def _follow(self, leg: FollowWall, obs: Observation, dt: float) -> VelocityCommand:
        self._along_m += abs(obs.v_m_s) * dt
        if leg.distance_m is not None and self._along_m >= leg.distance_m:
            return self._stop(StopReason.DISTANCE, obs, dt)
        step = self._follower.step(obs, dt, self._allowed(wary=True))
        if step.state is FollowState.BLOCKED:
            return self._stop(self._hit(obs) or StopReason.RANGE, obs, dt)
        if step.state is FollowState.LOST:
            return self._stop(StopReason.LOST, obs, dt)
        if self._stands(obs, dt) or self._stalled(self._along_m, self._tuning.stall_m):
            return self._stop(StopReason.STALLED, obs, dt)
        return self._send(step.command.v_m_s, step.command.yaw_rate_rad_s, dt)

    # -- parts -----------------------------------------------------------------------------

    def _approach(
        self,
        stop_range_m: float | None,
        obs: Observation,
        dt: float,
        speed: float,
    ) -> float:
        """Return the speed that still stops at the stop range; 0 at the stop range."""
        if stop_range_m is None:
            return speed
        ahead = self._ahead.update(obs.ultrasonic_m, obs.v_m_s * dt, dt)
        if ahead is None:
            return speed
        remaining = ahead - stop_range_m
        if remaining <= self._brake.run_out(obs.v_m_s):
            return 0.0
        return min(speed, self._brake.speed(remaining))

    def _allowed(self, *, wary: bool) -> float:
        """Return the maximum speed for known obstacles; ``wary``: also for suspected ones."""
        limit = min(self.speed_limit_m_s, self._wary_m_s) if wary else self.speed_limit_m_s
        return max(limit, self._brake.creep)

    def _hit(self, obs: Observation) -> StopReason | None:
        if obs.cliff:
            return StopReason.CLIFF
        if obs.bumper_left or obs.bumper_right:
            return StopReason.BUMPER
        return None

    def _rolls_into(self, obs: Observation) -> bool:
        """Return True if the last leg still commands forward motion towards an obstacle."""
        return self._smooth_v.output > 0.0 and self._hit(obs) is not None

    def _stands(self, obs: Observation, dt: float) -> bool:
        """Return True if the robot has stood for a while although its wheels turn."""
        self._stood_s = self._stood_s + dt if obs.stands else 0.0
        return self._stood_s > self._tuning.stands_s

    def _stalled(self, progress: float, min_progress: float) -> bool:
        if abs(progress - self._mark) > min_progress:
            self._mark = progress
            self._mark_s = self._elapsed_s
            return False
        return self._elapsed_s - self._mark_s > self._tuning.stall_s

    def _send(self, v_m_s: float, rate_rad_s: float, dt: float) -> VelocityCommand:
        self._target = VelocityCommand(v_m_s, rate_rad_s)
        return VelocityCommand(
            self._smooth_v.update(v_m_s, dt),
            self._smooth_w.update(rate_rad_s, dt),
        )

    def _stop(self, reason: StopReason, obs: Observation, dt: float) -> VelocityCommand:
        self._stopping = reason
        self._stopped_s = 0.0
        self._bumped = (obs.bumper_left, obs.bumper_right)
        if reason in (StopReason.BUMPER, StopReason.CLIFF):
            self.halt()
            return HALT
        return self._send(0.0, 0.0, dt)

    def _flow_on(self, reason: StopReason, obs: Observation) -> VelocityCommand:
        """End the leg without stopping. The next leg continues from the last command."""
        self._stopping = reason
        self._bumped = (obs.bumper_left, obs.bumper_right)
        self._finish(obs)
        return VelocityCommand(self._smooth_v.output, self._smooth_w.output)

    def _come_to_rest(self, obs: Observation, dt: float) -> VelocityCommand:
        """Ramp down to zero. The leg ends at standstill, where its distance and pose are final."""
        tune = self._tuning
        self._stopped_s += dt
        command = self._slow_down(dt)
        rest = abs(obs.v_m_s) < tune.rest_m_s and abs(obs.yaw_rate_rad_s) < tune.rest_rad_s
        if (command is HALT and rest) or self._stopped_s > tune.settling_s:
            self._finish(obs)
        return command

    def _slow_down(self, dt: float) -> VelocityCommand:
        tune = self._tuning
        command = self._send(0.0, 0.0, dt)
        if abs(command.v_m_s) < tune.rest_m_s and abs(command.yaw_rate_rad_s) < tune.rest_rad_s:
            self.halt()
            return HALT
        return command

    def _finish(self, obs: Observation) -> None:
        leg, reason = self._leg, self._stopping
        if leg is None or reason is None:
            return
        self._result = LegResult(
            leg,
            reason,
            self._along_m,
            self._elapsed_s,
            obs.pose,
            self._bumped[0] or obs.bumper_left,
            self._bumped[1] or obs.bumper_right,
        )


def _remaining_rad(leg: Turn, obs: Observation) -> float:
    """Return the angle that is left to turn, rad; for an arc, towards its line."""
    error = wrap_angle(leg.heading_rad - obs.pose.theta_rad)
    if leg.across_m * error > 0.0 and abs(error) > 0.5 * math.pi:
        error -= math.copysign(2.0 * math.pi, error)
    return error

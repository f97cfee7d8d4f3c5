"""A small differential-drive world for planner tests, independent of the emulator.

The robot is a disc among polygons and moves in steps of 50 Hz. A contact removes the component of
the motion into the wall, so the disc slides along the wall. The host's estimator processes the
encoder and gyro readings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.coverage.runner import PlanRunner
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.observation import HALT, Observation, VelocityCommand

if TYPE_CHECKING:
    import random

    from bridge.coverage.planner import Planner, PlannerEvent
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RangerMount, RobotModel

STEP_S = 0.02
_SUBSTEPS = 4
_REST_FIRST_S = 2.0
_LAG_S = 0.05
_TOUCH_M = 5e-4
_BUMPER_OVERLAP_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class WorldNoise:
    """Standard deviations of the noise; all zero is the ideal world."""

    ultrasonic_m: float = 0.0
    infrared_m: float = 0.0
    gyro_rad_s: float = 0.0
    gyro_bias_rad_s: float = 0.0
    """Constant gyro bias, rad/s; the estimator can measure it at rest."""
    gyro_drift_rad_s: float = 0.0
    """Additional gyro bias after the robot first moves, rad/s, with random sign; calibration at
    rest cannot remove it.
    """
    wheel_scale: float = 0.0


IDEAL = WorldNoise()
TYPICAL = WorldNoise(
    ultrasonic_m=0.003,
    infrared_m=0.0015,
    gyro_rad_s=math.radians(0.05),
    gyro_bias_rad_s=math.radians(0.5),
    gyro_drift_rad_s=math.radians(0.01),
    wheel_scale=0.002,
)


class KinematicWorld:
    """True state of the world, and the sensor readings."""

    def __init__(
        self,
        plan: FloorPlan,
        model: RobotModel,
        rng: random.Random,
        noise: WorldNoise = IDEAL,
    ) -> None:
        self.model = model
        self.noise = noise
        self.truth = plan.start
        self.time_s = 0.0
        self.touching: float | None = None
        self._rng = rng
        self._edges = [(ax, ay, bx - ax, by - ay) for (ax, ay), (bx, by) in plan.edges()]
        self._v = 0.0
        self._w = 0.0
        self._left_m = 0.0
        self._right_m = 0.0
        self._scales = (1.0 + rng.gauss(0, noise.wheel_scale), 1 + rng.gauss(0, noise.wheel_scale))
        self._bias = rng.gauss(0.0, noise.gyro_bias_rad_s)
        self._drift = rng.choice((-1.0, 1.0)) * noise.gyro_drift_rad_s
        self._moved = False
        self._ranges: tuple[float | None, float | None, float | None] = (None, None, None)
        self._next_range_s = 0.0
        self.estimator = PoseEstimator(model, plan.start)
        self._feed()

    # -- motion ----------------------------------------------------------------------------

    def step(self, command: VelocityCommand) -> Observation:
        """Apply a command for one control period; return the observation."""
        dt = STEP_S / _SUBSTEPS
        follow = 1.0 - math.exp(-dt / _LAG_S)
        for _ in range(_SUBSTEPS):
            self._v += follow * (command.v_m_s - self._v)
            self._w += follow * (command.yaw_rate_rad_s - self._w)
            self._move(dt)
        self.time_s += STEP_S
        self._feed()
        return self.observe()

    def rest(self, seconds: float) -> None:
        """Stand still, so that the estimator learns the gyro bias."""
        for _ in range(round(seconds / STEP_S)):
            self.step(HALT)

    def _move(self, dt: float) -> None:
        old = self.truth
        theta = old.theta_rad + self._w * dt
        mid = old.theta_rad + 0.5 * self._w * dt
        x = old.x_m + self._v * dt * math.cos(mid)
        y = old.y_m + self._v * dt * math.sin(mid)
        self.touching = None
        radius = self.model.radius_m
        for _ in range(3):
            gap, nx, ny = self.nearest(x, y)
            if gap > radius + _TOUCH_M:
                break
            self.touching = wrap_angle(math.atan2(-ny, -nx) - theta)
            if gap >= radius:
                break
            x += (radius - gap) * nx
            y += (radius - gap) * ny
        ahead = (x - old.x_m) * math.cos(mid) + (y - old.y_m) * math.sin(mid)
        half = 0.5 * self.model.wheel_base_m * self._w * dt
        self._left_m += (ahead - half) * self._scales[0]
        self._right_m += (ahead + half) * self._scales[1]
        self._moved = self._moved or abs(ahead) + abs(half) > 1e-6
        self.truth = Pose2(x, y, wrap_angle(theta))

    def nearest(self, x: float, y: float) -> tuple[float, float, float]:
        """Return the distance to the nearest edge and the unit vector away from it."""
        best, bx, by = math.inf, 0.0, 0.0
        for ax, ay, ex, ey in self._edges:
            t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
            t = min(max(t, 0.0), 1.0)
            dx, dy = x - ax - t * ex, y - ay - t * ey
            d2 = dx * dx + dy * dy
            if d2 < best:
                best, bx, by = d2, dx, dy
        d = math.sqrt(best) or 1e-12
        return d, bx / d, by / d

    # -- sensing ---------------------------------------------------------------------------

    def _feed(self) -> None:
        noise, scale = self.noise, self.model.metres_per_count
        bias = self._bias + (self._drift if self._moved else 0.0)
        for k in (1, 2):
            gyro = self._w + bias + self._rng.gauss(0.0, noise.gyro_rad_s)
            self.estimator.on_imu(self.time_s - STEP_S + k * STEP_S / 2, gyro)
        left = math.floor(self._left_m / scale) & 0xFFFF
        right = math.floor(self._right_m / scale) & 0xFFFF
        self.estimator.on_encoders(self.time_s, left, right)

    def observe(self) -> Observation:
        """Return the present observation."""
        if self.time_s >= self._next_range_s - 1e-9:
            self._next_range_s += 0.05
            noise, model = self.noise, self.model
            self._ranges = (
                self._range(model.ultrasonic, noise.ultrasonic_m),
                self._range(model.infrared_left, noise.infrared_m),
                self._range(model.infrared_right, noise.infrared_m),
            )
        contact = self.touching
        front = contact is not None and abs(contact) < math.pi / 2
        return Observation(
            self.time_s,
            self.estimator.pose,
            self.estimator.v_m_s,
            self.estimator.yaw_rate_rad_s,
            *self._ranges,
            front and contact is not None and contact > -_BUMPER_OVERLAP_RAD,
            front and contact is not None and contact < _BUMPER_OVERLAP_RAD,
            cliff=False,
        )

    def _range(self, mount: RangerMount, sigma_m: float) -> float | None:
        x, y = self.truth.transform(mount.x_m, mount.y_m)
        heading = self.truth.theta_rad + mount.yaw_rad
        shares = (-0.5, -0.25, 0.0, 0.25, 0.5) if mount.cone_rad else (0.0,)
        distance = min(self._ray(x, y, heading + share * mount.cone_rad) for share in shares)
        distance += self._rng.gauss(0.0, sigma_m)
        if not mount.min_range_m <= distance <= mount.max_range_m:
            return None
        return round(distance, 3)

    def _ray(self, x: float, y: float, heading: float) -> float:
        c, s = math.cos(heading), math.sin(heading)
        best = math.inf
        for ax, ay, ex, ey in self._edges:
            cross = c * ey - s * ex
            if abs(cross) < 1e-12:
                continue
            dx, dy = ax - x, ay - y
            along = (dx * ey - dy * ex) / cross
            share = (dx * s - dy * c) / cross
            if 0.0 <= along < best and 0.0 <= share <= 1.0:
                best = along
        return best


@dataclass(slots=True)
class Run:
    """A finished run: the data that tests read."""

    finish_reason: str | None
    duration_s: float
    poses: list[tuple[float, float, float, float]]
    """Truth: time_s, x_m, y_m, theta_rad."""
    events: list[PlannerEvent]
    runner: PlanRunner
    world: KinematicWorld
    worst_pose_error_m: float = 0.0
    bumps: int = field(default=0)


def run_plan(world: KinematicWorld, planner: Planner, max_time_s: float) -> Run:
    """Run a planner to its end or for ``max_time_s`` of its own time."""
    runner = PlanRunner(planner, world.model)
    world.rest(_REST_FIRST_S)
    obs = world.observe()
    start_s = world.time_s
    run = Run(None, 0.0, [(world.time_s, *world.truth)], [], runner, world)
    bumped = False
    while not runner.finished and world.time_s - start_s < max_time_s:
        obs = world.step(runner.step(obs))
        run.poses.append((world.time_s, *world.truth))
        run.worst_pose_error_m = max(run.worst_pose_error_m, world.truth.distance_m(obs.pose))
        bump = obs.bumper_left or obs.bumper_right
        run.bumps += bump and not bumped
        bumped = bump
    run.events = runner.drain_events()
    run.finish_reason = runner.finish_reason
    run.duration_s = world.time_s - start_s
    return run

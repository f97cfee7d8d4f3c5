"""A fast kinematic world for hundreds of runs: one compiled call per control step.

Its rules of contact, ranging and lag are simpler than in the virtual sweeper. The planner gets no
estimate, but the true pose plus errors that vary slowly (``PoseNoise``). This world serves to
explore a planner; no published result comes from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.observation import HALT, Observation
from support.fast_world_kernel import move, sense

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.coverage.planner import Planner, PlannerEvent
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.observation import VelocityCommand
    from bridge.motion.robot_model import RobotModel

    Floats = NDArray[np.float64]

STEP_S = 0.02
_RANGES_EVERY_S = 0.05


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviations of the errors in the given pose and in the sensors."""

    name: str = "none"
    position_m: float = 0.0
    heading_rad: float = 0.0
    memory_s: float = 40.0
    """Correlation time of the pose error, s."""
    ultrasonic_m: float = 0.0
    dropout: float = 0.0
    infrared_m: float = 0.0
    """Standard deviation of the infrared range at 10 cm, m; it grows with the square of the range.
    """


LEVELS = {
    level.name: level
    for level in (
        PoseNoise(),
        PoseNoise("typical", 0.006, math.radians(0.35), 40.0, 0.003, 0.01, 0.0015),
        PoseNoise("harsh", 0.014, math.radians(0.9), 40.0, 0.008, 0.05, 0.004),
    )
}


class FastWorld:
    """True state and observations of one run."""

    def __init__(
        self, plan: FloorPlan, model: RobotModel, seed: int = 0, noise: PoseNoise | None = None
    ) -> None:
        self.model, self.noise = model, noise or PoseNoise()
        self._rng = np.random.default_rng(seed)
        self._edges = np.array(
            [(a[0], a[1], b[0] - a[0], b[1] - a[1]) for a, b in plan.edges() if a != b]
        )
        corners = []
        for index, polygon in enumerate((plan.walls, *plan.obstacles)):
            area = sum(
                polygon[i - 1][0] * p[1] - p[0] * polygon[i - 1][1] for i, p in enumerate(polygon)
            )
            sign = 1.0 if (area > 0) == (index == 0) else -1.0
            for i, p in enumerate(polygon):
                a, b = polygon[i - 1], polygon[(i + 1) % len(polygon)]
                turn = (p[0] - a[0]) * (b[1] - p[1]) - (p[1] - a[1]) * (b[0] - p[0])
                corners.append((p[0], p[1], 1.0 if turn * sign < 0 else 0.0))
        self._corners = np.array(corners)
        start = plan.start
        self.state = np.zeros(12)
        self.state[:3] = start
        self.state[7] = 1.0
        self._out = np.zeros(3)
        self._errors = np.zeros(3)
        self._normals: list[float] = []
        self.time_s = 0.0
        self._next_s = 0.0
        self._ranges: tuple[float | None, float | None, float | None] = (None, None, None)
        self.poses: list[tuple[float, float, float, float]] = []

    def _normal(self) -> float:
        if not self._normals:
            self._normals = self._rng.standard_normal(512).tolist()
        return self._normals.pop()

    def step(self, command: VelocityCommand) -> Observation:
        move(
            self._edges,
            self.state,
            command.v_m_s,
            command.yaw_rate_rad_s,
            self.model.radius_m,
            1.518,
        )
        self.time_s += STEP_S
        return self.observe()

    def observe(self) -> Observation:
        s, noise = self.state, self.noise
        x, y, th = float(s[0]), float(s[1]), float(s[2])
        self.poses.append((self.time_s, x, y, th))
        if self.time_s >= self._next_s - 1e-9:
            self._next_s += _RANGES_EVERY_S
            front, side = self.model.ultrasonic, self.model.infrared_left
            sense(
                self._edges,
                self._corners,
                s,
                self._out,
                front.cone_rad,
                front.x_m,
                side.x_m,
                side.y_m,
            )
            sonar: float | None = float(self._out[0]) + noise.ultrasonic_m * self._normal()
            if self._out[0] > 4.0 or (noise.dropout and self._rng.random() < noise.dropout):
                sonar = None
            sides: list[float | None] = []
            for k in (1, 2):
                r = float(self._out[k])
                if r > 0.30:
                    sides.append(None)
                    continue
                r += noise.infrared_m * max(0.36, (r / 0.1) ** 2) * self._normal()
                sides.append(max(round(r / 0.00125) * 0.00125, 0.04) if r <= 0.30 else None)
            sonar = None if sonar is None else max(round(sonar, 3), 0.02)
            fitted = [mount.fitted for mount in self.model.rangers.values()]
            ranges = [r if has else None for r, has in zip((sonar, *sides), fitted, strict=True)]
            self._ranges = (ranges[0], ranges[1], ranges[2])
        if noise.position_m:
            if abs(s[3]) + abs(s[4]) > 0.01:
                e, fade = self._errors, STEP_S / noise.memory_s
                kick = math.sqrt(2.0 * fade)
                e[0] += noise.position_m * kick * self._normal() - fade * e[0]
                e[1] += noise.position_m * kick * self._normal() - fade * e[1]
                e[2] += noise.heading_rad * kick * self._normal() - fade * e[2]
            x, y, th = (
                x + float(self._errors[0]),
                y + float(self._errors[1]),
                th + float(self._errors[2]),
            )
        return Observation(
            self.time_s,
            Pose2(x, y, wrap_angle(th)),
            float(s[3]),
            float(s[4]),
            *self._ranges,
            bool(s[8]),
            bool(s[9]),
            cliff=False,
            lateral_sigma_m=noise.position_m,
        )


@dataclass(slots=True)
class FastRun:
    """A finished run."""

    finish_reason: str | None
    duration_s: float
    poses: list[tuple[float, float, float, float]]
    events: list[tuple[float, PlannerEvent]]
    collisions: int
    contact_s: float
    path_m: float
    turns: int
    legs: int
    decision_ms: list[float] = field(default_factory=list)
    step_us: float = 0.0


def run_fast(  # noqa: PLR0913 - the options of a run
    plan: FloorPlan,
    planner: Planner,
    model: RobotModel,
    *,
    seed: int = 0,
    noise: PoseNoise | None = None,
    max_time_s: float = 7200.0,
) -> FastRun:
    """Run a planner to its end or for ``max_time_s``."""
    world = FastWorld(plan, model, seed, noise)
    runner = PlanRunner(planner, model)
    events: list[tuple[float, PlannerEvent]] = []
    obs = world.step(HALT)
    while not runner.finished and world.time_s < max_time_s:
        obs = world.step(runner.step(obs))
        events.extend((world.time_s, event) for event in runner.drain_events())
    return FastRun(
        runner.finish_reason,
        world.time_s,
        world.poses,
        events,
        int(world.state[6]),
        float(world.state[10]),
        float(world.state[5]),
        runner.turns,
        runner.legs,
    )

"""A quick kinematic world for runs by the hundred: one compiled call per control step.

The rules of contact, ranging and lag are those of the virtual sweeper in short; the pose that
the planner is given is the truth plus errors that wander (``PoseNoise``), in place of an
estimator. It is for finding what a planner does, not for figures to be published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.runner import PlanRunner
from bridge.motion.compiled import compiled
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.observation import HALT, Observation

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
    """Standard deviations of the given pose and of the sensors."""

    name: str = "none"
    position_m: float = 0.0
    heading_rad: float = 0.0
    memory_s: float = 40.0
    """Of the wandering error."""
    ultrasonic_m: float = 0.0
    dropout: float = 0.0
    infrared_m: float = 0.0
    """At 10 cm; grows as the range squared."""


LEVELS = {
    level.name: level
    for level in (
        PoseNoise(),
        PoseNoise("typical", 0.006, math.radians(0.35), 40.0, 0.003, 0.01, 0.0015),
        PoseNoise("harsh", 0.014, math.radians(0.9), 40.0, 0.008, 0.05, 0.004),
    )
}


@compiled
def _nearest(edges: Floats, x: float, y: float) -> tuple[float, float, float]:
    best = 1e18
    bx = 0.0
    by = 1.0
    for i in range(edges.shape[0]):
        ax, ay, ex, ey = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        t = min(max(t, 0.0), 1.0)
        dx, dy = x - ax - t * ex, y - ay - t * ey
        d2 = dx * dx + dy * dy
        if d2 < best:
            best, bx, by = d2, dx, dy
    d = math.sqrt(best) + 1e-15
    return d, bx / d, by / d


@compiled
def _ray(edges: Floats, x: float, y: float, heading: float) -> tuple[float, float]:
    c, s = math.cos(heading), math.sin(heading)
    best = 1e9
    cosine = 0.0
    for i in range(edges.shape[0]):
        ax, ay, ex, ey = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        cross = c * ey - s * ex
        if abs(cross) < 1e-12:
            continue
        dx, dy = ax - x, ay - y
        along = (dx * ey - dy * ex) / cross
        share = (dx * s - dy * c) / cross
        if 0.0 <= along < best and 0.0 <= share <= 1.0:
            best = along
            cosine = abs(cross) / math.sqrt(ex * ex + ey * ey)
    return best, cosine


@compiled
def _move(  # noqa: PLR0913, PLR0917 - a kernel
    edges: Floats, state: Floats, v_cmd: float, w_cmd: float, radius: float, span: float
) -> None:
    """state: x y th v w travelled collisions free_s left right contact_s touching."""
    sub = 8
    dt = 0.02 / sub
    follow = 1.0 - math.exp(-dt / 0.05)
    x, y, th, v, w = state[0], state[1], state[2], state[3], state[4]
    left = False
    right = False
    for _ in range(sub):
        v += follow * (v_cmd - v)
        w += follow * (w_cmd - w)
        mid = th + 0.5 * w * dt
        nx = x + v * dt * math.cos(mid)
        ny = y + v * dt * math.sin(mid)
        th += w * dt
        touch = False
        for _k in range(3):
            gap, ux, uy = _nearest(edges, nx, ny)
            if gap > radius + 2e-5:
                break
            touch = True
            bearing = (math.atan2(-uy, -ux) - th + math.pi) % (2.0 * math.pi) - math.pi
            if abs(bearing) < span:
                left = left or bearing > -0.175
                right = right or bearing < 0.175
            into = -(v * math.cos(mid) * ux + v * math.sin(mid) * uy)
            if state[11] < 0.5 and into > 0.03 and state[7] > 0.5:
                state[6] += 1.0
                state[7] = 0.0
            if gap >= radius:
                break
            nx += (radius - gap) * ux
            ny += (radius - gap) * uy
        if touch:
            state[7] = 0.0
            state[10] += dt
            state[11] = 1.0
        else:
            state[7] += dt
            state[11] = 0.0
        state[5] += math.hypot(nx - x, ny - y)
        x, y = nx, ny
    state[0], state[1], state[2], state[3], state[4] = x, y, th, v, w
    state[8] = 1.0 if left else 0.0
    state[9] = 1.0 if right else 0.0


@compiled
def _sense(edges: Floats, corners: Floats, state: Floats, out: Floats, cone: float) -> None:
    x, y, th = state[0], state[1], state[2]
    c, s = math.cos(th), math.sin(th)
    ux, uy = x + 0.12 * c, y + 0.12 * s
    near = 1e9
    for k in range(9):
        r, cosine = _ray(edges, ux, uy, th + cone * (k / 8.0 - 0.5))
        if cosine >= 0.891:
            near = min(near, r)
    limit = math.cos(0.5 * cone)
    for i in range(corners.shape[0]):
        dx, dy = corners[i, 0] - ux, corners[i, 1] - uy
        d = math.hypot(dx, dy)
        if d < 1e-6 or d >= near or (dx * c + dy * s) < limit * d:
            continue
        if corners[i, 2] > 0.5 and d > 1.5:
            continue
        r, _ = _ray(edges, ux, uy, math.atan2(dy, dx))
        if r >= d - 1e-6:
            near = d
    out[0] = near
    for k in range(2):
        side = 1.0 - 2.0 * k
        px, py = x + 0.05 * c - side * 0.10 * s, y + 0.05 * s + side * 0.10 * c
        r, _ = _ray(edges, px, py, th + side * 0.5 * math.pi)
        out[1 + k] = r


class FastWorld:
    """Truth and observations of one run."""

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
        _move(
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
            _sense(self._edges, self._corners, s, self._out, self.model.ultrasonic.cone_rad)
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
            self._ranges = (sonar, sides[0], sides[1])
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


def run_fast(  # noqa: PLR0913 - what a run can be asked for
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

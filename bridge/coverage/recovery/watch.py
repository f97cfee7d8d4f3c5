"""What the recovery planner does at every step: keep the map, and look up from the leg."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.coverage.planner import ScriptedPlanner
from bridge.coverage.recovery.choice import Chooser
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.stretches import Stretches
from bridge.motion.control.braking import Braking

if TYPE_CHECKING:
    from bridge.coverage.recovery.evidence import EvidenceMap
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

_CHECK_M = 0.05
_AHEAD_M = (0.03, 0.25)
_BAND_M = (0.03, 0.065)
"""The part of the mouth next to the wall, by which an outline is judged swept or not."""
_SEEN_M = 0.20
"""A wall read nearer than this beside a lane takes a part of the lane's own band."""
_MOSTLY = 0.8
CLOSED_M = 0.25
"""An outline is not judged closed before this: it may begin on floor that a lane has swept."""
_STRAIGHT_RAD_S, ROUND_RAD_S = 0.3, 0.5
"""Below the first a wall is followed straight on; from the second on a corner is gone round, at
0.54. Between them it may be a noisy infrared that turns the robot."""
_BRAKE_SHARE, _LATENCY_S = 0.75, 0.10
"""Of the acceleration limit, as the controllers have it; from a command to the wheels."""
_BRISK_M_S = 0.15
"""Faster than any corner is gone round."""
_JUMP_M = 0.008
"""Beyond the way driven in a control step (6 mm at top speed)."""
_REPORTED_RAD, _REPORTED_SHARE = math.radians(0.3), 0.5
"""A doubt of the heading that is worth telling, and what is left of it when a wall took it away."""


class WatchfulPlanner(ScriptedPlanner):
    """The map, kept at every observation; what it tells while a leg is driven."""

    def __init__(self, model: RobotModel, options: RecoveryOptions | None = None) -> None:
        """Nothing begins before ``start``."""
        super().__init__(model)
        self.options = options or RecoveryOptions()
        self._chooser = Chooser(self.options)
        self._memory: EvidenceMap | None = None
        self._brake = Braking(_BRAKE_SHARE * model.max_accel_m_s2, _LATENCY_S)
        self._reset()

    def _reset(self) -> None:
        self._obs: Observation | None = None
        self._following = 0
        self._looking = False
        self._aside = 0
        self._blocked_at: Pose2 | None = None
        self._refusals = 0
        self._sought: list[tuple[Pose2, bool, int]] = []
        """Where what refused the robot was followed, on which side, and the new cells by then."""
        self._sought_from: Pose2 | None = None
        """The same of the way under way."""
        self._edge_at: Pose2 | None = None
        """Where the floor ahead was missed; None: it is there."""
        self._brisk_s = -math.inf
        self._followed_m = 0.0
        self._checked_m = 0.0
        self._min_m = CLOSED_M
        self._stale = 0
        self._grid = 0j
        self._last_pose: Pose2 | None = None
        self._reported_rad = 0.0
        self._speed_limit_m_s = math.inf
        self._sight_due_s = -math.inf
        self._sights_failed = 0
        self._stretches = Stretches()

    @property
    def speed_limit_m_s(self) -> float:
        """Fastest forward speed that touches nothing known hard."""
        return self._speed_limit_m_s

    @property
    def memory(self) -> EvidenceMap:
        """The map.

        Raises:
            RuntimeError: the plan was not started.

        """
        if self._memory is None:
            raise RuntimeError("the plan was not started")
        return self._memory

    # -- every step ----------------------------------------------------------------------------

    def watch(self, obs: Observation) -> bool:
        """Take an observation; true where an outline has nothing left to sweep ahead."""
        memory = self._memory
        if memory is None:
            return False
        self._see_jump(obs)
        self._see_heading(obs.heading_sigma_rad)
        self._obs = obs
        self._see_edge(obs)
        memory.update(obs)
        straight = abs(obs.yaw_rate_rad_s) < _STRAIGHT_RAD_S
        self._speed_limit_m_s = memory.pace(
            obs.pose, self._following, self._brake, straight=straight
        )
        if self._following and not straight:
            self._speed_limit_m_s = min(self._speed_limit_m_s, self.model.cruise_speed_m_s)
        if not self._following:
            return self._looking and self._look_aside(obs)
        if obs.v_m_s > _BRISK_M_S:
            self._brisk_s = obs.time_s
        last = self._last_pose
        self._last_pose = obs.pose
        round_a_corner = abs(obs.yaw_rate_rad_s) >= ROUND_RAD_S
        self._stretches.follow(obs.pose, self._following, straight=not round_a_corner)
        if last is None:
            return False
        way = last.distance_m(obs.pose)
        self._followed_m += way
        if abs(obs.yaw_rate_rad_s) < 0.1 and obs.v_m_s > 0.05:  # noqa: PLR2004 - straight on
            angle = 4.0 * obs.pose.theta_rad
            self._grid += way * complex(math.cos(angle), math.sin(angle))
        if self._followed_m - self._checked_m < _CHECK_M:
            return False
        self._checked_m = self._followed_m
        if self._fresh_along(obs.pose, self._following) < self.options.fresh_share:
            self._stale += 1
        else:
            self._stale = 0
        return self._stale > 1 and self._followed_m > self._min_m

    def _see_edge(self, obs: Observation) -> None:
        """Keep where the floor ahead was missed first: by the time it stands it is farther on."""
        if not obs.cliff:
            self._edge_at = None
        elif self._edge_at is None:
            self._edge_at = obs.pose

    def _see_jump(self, obs: Observation) -> None:
        """Tell where the estimate was set right: it moved farther than the robot did."""
        last = self._obs
        if last is None:
            return
        dx, dy = obs.pose.x_m - last.pose.x_m, obs.pose.y_m - last.pose.y_m
        if abs(dx) + abs(dy) < _JUMP_M:
            return
        way_m = max(abs(obs.v_m_s), abs(last.v_m_s)) * max(obs.time_s - last.time_s, 0.0)
        jump_m = math.hypot(dx, dy) - way_m
        if jump_m > _JUMP_M:
            if self._following:
                self._stretches.end(last.pose, self._following)
            self.decide("re-zero", "a wall seen again moved the estimate", jump_m=round(jump_m, 4))

    def _see_heading(self, sigma_rad: float) -> None:
        """Tell where the walls told the heading: its doubt grows by itself, and falls by that."""
        max_rad = self._reported_rad
        if sigma_rad > max_rad:
            self._reported_rad = sigma_rad
        elif max_rad > _REPORTED_RAD and sigma_rad < _REPORTED_SHARE * max_rad:
            self._reported_rad = sigma_rad
            self.decide(
                "re-zero",
                "the walls told the heading",
                uncertainty_deg=round(math.degrees(sigma_rad), 2),
                before_deg=round(math.degrees(max_rad), 2),
            )

    def _fresh_along(self, pose: Pose2, side: int) -> float:
        """Share not swept of the strip next to a wall on the left (1) or right (-1)."""
        low, high = _BAND_M
        return self.memory.fresh(pose, _AHEAD_M, (low, high) if side > 0 else (-high, -low))

    def _look_aside(self, obs: Observation) -> bool:
        """Whether a wall beside the lane has come into view whose outline was not swept."""
        if abs(obs.yaw_rate_rad_s) > 0.1 or obs.v_m_s < 0.1:  # noqa: PLR2004 - not yet on the lane
            return False
        for side, mount, range_m in (
            (1, self.model.infrared_left, obs.infrared_left_m),
            (-1, self.model.infrared_right, obs.infrared_right_m),
        ):
            if range_m is None or range_m > _SEEN_M:
                continue
            off = range_m + abs(mount.y_m) - self.model.radius_m
            low, high = max(off, 0.0) + 0.015, max(off, 0.0) + 0.065
            ahead = (0.0, mount.x_m + 0.03)
            if (
                self.memory.fresh(obs.pose, ahead, (low, high) if side > 0 else (-high, -low))
                > _MOSTLY
            ):
                self._aside = side
                return True
        return False

    @property
    def grid_rad(self) -> float:
        """The walls' main direction as followed so far; 0 before any."""
        if not self._grid:
            return 0.0
        return math.atan2(self._grid.imag, self._grid.real) / 4.0

    @property
    def _seen(self) -> Observation:
        if self._obs is None:
            raise RuntimeError("the plan was not started")
        return self._obs

    @property
    def _pose(self) -> Pose2:
        return self._seen.pose

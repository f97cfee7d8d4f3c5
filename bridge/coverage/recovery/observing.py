"""Processing of each observation in the recovery planner: map, speed limit and end of a leg."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.control.braking import Braking

if TYPE_CHECKING:
    from bridge.coverage.planner import PlannerReports
    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.coverage.recovery.options import RecoveryOptions
    from bridge.coverage.recovery.wall_segments import WallSegments
    from bridge.motion.control.tuning import MotionTuning
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import Observation
    from bridge.motion.robot_model import RobotModel

_ROUNDING_M = 1e-9
"""Maximum rounding error of a sum of lengths, m."""


class PerimeterProgress:
    """Progress of a perimeter pass."""

    __slots__ = ("checked_m", "distance_m", "last_pose", "min_m", "side", "stale")

    def __init__(self) -> None:
        """Begin without a wall."""
        self.side = 0
        """Side of the wall: left (1), right (-1), or 0 while no wall is followed."""
        self.distance_m = 0.0
        """Path length in this pass, m."""
        self.checked_m = 0.0
        """Path length in this pass at the last check, m."""
        self.min_m = 0.0
        """Minimum path length before the pass can be complete, m."""
        self.stale = 0
        """Number of checks in a row that found swept floor ahead."""
        self.last_pose: Pose2 | None = None
        """Pose at the last observation of this leg."""

    def begin_pass(self, min_m: float) -> None:
        """Begin a pass that cannot be complete before a path of ``min_m``, m."""
        self.min_m = min_m
        self.distance_m = self.checked_m = 0.0

    def begin_leg(self, side: int) -> None:
        """Begin to follow a wall on the left (1) or right (-1)."""
        self.side, self.last_pose, self.stale = side, None, 0


class ObservationMonitor:
    """Handles every observation during a plan."""

    def __init__(  # noqa: PLR0913 - the objects that it updates
        self,
        model: RobotModel,
        options: RecoveryOptions,
        evidence_map: EvidenceMap,
        record: PlannerReports,
        segments: WallSegments,
        *,
        obs: Observation,
        motion: MotionTuning,
    ) -> None:
        """Start with the first observation of the plan."""
        self._model, self._options = model, options
        self._geometry = evidence_map.geometry
        self._evidence_map, self._record, self._segments = evidence_map, record, segments
        braking = motion.braking
        self._brake = Braking(braking.share * model.max_accel_m_s2, braking.lag_s)
        self._contact_m_s = motion.hidden.contact_m_s
        self.obs = obs
        """The last observation."""
        self.speed_limit_m_s = math.inf
        """Maximum forward speed at which contacts with known obstacles are harmless, m/s."""
        self.wall = PerimeterProgress()
        self.on_lane = False
        """True if the running leg is a lane. A wall beside the lane may end this leg."""
        self.beside = 0
        """Side of the wall that ended the lane: left (1), right (-1), or 0."""
        self.cliff_at: Pose2 | None = None
        """Pose at which the missing floor was first detected; None: there is floor ahead."""
        self._direction = 0j
        """Sum of the path increments along walls, as complex numbers with four times the heading
        angle. Parallel and orthogonal walls then add up."""
        self._max_sigma_rad = 0.0
        """Maximum heading standard deviation since the last report, rad."""

    def observe(self, obs: Observation) -> bool:
        """Process an observation. Return True to cancel the running leg.

        Its perimeter pass is complete, or an unswept wall is beside its lane.
        """
        self._see_correction(obs)
        self._see_heading(obs.heading_sigma_rad)
        self.obs = obs
        self._see_cliff(obs)
        self._evidence_map.update(obs)
        wall = self.wall
        straight = abs(obs.yaw_rate_rad_s) < self._options.straight_rad_s
        self.speed_limit_m_s = self._evidence_map.speed_limit_m_s(
            obs.pose, wall.side, self._brake, self._contact_m_s, straight=straight
        )
        if wall.side and not straight:
            self.speed_limit_m_s = min(self.speed_limit_m_s, self._model.cruise_speed_m_s)
        if not wall.side:
            return self.on_lane and self._sees_wall_beside(obs)
        return self._follow(obs)

    def end_segment(self) -> None:
        """End the current wall segment and the wall following."""
        self._segments.end(self.obs.pose, self.wall.side)
        self.wall.side = 0

    def fresh_along(self, pose: Pose2, side: int) -> float:
        """Return the unswept share of the strip next to a wall on the left (1) or right (-1)."""
        low, high = self._geometry.band_m
        return self._evidence_map.fresh(
            pose, self._geometry.band_ahead_m, (low, high) if side > 0 else (-high, -low)
        )

    @property
    def grid_rad(self) -> float:
        """Main direction of the walls that were followed so far, rad; 0 before the first wall."""
        if not self._direction:
            return 0.0
        return math.atan2(self._direction.imag, self._direction.real) / 4.0

    # -- internal ------------------------------------------------------------------------------

    def _follow(self, obs: Observation) -> bool:
        """Process an observation during a perimeter pass. Return True if the pass is complete."""
        wall = self.wall
        last, wall.last_pose = wall.last_pose, obs.pose
        rounds_corner = abs(obs.yaw_rate_rad_s) >= self._geometry.round_rad_s
        self._segments.follow(obs.pose, wall.side, straight=not rounds_corner)
        if last is None:
            return False
        step_m = last.distance_m(obs.pose)
        wall.distance_m += step_m
        if (
            abs(obs.yaw_rate_rad_s) < self._options.steady_rad_s
            and obs.v_m_s > self._options.steady_m_s
        ):
            angle = 4.0 * obs.pose.theta_rad
            self._direction += step_m * complex(math.cos(angle), math.sin(angle))
        if wall.distance_m - wall.checked_m < self._options.check_m:
            return False
        wall.checked_m = wall.distance_m
        if self.fresh_along(obs.pose, wall.side) < self._options.fresh_share:
            wall.stale += 1
        else:
            wall.stale = 0
        return wall.stale > 1 and wall.distance_m > wall.min_m

    def _see_cliff(self, obs: Observation) -> None:
        """Store the pose at which the floor was first missing.

        The robot stops later than at this pose.
        """
        if not obs.cliff:
            self.cliff_at = None
        elif self.cliff_at is None:
            self.cliff_at = obs.pose

    def _see_correction(self, obs: Observation) -> None:
        """Report a pose correction: the estimate has moved farther than the robot."""
        last = self.obs
        dx, dy = obs.pose.x_m - last.pose.x_m, obs.pose.y_m - last.pose.y_m
        if abs(dx) + abs(dy) < self._options.correction_m:
            return
        path_m = max(abs(obs.v_m_s), abs(last.v_m_s)) * max(obs.time_s - last.time_s, 0.0)
        jump_m = math.hypot(dx, dy) - path_m
        if jump_m > self._options.correction_m:
            if self.wall.side:
                self._segments.end(last.pose, self.wall.side)
            self._record.decide(
                "re-zero", "a known wall corrected the pose", jump_m=round(jump_m, 4)
            )

    def _see_heading(self, sigma_rad: float) -> None:
        """Report that walls reduced the heading's standard deviation.

        Without walls it only grows.
        """
        max_rad, options = self._max_sigma_rad, self._options
        if sigma_rad > max_rad:
            self._max_sigma_rad = sigma_rad
        elif max_rad > options.reported_rad and sigma_rad < options.reported_share * max_rad:
            self._max_sigma_rad = sigma_rad
            self._record.decide(
                "re-zero",
                "known walls reduced the heading uncertainty",
                uncertainty_deg=round(math.degrees(sigma_rad), 2),
                before_deg=round(math.degrees(max_rad), 2),
            )

    def _sees_wall_beside(self, obs: Observation) -> bool:
        """Return True if there is a wall with an unswept perimeter beside the lane."""
        if (
            abs(obs.yaw_rate_rad_s) > self._options.steady_rad_s
            or obs.v_m_s < self._options.on_lane_m_s
        ):
            return False
        left_m, right_m = self._geometry.beside_lane_ahead_m
        for side, mount, range_m, ahead_m in (
            (1, self._model.infrared_left, obs.infrared_left_m, left_m),
            (-1, self._model.infrared_right, obs.infrared_right_m, right_m),
        ):
            if range_m is None:
                continue
            gap_m = range_m + abs(mount.y_m) - self._model.radius_m
            if gap_m > self._geometry.beside_lane_gap_m + _ROUNDING_M:
                continue
            low, high = (max(gap_m, 0.0) + edge_m for edge_m in self._geometry.beside_lane_m)
            band = (low, high) if side > 0 else (-high, -low)
            unswept = self._evidence_map.fresh(obs.pose, (0.0, ahead_m), band)
            if unswept > self._options.beside_unswept:
                self.beside = side
                return True
        return False

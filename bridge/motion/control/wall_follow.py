"""Wall following with one side infrared sensor, at a constant distance or in light contact.

Without that sensor the robot drives a curve towards the wall until it contacts the wall. The
planner then turns the robot away from the wall, and the next leg begins.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.control.braking import BrakingTuning
from bridge.motion.control.confirmed_range import ConfirmedRange
from bridge.motion.estimation.noise_monitor import RangingNoise, RangingTuning
from bridge.motion.estimation.wall_track import MAX_YAW_RAD, TrackTuning, WallTrack
from bridge.motion.observation import (
    HALT,
    INFRARED_PERIOD_S,
    Observation,
    VelocityCommand,
)

if TYPE_CHECKING:
    from bridge.motion.control.braking import Braking
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel


class Side(enum.IntEnum):
    """Side of the infrared sensor.

    Multiplication by this value mirrors a right wall to the left.
    """

    LEFT = 1
    RIGHT = -1


class FollowState(enum.StrEnum):
    """State of wall following."""

    FOLLOWING = "following"
    CORNER = "corner"
    """The wall has ended at an outer corner, and the robot drives round the corner."""
    LOST = "lost"
    """The robot has lost the wall and has found no wall round the corner. It halts."""
    BLOCKED = "blocked"
    """An inner corner, an obstacle or a cliff is ahead. The robot halts."""


class _Contact(enum.Enum):
    """What the bumper switches and the cliff sensor say about the followed wall."""

    NONE = enum.auto()
    """No switch is pressed."""
    WALL = enum.auto()
    """The followed wall presses the switch on its side."""
    AHEAD = enum.auto()
    """An obstacle or a cliff is ahead."""


class FollowStep(NamedTuple):
    """Result of one control step."""

    command: VelocityCommand
    """Velocity before smoothing. The smoothing applies the acceleration limit."""
    state: FollowState
    yaw_rad: float
    """Heading minus the wall's direction, rad; positive: towards the wall."""


@dataclass(frozen=True, slots=True)
class FollowTuning:
    """Gains and limits; lengths are in m, angles in rad.

    A value without another source was chosen in runs of the virtual robot at the noise levels
    ``typical`` and ``harsh``.
    """

    lookahead_m: float = 0.11
    """Distance ahead of the robot at which its heading meets the line to follow, m."""
    yaw_gain_s: float = 4.0
    """Gain from the heading error (rad) to the yaw rate (rad/s), 1/s."""
    approach_rad: float = math.radians(20.0)
    """Maximum angle between the heading and the wall, rad."""
    contact_m_s: float = 0.015
    """Maximum lateral speed in the approach to a contact, m/s: half the minimum speed of a
    collision."""
    press_m: float = 0.004
    """Depth inside the wall that is the target in light contact, m. Range noise then does not end
    the contact."""
    corner_gap_m: float = 0.005
    """Minimum gap with which the robot drives round a corner, m. The corner's position is known
    with this accuracy."""
    stop_gap_m: float = 0.008
    """Gap between the rim and a wall ahead at which the robot halts, m. The robot does not sweep
    the floor beyond its stopping point, so it drives into inner corners."""
    jump_m: float = 0.02
    """Minimum difference between reading and prediction that means another surface, m."""
    gate_sigmas: float = 4.0
    """Maximum difference between reading and prediction on the same surface, in standard
    deviations of this difference. It is at least ``jump_m``."""
    round_rad: float = math.radians(420.0)
    """Turn round a corner after which the wall counts as lost if none was found, rad. The infrared
    beam often misses a table leg, so the robot must be able to follow it all around."""
    nudge_s: float = 0.5
    """Maximum time for which the followed wall may press a bumper switch, s. After this time the
    switch means an obstacle ahead."""
    yaw_rate_share: float = 0.75
    """Maximum share of the yaw rate limit. The rest is for control."""
    error_factor: float = 2.0
    """Factor of the heading error e in the speed: the robot drives at cos(factor · e) of the set
    speed."""
    min_pace: float = 0.2
    """Minimum speed at a large heading error, relative to the set speed."""
    sure_rad: float = 0.1
    """Standard deviation of a wall's direction above which the steering gain is reduced in
    proportion, rad."""
    contact_path_m: float = 0.01
    """Length of the path before a contact that is driven at contact speed, independent of the
    range, m."""
    blind_margin_m: float = 0.002
    """Additional gap beyond the infrared's minimum range, m. Below that range the reading is
    constant, so the robot would press against the wall."""
    max_away_rad: float = math.radians(60.0)
    """Maximum turn in place from a contact at a corner, rad. If the switch is still pressed, the
    obstacle is ahead."""
    nudge_m_s: float = 0.05
    """Maximum speed while the wall presses a bumper switch, m/s. The robot slips sideways, and the
    wheel encoders do not measure this slip."""
    nudge_share: float = 0.25
    """Angle of the heading away from a wall that presses a bumper switch, relative to
    ``approach_rad``."""
    pressed_rad: float = math.radians(5.0)
    """Assumed minimum angle of the heading towards the wall that presses a bumper switch, rad. The
    bumper does not cover the side of the robot, so the heading points into the wall."""

    # -- corners ---------------------------------------------------------------------------------
    corner_m_s: float = 0.09
    """Speed around a corner, m/s. A contact there is about 72° off the heading, so its speed along
    the normal is 0.028 m/s and harmless."""
    thin_m: float = 0.08
    """Maximum followed length of an object that may be a thin leg, m. A leg has no wall
    direction."""
    circle_rad: float = 0.3
    """Maximum correction of the heading for an error of the distance to a corner, rad."""
    find_radii: float = 2.0
    """Maximum lateral distance of a wall beyond a corner, in radii of the footprint."""
    corner_sigma_m: float = 0.01
    """Standard deviation of a corner's position, m: the path between two readings at low speed."""
    max_corner_sigma_rad: float = 0.5
    """Maximum standard deviation of the direction of a wall found round a corner, rad."""
    yaw_margin_rad: float = math.radians(10.0)
    """Margin between the direction of a wall found round a corner and the limit of the track,
    rad."""

    # -- obstacles ahead -------------------------------------------------------------------------
    held_s: float = 0.12
    """Age from which an equal ultrasonic value counts as a new reading, s. The sensor repeats a
    reading for a shorter time."""
    silent_s: float = 0.3
    """Time without an echo after which the path ahead counts as free, s."""
    leap_m: float = 0.1
    """Minimum decrease between two readings that means another object, m. No robot drives this far
    between two readings."""

    # -- without side infrared -------------------------------------------------------------------
    by_contact_m_s: float = 0.10
    """Speed along a wall that is followed by contact only, m/s. After 12 cm of the curve the robot
    contacts the wall with 0.026 m/s along the normal."""
    by_contact_radii: float = 2.8
    """Radius at the beginning of the curve towards a wall that is followed by contact only, in
    radii of the footprint."""
    ranging: RangingTuning = field(default_factory=RangingTuning)
    """Gap to the wall for a noisy infrared sensor."""
    track: TrackTuning = field(default_factory=TrackTuning)
    """Filter that estimates the wall."""


class WallFollower:
    """Drives along the wall on one side.

    Call ``step`` with every observation and pass its result through the smoothing. Wall following
    starts with the first reading of a wall. From then on the filter of ``wall_track`` estimates the
    wall's distance, direction and bend b. The heading setpoint ψ* points towards the line at the
    set distance, at ``lookahead_m`` ahead. The yaw rate is ω = K·(ψ* - ψ) + v·b, with a smaller K
    while ψ is uncertain. Near the wall the heading is limited so that the lateral speed is less
    than ``contact_m_s``.

    At the end of the wall the robot drives straight until the end is beside its axle. It then
    drives round the end at the set distance until the infrared sensor detects a wall again. The
    corner and this reading immediately give the new wall's direction.

    If the followed wall presses a bumper switch, the robot steers away from it for at most
    ``nudge_s``. The beam often misses a face as short as a table leg's, and the next corner presses
    the switch. At a corner the robot turns away in place by at most ``max_away_rad``. When the
    contact has left the switch, the robot drives round the contact. The other switch means an
    obstacle ahead.
    """

    def __init__(  # noqa: PLR0913 - a robot, a wall, and how to follow it
        self,
        model: RobotModel,
        side: Side,
        distance_m: float,
        *,
        speed_m_s: float | None = None,
        tuning: FollowTuning | None = None,
        brake: Braking | None = None,
        noise: RangingNoise | None = None,
    ) -> None:
        """Follow a wall with the gap ``distance_m`` to the rim; 0: in light contact.

        ``brake`` limits the speed ahead of an obstacle.

        Raises:
            ValueError: the distance is negative or beyond the sensor's range, or the speed is not
                positive.

        """
        self._side = side
        mount = model.infrared_left if side is Side.LEFT else model.infrared_right
        self._mount = mount
        self._radius_m = model.radius_m
        contact_m = mount.contact_range_m(model.radius_m)
        max_gap_m = mount.max_range_m - contact_m if mount.fitted else math.inf
        if not 0.0 <= distance_m < max_gap_m:
            raise ValueError(f"wall distance must be in [0, {max_gap_m:g}) m, not {distance_m!r}")
        speed = model.cruise_speed_m_s if speed_m_s is None else speed_m_s
        if not speed > 0.0:
            raise ValueError(f"speed must be positive, not {speed!r}")
        self._tune = tune = tuning or FollowTuning()
        self._speed = min(speed, model.max_speed_m_s)
        self._gap_m = distance_m if distance_m > 0.0 else -tune.press_m
        blind_m = mount.min_range_m - contact_m
        if blind_m > 0.0:
            self._gap_m = max(self._gap_m, blind_m + tune.blind_margin_m)
        self._max_rate = tune.yaw_rate_share * model.max_yaw_rate_rad_s
        self._brake = brake or BrakingTuning().of(model.max_accel_m_s2)
        self._room = ConfirmedRange(
            model.ultrasonic.contact_range_m(model.radius_m) + tune.stop_gap_m,
            held_s=tune.held_s,
            silent_s=tune.silent_s,
            leap_m=tune.leap_m,
        )
        self._track = WallTrack(mount, tune.track)
        self._noise = noise or RangingNoise(tune.ranging)
        self._pose: Pose2 | None = None
        self._last_range_m: float | None = None
        self._age_s = 0.0
        self._state = FollowState.LOST
        self._corner = (0.0, 0.0)
        self._turned_rad = 0.0
        self._arcing = False
        self._silent_s = 0.0
        self._pressed_s = 0.0
        self._turned_away_rad = 0.0
        """Turn away from the contact that presses the switch, rad."""
        self._straight_m = math.inf
        self._path_m = 0.0
        """Path since the beginning, for a wall that is followed by contact only, m."""

    def step(
        self, observation: Observation, dt_s: float, speed_limit_m_s: float = math.inf
    ) -> FollowStep:
        """Return the velocity for this control step, and the state of wall following.

        ``speed_limit_m_s`` is the maximum forward speed at present.
        """
        ahead_m, into_rad = self._motion(observation.pose)
        if not self._mount.fitted:
            return self._follow_by_contact(observation, ahead_m, into_rad, dt_s, speed_limit_m_s)
        self._track.move(ahead_m, into_rad, self._radius_m)
        self._see(observation, dt_s, ahead_m, into_rad)
        self._straight_m += abs(ahead_m)
        if self._state is FollowState.CORNER:
            self._straight_m = 0.0
        command = self._drive(observation, dt_s, speed_limit_m_s)
        return FollowStep(command, self._state, self._track.yaw_rad)

    def go_round(self, ahead_m: float, aside_m: float) -> None:
        """Begin to circle a point in the body frame. ``aside_m`` is positive on the wall's side.

        This is used for contacts without a range: a bump, or a leg that is too thin for the beam.
        """
        self._corner = (ahead_m, aside_m)
        self._turned_rad = self._straight_m = 0.0
        self._arcing = False
        self._state = FollowState.CORNER

    def _follow_by_contact(
        self, obs: Observation, ahead_m: float, into_rad: float, dt_s: float, limit_m_s: float
    ) -> FollowStep:
        """Curve towards a wall that no sensor detects, more and more sharply, until contact."""
        self._path_m += abs(ahead_m)
        self._turned_rad += into_rad
        speed = min(self._speed, limit_m_s, self._tune.by_contact_m_s)
        room = self._room.update(obs.ultrasonic_m, self._brake.run_out(obs.v_m_s), dt_s)
        bumped = obs.bumper_left or obs.bumper_right or obs.cliff
        if self._room.is_blocked or bumped:
            return FollowStep(self._halt(), self._state, 0.0)
        if self._turned_rad > self._tune.round_rad:
            self._state = FollowState.LOST
            return FollowStep(HALT, self._state, 0.0)
        self._state = FollowState.FOLLOWING
        min_bend_m = self._radius_m + self._tune.corner_gap_m
        bend_m = max(self._tune.by_contact_radii * self._radius_m - self._path_m, min_bend_m)
        speed = min(speed, self._brake.speed(room))
        command = VelocityCommand(speed, self._side * min(speed / bend_m, self._max_rate))
        return FollowStep(command, self._state, 0.0)

    # -- sensing ---------------------------------------------------------------------------

    def _motion(self, pose: Pose2) -> tuple[float, float]:
        """Return the forward path and the turn towards the wall since the last step."""
        last, self._pose = self._pose, pose
        if last is None:
            return 0.0, 0.0
        turn = math.remainder(pose.theta_rad - last.theta_rad, math.tau)
        mid = last.theta_rad + 0.5 * turn
        ahead = (pose.x_m - last.x_m) * math.cos(mid) + (pose.y_m - last.y_m) * math.sin(mid)
        return ahead, self._side * turn

    def _see(self, obs: Observation, dt_s: float, ahead_m: float, into_rad: float) -> None:
        range_m = obs.infrared_left_m if self._side is Side.LEFT else obs.infrared_right_m
        self._age_s += dt_s
        fresh = range_m != self._last_range_m or self._age_s >= INFRARED_PERIOD_S
        self._last_range_m = range_m
        if self._state is FollowState.CORNER:
            self._round(ahead_m, into_rad)
        if not fresh:
            return
        self._age_s = 0.0
        if self._state is FollowState.CORNER:
            if self._pressed_s == 0.0:
                self._find(range_m)
        elif self._track.distance_m is None:
            if range_m is not None:
                self._track.begin(range_m)
                self._state = FollowState.FOLLOWING
        elif range_m is None or not self._take(range_m):
            self._miss(range_m, obs.v_m_s)
        else:
            self._silent_s = 0.0
            self._state = FollowState.FOLLOWING

    def _take(self, range_m: float) -> bool:
        expected, sure = self._track.expected_m(), self._track.yaw_sigma_rad < self._tune.sure_rad
        if not self._track.take(range_m, self._tune.gate_sigmas, self._tune.jump_m):
            return False
        if expected is not None and sure:
            self._noise.learn(range_m - expected)
        return True

    def _miss(self, range_m: float | None, v_m_s: float) -> None:
        """Handle a reading of another surface.

        A nearer one is another wall, a farther one an end.
        """
        expected = self._track.expected_m()
        if range_m is not None and expected is not None and range_m < expected:
            self._track.begin(range_m)
            self._silent_s = 0.0
            return
        self._silent_s += INFRARED_PERIOD_S
        if self._silent_s < 1.5 * INFRARED_PERIOD_S:  # ignore a single missing reading
            return
        self._silent_s = 0.0
        if expected is None:
            self._track.clear()
            self._state = FollowState.LOST
            return
        # The end is between the last hit and the first missing reading, on average 1.5 reading
        # periods before the present reading.
        behind = 1.5 * INFRARED_PERIOD_S * v_m_s
        self._corner = (self._mount.x_m - behind, abs(self._mount.y_m) + expected)
        self._turned_rad = 0.0
        self._arcing = False
        self._state = FollowState.CORNER
        self._track.clear()

    def _round(self, ahead_m: float, into_rad: float) -> None:
        """Update the corner in the body frame. The lateral axis is positive on the wall's side."""
        x, y = self._corner
        x -= ahead_m
        c, s = math.cos(into_rad), math.sin(into_rad)
        self._corner = (c * x + s * y, c * y - s * x)
        self._turned_rad += into_rad
        if self._pressed_s > 0.0:
            self._turned_away_rad -= into_rad

    def _find(self, range_m: float | None) -> None:
        """Search for the wall beyond the corner."""
        tune = self._tune
        if self._turned_rad > tune.round_rad:
            self._state = FollowState.LOST
            return
        if range_m is None:
            return
        corner_x, corner_y = self._corner
        hit_x, hit_y = self._mount.x_m, abs(self._mount.y_m) + range_m
        apart_m = math.hypot(hit_x - corner_x, hit_y - corner_y)
        if apart_m < tune.jump_m or hit_y - corner_y > tune.find_radii * self._radius_m:
            return
        yaw = -math.atan2(hit_y - corner_y, hit_x - corner_x)
        if abs(yaw) > MAX_YAW_RAD - tune.yaw_margin_rad:
            return
        self._track.begin(
            range_m, yaw, min(tune.corner_sigma_m / apart_m, tune.max_corner_sigma_rad)
        )
        self._state = FollowState.FOLLOWING

    # -- driving ---------------------------------------------------------------------------

    def _drive(self, obs: Observation, dt_s: float, speed_limit_m_s: float) -> VelocityCommand:
        tune = self._tune
        speed = min(self._speed, speed_limit_m_s)
        if self._straight_m < tune.thin_m:
            speed = min(speed, tune.corner_m_s)
        room = self._room.update(obs.ultrasonic_m, self._brake.run_out(obs.v_m_s), dt_s)
        if self._room.is_blocked:
            return self._halt()
        speed = min(speed, self._brake.speed(room))
        contact = self._contact(obs, dt_s)
        if contact is _Contact.AHEAD:
            return self._halt()
        nudge = contact is _Contact.WALL
        if self._state is FollowState.CORNER:
            return self._circle(speed, nudge=nudge)
        distance = self._track.distance_m
        if distance is None:
            self._state = FollowState.LOST
            return HALT
        if self._state is FollowState.BLOCKED:
            self._state = FollowState.FOLLOWING
        gap_m = self._gap_m + (self._noise.stand_off_m if self._gap_m > 0.0 else 0.0)
        off = distance - self._radius_m - gap_m
        gap = max(distance - self._radius_m, 0.0)
        # A contact must be slow along the normal. So the maximum angle decreases with the gap.
        across = tune.contact_m_s + max(gap - tune.contact_path_m, 0.0)
        steepest = min(tune.approach_rad, math.asin(min(across / speed, 1.0)))
        yaw = self._track.yaw_rad
        if nudge:
            speed = min(speed, tune.nudge_m_s)
            yaw = max(yaw, tune.pressed_rad)
            aim = -tune.nudge_share * tune.approach_rad
        else:
            aim = off / tune.lookahead_m
        aim = max(min(aim, steepest), -tune.approach_rad)
        error = aim - yaw
        sure = min(1.0, tune.sure_rad / max(self._track.yaw_sigma_rad, 1e-6))
        gain = tune.yaw_gain_s * (1.0 if nudge else sure)
        speed *= max(math.cos(min(tune.error_factor * abs(error), 0.5 * math.pi)), tune.min_pace)
        rate = gain * error + speed * self._track.bend_rad_m
        return VelocityCommand(speed, self._side * max(min(rate, self._max_rate), -self._max_rate))

    def _circle(self, speed: float, *, nudge: bool) -> VelocityCommand:
        """Drive on until the corner is beside the axle, then drive round it at the set distance."""
        tune = self._tune
        radius = self._radius_m + max(self._gap_m, tune.corner_gap_m)
        slow = min(speed, tune.corner_m_s)
        if nudge:  # the contact is ahead of the axle: turn until it leaves the switch, abeam
            return VelocityCommand(0.0, -self._side * self._max_rate)
        x, y = self._corner
        if x > 0.0 and not self._arcing:
            return VelocityCommand(slow, 0.0)
        self._arcing = True
        # Drive round a point: ω = v/R if the corner is abeam. Distance and bearing are controlled.
        far = math.hypot(x, y) - radius
        bearing = math.atan2(-x, y)
        turn = slow / radius + tune.yaw_gain_s * (
            bearing + max(min(far / tune.lookahead_m, tune.circle_rad), -tune.circle_rad)
        )
        return VelocityCommand(slow, self._side * max(min(turn, self._max_rate), -self._max_rate))

    def _contact(self, obs: Observation, dt_s: float) -> _Contact:
        left = self._side is Side.LEFT
        near, other = obs.bumper_left, obs.bumper_right
        if not left:
            near, other = other, near
        if other or obs.cliff:
            return _Contact.AHEAD
        if not near:
            if self._pressed_s > 0.0 and self._state is FollowState.CORNER:
                # The robot has turned until the contact left the switch at its end, abeam.
                self._corner = (0.0, self._radius_m)
            self._pressed_s = self._turned_away_rad = 0.0
            return _Contact.NONE
        self._pressed_s += dt_s
        if self._state is FollowState.CORNER:
            is_wall = self._turned_away_rad < self._tune.max_away_rad
        else:
            distance = self._track.distance_m
            beside = distance is not None and distance - self._radius_m < self._tune.jump_m
            is_wall = beside and self._pressed_s < self._tune.nudge_s
        return _Contact.WALL if is_wall else _Contact.AHEAD

    def _halt(self) -> VelocityCommand:
        self._state = FollowState.BLOCKED
        return HALT

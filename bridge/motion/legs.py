"""Legs: motion primitives that a planner gives to the controllers, and their results."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive along a line in the direction of a heading.

    The line starts at the robot's position or beside it. This is the paper's "set the target's x to
    infinity". The distance is only a limit. Without a distance the robot follows the line until a
    sensor stops it.
    """

    heading_rad: float
    """Direction of the line in the frame of the estimate, rad."""
    distance_m: float | None = None
    """Length along the line, m; negative: backwards; None: no limit."""
    speed_m_s: float | None = None
    """Speed, m/s; None: the robot's cruise speed."""
    stop_range_m: float | None = None
    """Ultrasonic range at which the leg stops, m; None: the range does not stop the leg."""
    timeout_s: float | None = None
    """Time limit, s. None: twice the expected time plus 5 s, or 600 s if there is no distance."""
    end_m_s: float = 0.0
    """Maximum speed at the end of the leg, m/s. The next leg then follows immediately. 0: the leg
    ends at standstill."""
    wary: bool = False
    """True: slow down for obstacles that have left the ultrasonic cone."""
    purpose: str = "drive"
    """Purpose of the leg, for events and lane lengths. It does not affect the motion."""
    across_m: float = 0.0
    """Distance of the line from the robot's position, m; positive: to the left of the heading."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn in place to a heading, in the shorter direction; or turn along an arc to a line."""

    heading_rad: float
    """Heading at the end, rad."""
    flowing: bool = False
    """True: end the leg during the turn, within ``MotionTuning.flow_rad`` of the heading. The next
    leg follows immediately and steers to the heading."""
    timeout_s: float | None = None
    """Time limit, s. None: twice the expected time plus 5 s, and at least 15 s."""
    purpose: str = "turn"
    """As for ``Drive``."""
    across_m: float = 0.0
    """Distance of the line on which an arc ends, m; positive: to the left of ``heading_rad``. The
    robot turns towards the line. 0: turn in place."""
    ends_at_cliff: bool = False
    """True: a cliff that the sensor first detects during a turn in place ends the leg. A wheel
    could reach this cliff later in the turn."""


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive straight to a point. If the point is far off the heading, turn in place first."""

    x_m: float
    """Point in the frame of the estimate, m."""
    y_m: float
    """Point in the frame of the estimate, m."""
    speed_m_s: float | None = None
    """As for ``Drive``."""
    stop_range_m: float | None = None
    """As for ``Drive``."""
    timeout_s: float | None = None
    """As for ``Drive``."""
    purpose: str = "goto"
    """As for ``Drive``."""


@dataclass(frozen=True, slots=True)
class Dwell:
    """Stand still, so that the estimator can measure the gyro bias."""

    duration_s: float
    """Duration of the standstill, s."""
    purpose: str = "dwell"
    """As for ``Drive``."""


@dataclass(frozen=True, slots=True)
class FollowWall:
    """Follow the wall on one side with the infrared sensor of that side.

    The leg ends at an obstacle ahead, if the wall is lost, after ``distance_m``, or if the planner
    cancels it.
    """

    left: bool
    """True if the wall is on the left."""
    gap_m: float
    """Gap between rim and wall, m; 0: light contact."""
    touching: bool = False
    """True: begin with a contact on that side, even if the infrared sensor does not detect the
    wall."""
    distance_m: float | None = None
    """Maximum length of the path, m; None: no limit."""
    speed_m_s: float | None = None
    """Speed, m/s; None: the robot's cruise speed."""
    timeout_s: float = 600.0
    """Time limit, s."""
    purpose: str = "perimeter"
    """As for ``Drive``."""


Leg = Drive | Turn | GoTo | Dwell | FollowWall


class StopReason(enum.StrEnum):
    """Reason why a leg ended."""

    DONE = "done"
    """The robot has reached the heading or the point, or the standstill is over."""
    DISTANCE = "distance"
    """The robot has driven the distance."""
    RANGE = "range"
    """The ultrasonic range has reached the stop range."""
    BUMPER = "bumper"
    """A bumper switch has closed."""
    CLIFF = "cliff"
    """The cliff sensor has detected no floor."""
    STALLED = "stalled"
    """The robot was commanded to move, but its estimate did not change."""
    TIMEOUT = "timeout"
    """The time limit is over."""
    LOST = "lost"
    """There is no wall to follow."""
    CANCELLED = "cancelled"
    """The planner has cancelled the leg; the robot may still move."""

    @property
    def blocked(self) -> bool:
        """True if the leg ended before its goal: range, bumper, cliff, stall or time limit.

        False also for a lost wall and a cancelled leg.
        """
        return self not in _GOALS


_GOALS = frozenset(
    {StopReason.DONE, StopReason.DISTANCE, StopReason.LOST, StopReason.CANCELLED},
)


@dataclass(frozen=True, slots=True)
class LegResult:
    """Result of a leg.

    The robot stands, except after a flowing or a cancelled leg, or a drive with ``end_m_s``.
    """

    leg: Leg
    """The leg that has ended."""
    reason: StopReason
    """Reason why it ended."""
    distance_m: float
    """Distance along the leg's line, m, with the sign of ``Drive.distance_m``; the length of the
    path of a ``FollowWall``; 0 for a turn or a dwell."""
    duration_s: float
    """Duration of the leg, s."""
    pose: Pose2
    """Estimated pose at the end."""
    bumper_left: bool = False
    """True if the left bumper switch was closed when the robot began to stop, or at the end."""
    bumper_right: bool = False
    """True if the right bumper switch was closed when the robot began to stop, or at the end."""

"""Legs: motion primitives that a planner gives to the controllers, and their results."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive along a heading line through the position at the start of the leg.

    This is the paper's "set the target's x to infinity". The distance is only a limit; without it
    the robot follows the line until a sensor stops it.
    """

    heading_rad: float
    distance_m: float | None = None
    """Length along the line, m; negative: backwards; None: no limit."""
    speed_m_s: float | None = None
    """Speed, m/s; None: the robot's cruise speed."""
    stop_range_m: float | None = None
    """Ultrasonic range at which the leg stops, m; None: no such stop."""
    timeout_s: float | None = None
    """Time limit, s. None: twice the expected time plus 5 s, or 600 s without a distance."""
    end_m_s: float = 0.0
    """Maximum speed at which the leg may end at its distance, m/s. The next leg then follows at
    once. 0: the leg ends at rest."""
    wary: bool = False
    """True: slow down for obstacles that have left the ultrasonic cone."""
    purpose: str = "drive"
    """Purpose, for events and lane lengths; it does not affect the motion."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn in place to a heading, in the shorter direction."""

    heading_rad: float
    flowing: bool = False
    """True: end within ``MotionTuning.flow_rad`` of the heading, still turning. The next leg steers
    and follows at once."""
    timeout_s: float = 15.0
    purpose: str = "turn"


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive to a point in a straight line, after a turn in place if it is far off the heading."""

    x_m: float
    y_m: float
    speed_m_s: float | None = None
    stop_range_m: float | None = None
    timeout_s: float | None = None
    purpose: str = "goto"


@dataclass(frozen=True, slots=True)
class Rest:
    """Stand still, so that the estimator can measure the gyro bias."""

    duration_s: float
    purpose: str = "rest"


@dataclass(frozen=True, slots=True)
class FollowWall:
    """Drive along the wall on one side, with that side's infrared sensor.

    The leg ends at an obstacle ahead, when the wall is lost, after ``distance_m``, or when the
    planner cancels it.
    """

    left: bool
    """True if the wall is on the left."""
    gap_m: float
    """Gap between rim and wall, m; 0: light contact."""
    touching: bool = False
    """True: begin with a contact on that side, even if the infrared sensor does not detect it."""
    distance_m: float | None = None
    speed_m_s: float | None = None
    timeout_s: float = 600.0
    purpose: str = "perimeter"


Leg = Drive | Turn | GoTo | Rest | FollowWall


class StopReason(enum.StrEnum):
    """Reason why a leg ended."""

    DONE = "done"
    """The heading or the point was reached, or the rest is over."""
    DISTANCE = "distance"
    """The distance was driven."""
    RANGE = "range"
    """The ultrasonic range has reached the stop range."""
    BUMPER = "bumper"
    CLIFF = "cliff"
    STALLED = "stalled"
    """The robot was commanded to move, but its estimate did not change."""
    TIMEOUT = "timeout"
    LOST = "lost"
    """There is no wall to follow."""
    CANCELLED = "cancelled"
    """The planner has cancelled the leg; the robot may still move."""

    @property
    def blocked(self) -> bool:
        """True if an obstacle, a cliff or a missing wall ended the leg, not its own goal."""
        return self not in _GOALS


_GOALS = frozenset(
    {StopReason.DONE, StopReason.DISTANCE, StopReason.LOST, StopReason.CANCELLED},
)


@dataclass(frozen=True, slots=True)
class LegResult:
    """Result of a leg. The robot is at rest, except after a flowing or a cancelled leg."""

    leg: Leg
    reason: StopReason
    distance_m: float
    """Distance along the leg's line, m, with the sign of ``Drive.distance_m``; 0 for a turn."""
    duration_s: float
    pose: Pose2
    bumper_left: bool = False
    bumper_right: bool = False

"""What contact does to the estimate: wheels tell a way that a touched thing does not let happen.

Pressed to a wall by one half of the bumper the robot slides along it and not into it. The wall is
then some 80° off the bow (nearer to the bow it is stopped at once), so that of the way the wheels
tell cos 80° is missing towards the wall, every time and for as long as the touch lasts. That much
is taken back; the rest of the error is one error for the whole touch, and is doubted as one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.estimation.estimator import PoseEstimator

BUMP_SIGMA_M = 0.01
BUMP_SIGMA_RAD = math.radians(0.5)
"""What a touch moves the robot beyond what its wheels tell."""
FELT_SIGMA_M = 0.0012
FELT_SIGMA_RAD = math.radians(0.05)
"""The same where the accelerometer tells of hard touches: what is left are soft ones."""
SLIDE_ASIDE, SLIDE_AHEAD = 0.18, 0.05
"""Of the way that the wheels tell while one half is pressed: what is not made, towards that side
and ahead. Measured over some 700 touches at ``typical`` and ``harsh``, where it is the same."""
SLIDE_SHARE, PRESS_SHARE = 0.1, 0.3
"""What is left of that (standard deviation over a touch), and where both halves are pressed or
no accelerometer tells of the touch."""
GRAZE_M_SQRT_M = 0.0007
"""Per √m of a wall that is rubbed against abeam, for wheels that slip as little as is nominal: it
pushes aside, and its friction holds back."""
_READING_M, _STUCK_M = 0.02, 0.3
"""The most that is driven from one reading to the next; and along a touch: what is pressed for
longer is a switch that is stuck, and slides along nothing."""
_FREE_READINGS = 4
"""Of a bumper that is free again: 0.15 s."""


class ContactUncertainty:
    """Takes back what wheels tell and contact withholds, and grows the doubt."""

    def __init__(self, estimator: PoseEstimator) -> None:
        """``estimator``: whose pose and covariance are changed."""
        self._estimator = estimator
        self._pressed = (False, False)
        self._pressed_m = 0.0
        self._free = 0
        self._met = False
        self._last = estimator.odometry

    def update(self, *, left: bool, right: bool, grazing: bool) -> float:
        """Take the bumper's halves, and whether a wall is rubbed against abeam.

        Returns the way since the last reading, m, before anything of it is taken back.
        """
        estimator = self._estimator
        way_m = estimator.odometry.distance_m(self._last)
        self._see_release(pressed=left or right)
        if left or right:
            if not any(self._pressed):
                self._pressed_m = 0.0
                self._inflate_at_onset()
            if not estimator.bridging:
                self._slide(self._ahead_m(), (left, right))
        if grazing and way_m > 0.0:
            sigma_m = GRAZE_M_SQRT_M * estimator.ekf.slip_monitor.slippery
            estimator.ekf.inflate(sigma_m * math.sqrt(way_m), 0.0)
        self._last = estimator.odometry
        self._pressed = (left, right)
        return way_m

    def _see_release(self, *, pressed: bool) -> None:
        """What the bumper felt and has let go holds the body no more.

        Of what it never felt it tells nothing: the shell may be dead, or pass over a sill.
        """
        estimator = self._estimator
        self._free = 0 if pressed else self._free + 1
        self._met = estimator.bridging and (self._met or pressed)
        if pressed:
            estimator.hold()
        if self._met and self._free >= _FREE_READINGS:
            estimator.release()
            self._met = False

    def _ahead_m(self) -> float:
        """Way since the last reading in the direction of the heading; backwards it is free.

        After a gap in the readings nobody knows since when it is pressed: one reading's way counts.
        """
        here, last = self._estimator.odometry, self._last
        c, s = math.cos(here.theta_rad), math.sin(here.theta_rad)
        way_m = (here.x_m - last.x_m) * c + (here.y_m - last.y_m) * s
        return min(max(way_m, 0.0), _READING_M)

    def _inflate_at_onset(self) -> None:
        if self._estimator.feels:
            self._estimator.ekf.inflate(FELT_SIGMA_M, FELT_SIGMA_RAD)
        else:
            self._estimator.ekf.inflate(BUMP_SIGMA_M, BUMP_SIGMA_RAD)

    def _slide(self, way_m: float, pressed: tuple[bool, bool]) -> None:
        """Take a way made while pressed, not negative."""
        if way_m == 0.0:
            return
        left, right = pressed
        estimator, before_m = self._estimator, self._pressed_m
        self._pressed_m += way_m
        one_half = left != right and self._pressed_m < _STUCK_M
        if one_half:
            aside_m = SLIDE_ASIDE * way_m * (-1.0 if left else 1.0)
            estimator.ekf.shift(-SLIDE_AHEAD * way_m, aside_m)
        share = SLIDE_SHARE if one_half and estimator.feels else PRESS_SHARE
        # One error for the whole touch: its standard deviation grows with the way, not its root.
        grown_m = math.sqrt(self._pressed_m**2 - before_m**2)
        estimator.ekf.inflate(share * grown_m, 0.0)

"""Effect of contact on the estimate: the wheels measure a path that an obstacle prevents.

A robot that presses one bumper switch against a wall moves along the wall, not into it. The wall is
then about 80° off the heading (nearer to the heading it stops the robot), so cos 80° of the wheels'
path is missing towards the wall for as long as the contact lasts. That share is subtracted. The
remaining error is one error for the whole contact, and inflates the covariance once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.estimation.estimator import PoseEstimator

BUMP_SIGMA_M = 0.01
BUMP_SIGMA_RAD = math.radians(0.5)
"""Standard deviations (m, rad) of a contact's motion that the wheels do not measure."""
FELT_SIGMA_M = 0.0012
FELT_SIGMA_RAD = math.radians(0.05)
"""The same if the accelerometer measures hard contacts, for the soft ones."""
SLIDE_ASIDE, SLIDE_AHEAD = 0.18, 0.05
"""Shares of the wheels' path that are missing aside and ahead while one switch is pressed,
measured over 700 contacts at ``typical`` and ``harsh`` (equal)."""
SLIDE_SHARE, PRESS_SHARE = 0.1, 0.3
"""Standard deviation of the rest over a contact, as shares of the path: with one switch pressed,
and with both pressed or without an accelerometer."""
GRAZE_M_SQRT_M = 0.0007
"""Standard deviation per √m of grazing a wall abeam with nominal slip, m: the wall pushes the robot
aside, and its friction holds it back."""
_READING_M, _STUCK_M = 0.02, 0.3
"""Maximum path between two readings, and along a contact, m: a switch that is pressed for longer is
stuck."""
_FREE_READINGS = 4
"""Readings of a free bumper that end a contact: 0.15 s."""


class ContactUncertainty:
    """Corrects the pose and inflates the covariance during contacts."""

    def __init__(self, estimator: PoseEstimator) -> None:
        """Correct this estimator."""
        self._estimator = estimator
        self._pressed = (False, False)
        self._pressed_m = 0.0
        self._free = 0
        self._met = False
        self._last = estimator.odometry

    def update(self, *, left: bool, right: bool, grazing: bool) -> float:
        """Take the bumper switches, and whether the robot grazes a wall abeam.

        Returns:
            Path since the last reading, m, before the correction.

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
        """End bridging after a released bumper switch.

        Without a contact of the bumper its state does not count, because the shell may be stuck or
        pass over a sill.
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
        """Return the forward path since the last reading, m.

        After a gap in the readings only one reading's path counts, because the time of the contact
        is unknown.
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
        """Take a path driven with a pressed switch, m, not negative."""
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
        # One error for the whole contact: its standard deviation grows with the path, not with its
        # root.
        grown_m = math.sqrt(self._pressed_m**2 - before_m**2)
        estimator.ekf.inflate(share * grown_m, 0.0)

"""Effect of contacts on the estimate: the wheels turn, but an obstacle prevents the motion.

A robot that presses one bumper switch against a wall moves along the wall, not into it. The wall's
normal is then about 80° off the heading, because a wall with a smaller angle stops the robot. So
the motion towards the wall is missing: a share of cos 80° of the wheels' path. The filter subtracts
this share. The remaining error is constant during a contact, so the covariance is inflated only
once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.motion.estimation.estimator import PoseEstimator


class ContactUncertainty:
    """Corrects the pose and inflates the covariance during contacts."""

    def __init__(self, estimator: PoseEstimator) -> None:
        """Create a correction for ``estimator``."""
        self._estimator = estimator
        self._tuning = estimator.tuning.contact
        self._pressed = (False, False)
        self._pressed_m = 0.0
        self._free = 0
        self._met = False
        self._last = estimator.odometry

    def update(self, *, left: bool, right: bool, grazing: bool) -> float:
        """Use the bumper switches. ``grazing``: the robot grazes a wall beside it.

        Returns:
            Path since the last reading before the correction, m.

        """
        estimator = self._estimator
        path_m = estimator.odometry.distance_m(self._last)
        self._see_release(pressed=left or right)
        if left or right:
            if not any(self._pressed):
                self._pressed_m = 0.0
                self._inflate_at_onset()
            if not estimator.bridging:
                self._slide(self._ahead_m(), (left, right))
        if grazing and path_m > 0.0:
            self._inflate_for_graze(path_m)
        self._last = estimator.odometry
        self._pressed = (left, right)
        return path_m

    def _see_release(self, *, pressed: bool) -> None:
        """End the inertial motion after a bumper switch is released.

        Switches without a measured bump do not count. The bumper may be stuck, or may pass over a
        sill.
        """
        estimator = self._estimator
        self._free = 0 if pressed else self._free + 1
        self._met = estimator.bridging and (self._met or pressed)
        if pressed:
            estimator.hold()
        if self._met and self._free >= self._tuning.free_readings:
            estimator.release()
            self._met = False

    def _ahead_m(self) -> float:
        """Return the forward path since the last reading, m.

        After a gap in the readings, only the path of one reading counts, because the time of the
        contact is unknown.
        """
        here, last = self._estimator.odometry, self._last
        c, s = math.cos(here.theta_rad), math.sin(here.theta_rad)
        path_m = (here.x_m - last.x_m) * c + (here.y_m - last.y_m) * s
        return min(max(path_m, 0.0), self._tuning.reading_m)

    def _inflate_at_onset(self) -> None:
        tuning = self._tuning
        if self._estimator.detects_bumps:
            self._estimator.ekf.inflate(tuning.measured_sigma_m, tuning.measured_sigma_rad)
        else:
            self._estimator.ekf.inflate(tuning.bump_sigma_m, tuning.bump_sigma_rad)

    def _inflate_for_graze(self, path_m: float) -> None:
        """Add the noise of a path along a wall in contact.

        Friction at the wall causes wheel slip. The wall's push depends on the angle between heading
        and wall, and not on the wheels' slip.
        """
        tuning, ekf, root = self._tuning, self._estimator.ekf, math.sqrt(path_m)
        along_m_sqrt_m = tuning.graze_along_m_sqrt_m * ekf.slip_monitor.slippery
        ekf.inflate_slip(along_m_sqrt_m * root, tuning.graze_across_m_sqrt_m * root)

    def _slide(self, path_m: float, pressed: tuple[bool, bool]) -> None:
        """Correct the estimate after a path with a pressed switch; ``path_m`` is not negative."""
        if path_m == 0.0:
            return
        left, right = pressed
        estimator, tuning, before_m = self._estimator, self._tuning, self._pressed_m
        self._pressed_m += path_m
        one_switch = left != right and self._pressed_m < tuning.stuck_m
        if one_switch:
            aside_m = tuning.slide_aside * path_m * (-1.0 if left else 1.0)
            estimator.ekf.shift(-tuning.slide_ahead * path_m, aside_m)
        share = tuning.slide_share if one_switch and estimator.detects_bumps else tuning.press_share
        # The error is constant during the contact. So its standard deviation grows with the path,
        # not with the square root of the path.
        grown_m = math.sqrt(self._pressed_m**2 - before_m**2)
        estimator.ekf.inflate(share * grown_m, 0.0)

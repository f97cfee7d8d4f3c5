"""Errors of the plant: invalid duties and invalid walkers."""

from __future__ import annotations


class DutyError(ValueError):
    """A duty is not a finite number; the caller's error, not a fault of the robot."""

    def __init__(self, left: float, right: float) -> None:
        """Store both duties."""
        self.left, self.right = left, right
        super().__init__(f"duty must be finite, not ({left}, {right})")


class WalkerError(ValueError):
    """A walker without a valid position or size."""

    def __init__(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Store the rejected numbers."""
        self.x_m, self.y_m, self.radius_m = x_m, y_m, radius_m
        super().__init__(
            f"walker must be finite with a radius above 0, not ({x_m}, {y_m}), {radius_m} m",
        )

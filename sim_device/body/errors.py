"""What the plant refuses: numbers that mean no duty and no walker."""

from __future__ import annotations


class DutyError(ValueError):
    """A duty that is not a finite number: a fault of the caller, not of the robot."""

    def __init__(self, left: float, right: float) -> None:
        """Keep both duties."""
        self.left, self.right = left, right
        super().__init__(f"duty must be finite, not ({left}, {right})")


class WalkerError(ValueError):
    """A walker without a place or a size."""

    def __init__(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Keep what was given."""
        self.x_m, self.y_m, self.radius_m = x_m, y_m, radius_m
        super().__init__(
            f"walker must be finite with a radius above 0, not ({x_m}, {y_m}), {radius_m} m",
        )

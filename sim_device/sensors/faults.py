"""What can be broken in the sensors while they run; all is well by default."""

from __future__ import annotations

from dataclasses import dataclass, field

_HALF_WRAP = 1 << 15
_MASK = 0xFFFF
_set = object.__setattr__


@dataclass(slots=True)
class SensorFaults:
    """Knobs to turn at any time; each takes effect at the next reading."""

    imu_frozen: bool = False
    """The registers repeat what they held."""
    gyro_bias_deg_s: tuple[float, float, float] | float = (0.0, 0.0, 0.0)
    """Added to the rates x, y, z before they saturate; a single number is z's."""
    accel_bias_g: tuple[float, float, float] = (0.0, 0.0, 0.0)
    encoder_dropout_left: float = 0.0
    """Share of lost counts, 0..1, in both directions; lost counts stay lost."""
    encoder_dropout_right: float = 0.0
    ultrasonic_blind: bool = False
    """No echo is ever heard."""
    ultrasonic_lie_m: float | None = None
    """Read instead of anything else, blindness included."""
    bumper_stuck_left: bool = False
    """Whether the left switch is stuck pressed."""
    bumper_stuck_right: bool = False
    lifted: bool = False
    """Held up: the cliff sensor sees no floor, the accelerometer feels it (``lift``)."""
    touched: bool = field(default=True, init=False, repr=False, compare=False)
    """Whether any of them was set since the inertial sensor last looked."""

    def __setattr__(self, name: str, value: object) -> None:
        _set(self, name, value)
        if name != "touched":
            _set(self, "touched", True)  # noqa: FBT003 - what it is set to

    @property
    def gyro_bias(self) -> tuple[float, float, float]:
        """Gyro bias of x, y and z, °/s."""
        bias = self.gyro_bias_deg_s
        return bias if isinstance(bias, tuple) else (0.0, 0.0, float(bias))


class CountDropout:
    """Loses a share of one encoder's edges."""

    __slots__ = ("_lost", "before")

    def __init__(self) -> None:
        """Nothing lost yet."""
        self.before: int | None = None
        """The counter as it was last."""
        self._lost = 0.0

    def apply(self, count: int, share: float) -> int:
        """Counter as the firmware sees it, 0..65535, after losing ``share`` of what was new.

        The wheel must turn less than half the counter's range between calls.
        """
        if self.before is not None and share > 0.0:
            new = ((count - self.before + _HALF_WRAP) & _MASK) - _HALF_WRAP
            self._lost += min(1.0, share) * new
        self.before = count
        return (count - round(self._lost)) & _MASK

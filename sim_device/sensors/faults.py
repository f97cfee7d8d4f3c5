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
    encoder_reversed_left: bool = False
    """Its two channels are exchanged: it counts backwards."""
    encoder_reversed_right: bool = False
    encoders_swapped: bool = False
    """Each counter is at the other wheel's plug."""
    i2c_stuck: bool = False
    """The bus to the inertial sensor is dead: no new sample arrives."""
    imu_clock: float = 0.0
    """Share by which the inertial sensor's own clock runs fast."""
    adc_frozen: bool = False
    """The supply's converter repeats its last readings."""
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


class Miswiring:
    """Both counters where encoders are reversed or swapped; none jumps as that begins or ends."""

    __slots__ = ("_raw", "_seen")

    def __init__(self, counts: tuple[int, int]) -> None:
        """Begin with both counters as they are."""
        self._raw = self._seen = counts

    def apply(self, counts: tuple[int, int], faults: SensorFaults) -> tuple[int, int]:
        """Counters as the firmware sees them, 0..65535."""
        left, right = (
            ((now - before + _HALF_WRAP) & _MASK) - _HALF_WRAP
            for now, before in zip(counts, self._raw, strict=True)
        )
        self._raw = counts
        if faults.encoder_reversed_left:
            left = -left
        if faults.encoder_reversed_right:
            right = -right
        if faults.encoders_swapped:
            left, right = right, left
        self._seen = self._seen[0] + left & _MASK, self._seen[1] + right & _MASK
        return self._seen


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

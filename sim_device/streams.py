"""What the firmware tells periodically, and how readings become wire integers."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from protocol.message import Direction, RateClass
from protocol.messages import INFRARED_NONE, ULTRASONIC_NONE, Encoders, Imu, Power, Range
from protocol.values import Capability, Contact

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.catalogue import Catalogue
    from protocol.message import Message, MessageSpec
    from sim_device.contacts import Bumpers
    from sim_device.imu import ImuCounts
    from sim_device.power import PowerReading
    from sim_device.rangers import Ranges

TICK_HZ = 100
"""Of the control loop; no stream is quicker."""
_NEEDS = {"planner_state": Capability.ONBOARD_PLANNER}


class Sensors(Protocol):
    """The readings that the firmware takes from its hardware."""

    def imu(self) -> ImuCounts:
        """MPU6050 registers: acceleration, temperature, rates."""

    def encoders(self) -> tuple[int, int]:
        """Absolute 16-bit counts, left and right."""

    def ranges(self) -> Ranges:
        """Ultrasonic, left and right infrared, in metres; None: nothing seen."""

    def bumpers(self) -> Bumpers:
        """Left and right half pressed."""

    def cliff(self) -> bool:
        """True where the floor is missing ahead."""

    def power(self) -> PowerReading:
        """Rails and currents."""


class Rate(NamedTuple):
    """A stream's period and phase in control ticks; a period of 0: off."""

    name: str
    period: int
    phase: int


class Schedule:
    """When each stream is due, in control ticks; phases are spread so that none come in bursts."""

    def __init__(self, catalogue: Catalogue, capabilities: int) -> None:
        """Every stream that the device declares and has something to say in, at its default."""
        self._streams: dict[int, MessageSpec] = {}
        self._phases: dict[int, int] = {}
        for index, spec in enumerate(s for s in catalogue if is_device_stream(s)):
            needed = _NEEDS.get(spec.name)
            if needed is None or needed & capabilities:
                self._streams[spec.type_id] = spec
                self._phases[spec.type_id] = index
        self._rates: dict[int, Rate] = {}
        self._due: tuple[Rate, ...] = ()
        self.reset()

    def reset(self) -> None:
        """Back to the default rates."""
        self._rates = {
            t: self._rate(t, max(1, round(TICK_HZ / s.default_hz)))
            for t, s in self._streams.items()
        }
        self._due = tuple(self._rates.values())

    def set_rate(self, type_id: int, rate: int) -> None:
        """Send a stream at ``rate`` tenths of a hertz, as near as whole ticks allow; 0: not."""
        period = max(1, round(10 * TICK_HZ / rate)) if rate else 0
        self._rates[type_id] = self._rate(type_id, period)
        self._due = tuple(r for r in self._rates.values() if r.period)

    def _rate(self, type_id: int, period: int) -> Rate:
        phase = self._phases[type_id]
        return Rate(self._streams[type_id].name, period, phase % period if period else 0)

    def __contains__(self, type_id: int) -> bool:
        """Whether the device sends this stream, if only at some rate."""
        return type_id in self._streams

    def due(self, tick: int) -> Iterator[str]:
        """Names of the streams to send at this tick."""
        for name, period, phase in self._due:
            if tick % period == phase:
                yield name


def is_device_stream(spec: MessageSpec) -> bool:
    """True of what a device sends periodically."""
    return spec.direction is Direction.DEVICE and spec.rate is RateClass.STREAM


def read_imu(sensors: Sensors) -> Message:
    """IMU registers as a message."""
    return Imu(*sensors.imu())


def read_encoders(sensors: Sensors) -> Message:
    """Wheel counts as a message."""
    return Encoders(*sensors.encoders())


def read_range(sensors: Sensors) -> Message:
    """Ranges and contacts as a message."""
    ultrasonic_m, left_m, right_m = sensors.ranges()
    bumper_left, bumper_right = sensors.bumpers()
    contacts = (
        (Contact.BUMPER_LEFT if bumper_left else 0)
        | (Contact.BUMPER_RIGHT if bumper_right else 0)
        | (Contact.CLIFF if sensors.cliff() else 0)
    )
    front = ULTRASONIC_NONE if ultrasonic_m is None else round(ultrasonic_m * 1000)
    return Range(front, _infrared(left_m), _infrared(right_m), int(contacts))


def power_message(reading: PowerReading) -> Message:
    """Rails and currents as a message."""
    return Power(
        _byte(reading.battery_v, 0.001, 0xFFFF),
        _byte(reading.rail_v, 0.025),
        _byte(abs(reading.left_a), 0.02),
        _byte(abs(reading.right_a), 0.02),
    )


def _infrared(range_m: float | None) -> int:
    return INFRARED_NONE if range_m is None else _byte(range_m, 0.00125, 254)


def _byte(value: float, step: float, high: int = 0xFF) -> int:
    return min(high, max(0, round(value / step)))

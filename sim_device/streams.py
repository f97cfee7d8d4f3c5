"""What the firmware tells periodically, and how readings become wire integers."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from protocol.catalogue import CATALOGUE
from protocol.messages import INFRARED_NONE, ULTRASONIC_NONE, Encoders, Imu, Power, Range
from protocol.values import Contact

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.message import Message
    from sim_device.contacts import Bumpers
    from sim_device.imu import ImuCounts
    from sim_device.power import PowerReading
    from sim_device.rangers import Ranges


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
    """A stream's period and phase in control ticks."""

    name: str
    period: int
    phase: int


def schedule(tick_hz: int) -> tuple[Rate, ...]:
    """Every device stream at its default rate, phases spread so that none come in bursts."""
    rates = [
        Rate(spec.name, max(1, round(tick_hz / spec.default_hz)), index)
        for index, spec in enumerate(
            s for s in CATALOGUE if s.direction.value == "device" and s.rate.value == "stream"
        )
    ]
    return tuple(Rate(r.name, r.period, r.phase % r.period) for r in rates)


def due(rates: tuple[Rate, ...], tick: int) -> Iterator[str]:
    """Names of the streams to send at this tick."""
    for name, period, phase in rates:
        if tick % period == phase:
            yield name


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


def read_power(sensors: Sensors) -> Message:
    """Rails and currents as a message."""
    reading = sensors.power()
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

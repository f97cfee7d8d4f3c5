"""Content of each stream.

:class:`StreamMessages` has one method per stream, with the stream's name, that creates the message.
The catalogue defines when each stream is sent and how it is encoded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages import device
from sim_device.sensors.contacts import Bumpers
from sim_device.sensors.units import contact_bits

if TYPE_CHECKING:
    from protocol.link import LinkStatistics
    from protocol.schema.message import Message
    from sim_device.device.control import Control
    from sim_device.device.counters import Counters
    from sim_device.device.sampling import Sampler

_TIME_TO_LIVE_MS_MAX = 250


class StreamMessages:
    """Creates the message of each stream; the argument is the uptime, µs."""

    def __init__(
        self, sampler: Sampler, control: Control, statistics: LinkStatistics, counters: Counters
    ) -> None:
        self._sampler, self._control = sampler, control
        self._statistics, self._counters = statistics, counters

    def sync(self, _now_us: int) -> Message:
        """Return the number of frames sent, including this frame."""
        return device.Sync((self._statistics.frames_out + 1) & 0xFFFF_FFFF)

    def status(self, now_us: int) -> Message:
        """Return mode, stop, faults and load."""
        control = self._control
        return device.Status(
            control.mode,
            control.latch.cause,
            control.fault_bits,
            min(_TIME_TO_LIVE_MS_MAX, control.watchdog.left_us(now_us) // 1000),
            self._counters.load_percent,
        )

    def imu(self, _now_us: int) -> Message:
        """Return the registers of this period."""
        return device.Imu(*self._sampler.imu)

    def encoders(self, _now_us: int) -> Message:
        """Return the counts of this period."""
        return device.Encoders(*self._sampler.counts)

    def range(self, _now_us: int) -> Message:
        """Return ranges and contacts."""
        ultrasonic_m, left_m, right_m, bumper_left, bumper_right, cliff, age_us = (
            self._sampler.around()
        )
        return device.Range(
            device.ULTRASONIC_NONE if ultrasonic_m is None else round(ultrasonic_m * 1000),
            _infrared(left_m),
            _infrared(right_m),
            contact_bits(Bumpers(bumper_left, bumper_right), cliff=cliff),
            min(device.ULTRASONIC_AGE_NONE, (age_us + 500) // 1000),
        )

    def power(self, _now_us: int) -> Message:
        """Return rail voltages and motor currents."""
        reading = self._control.power
        return device.Power(
            _byte(reading.battery_v, 0.001, 0xFFFF),
            _byte(reading.rail_v, 0.025),
            _byte(abs(reading.left_a), 0.02),
            _byte(abs(reading.right_a), 0.02),
        )

    def link_counters(self, _now_us: int) -> Message:
        """Return the numbers of frames that were received and dropped."""
        statistics, health = self._statistics, self._counters.line_health()
        return device.LinkCounters(
            statistics.frames_in & 0xFFFF,
            statistics.damaged + statistics.rejected & 0xFFFF,
            self._counters.stale & 0xFFFF,
            health.receive_dropped & 0xFFFF,
            health.send_dropped & 0xFFFF,
            health.can_send_errors,
            health.can_receive_errors,
            health.can_bus_offs & 0xFFFF,
        )

    def planner_state(self, _now_us: int) -> Message:
        """Return the variables of the device's own planner."""
        return self._control.planner_state()


def _infrared(range_m: float | None) -> int:
    return device.INFRARED_NONE if range_m is None else _byte(range_m, 0.00125, 254)


def _byte(value: float, step: float, high: int = 0xFF) -> int:
    return min(high, max(0, round(value / step)))

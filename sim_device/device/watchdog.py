"""Watchdogs of the host's cyclic values: setpoints of the velocity, and duties in bring-up mode.

A watchdog stores the last valid values until their time to live ends. It subtracts a frame's
additional delay (``freshness``) from the time to live. It rejects values if no time remains, or if
their counter does not advance. Its only clock is the device's time in microseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from protocol.messages.host import VelocitySetpoint, WheelDuty

MAX_TIME_TO_LIVE_US = 250_000
BRINGUP_DUTY_MAX = 0.5
"""Maximum duty in bring-up mode: half of full scale. It turns the wheels of a lifted robot
visibly."""
_HALF_COUNTER = 128


class Watchdog:
    """Stores the last valid pair of cyclic values until its time to live ends."""

    def __init__(self) -> None:
        self.first = self.second = 0.0
        self.counter: int | None = None
        self.until_us = 0
        """End of the time to live, µs of uptime; 0: no values are stored."""
        self._was_live = False

    def reset(self) -> None:
        """Discard values and counter for a new session."""
        self.halt()
        self.counter = None

    def halt(self) -> None:
        """Discard the values; later values of the session are still accepted."""
        self.first = self.second = 0.0
        self.until_us = 0
        self._was_live = False

    def take(  # noqa: PLR0913, PLR0917 - two values and the data to check them
        self,
        first: float,
        second: float,
        time_to_live_ms: int,
        counter: int,
        extra_delay_us: float,
        now_us: int,
    ) -> bool:
        """Store new values; return False if they are repeated, reordered or too old."""
        if self.counter is not None:
            advance = (counter - self.counter) & 0xFF
            if advance == 0 or advance >= _HALF_COUNTER:
                return False
        live_us = min(time_to_live_ms * 1000, MAX_TIME_TO_LIVE_US) - extra_delay_us
        if live_us <= 0:
            return False
        self.counter = counter
        self.first, self.second = first, second
        self.until_us = now_us + int(live_us)
        self._was_live = True
        return True

    def left_us(self, now_us: int) -> int:
        """Return the remaining time to live, µs."""
        return max(0, self.until_us - now_us)

    def expired(self, now_us: int) -> bool:
        """Return True once after the time to live of the stored values has expired."""
        if self._was_live and now_us >= self.until_us:
            self.halt()
            return True
        return False


class SetpointWatchdog(Watchdog):
    """Stores the body velocity that the host requests."""

    @property
    def wanted(self) -> tuple[float, float]:
        """Requested forward speed, m/s, and yaw rate, rad/s (counter-clockwise positive)."""
        return self.first, self.second

    def offer(self, setpoint: VelocitySetpoint, extra_delay_us: float, now_us: int) -> bool:
        """Store a setpoint; return False if it is repeated, reordered or too old."""
        return self.take(
            setpoint.v_m_s,
            setpoint.yaw_rate_rad_s,
            setpoint.time_to_live,
            setpoint.counter,
            extra_delay_us,
            now_us,
        )


class DutyWatchdog(Watchdog):
    """Stores the limited motor duties that the host requests in bring-up mode."""

    @property
    def duties(self) -> tuple[float, float]:
        """Left and right duty."""
        return self.first, self.second

    def offer(self, wanted: WheelDuty, extra_delay_us: float, now_us: int) -> bool:
        """Store duties; return False if they are repeated, reordered or too old."""
        return self.take(
            _capped(wanted.left_duty),
            _capped(wanted.right_duty),
            wanted.time_to_live,
            wanted.counter,
            extra_delay_us,
            now_us,
        )


def _capped(duty: float) -> float:
    return min(BRINGUP_DUTY_MAX, max(-BRINGUP_DUTY_MAX, duty))

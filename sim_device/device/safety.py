"""Stop latch, freshness check and watchdogs, which prevent unwanted motion.

These rules have no I/O; their only clock is the device's time in microseconds. The firmware applies
the rules to the wheels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.clock import DeviceUs, extend_us
from protocol.messages.values import StopCause, latched_cause

if TYPE_CHECKING:
    from protocol.messages.host import VelocitySetpoint, WheelDuty

MAX_TIME_TO_LIVE_US = 250_000
HOST_SILENCE_US = 1_000_000
DRIFT_ALLOWANCE_PPM = 250
"""Maximum drift between the clocks of host and device, ppm; two crystals of ±100 ppm differ by up
to 200 ppm. The smallest delay of a session is increased at this rate."""
BRINGUP_DUTY_MAX = 0.5
"""Maximum duty in bring-up mode: half of full scale. It turns the wheels of a lifted robot
visibly."""
_HALF_COUNTER = 128


class StopLatch:
    """Stores the most severe cause of a stop until a command clears this cause.

    A device boots with the latched cause ``SESSION_END``, so it moves only after this cause is
    cleared.
    """

    def __init__(self, cause: StopCause = StopCause.SESSION_END) -> None:
        self.cause = cause

    @property
    def latched(self) -> bool:
        """True if a stop is latched and the robot must not move."""
        return self.cause is not StopCause.NONE

    def latch(self, cause: int) -> bool:
        """Latch a cause; return False if an equal or more severe cause is already latched."""
        held, self.cause = self.cause, latched_cause(self.cause, cause)
        return self.cause is not held

    def clear(self, cause: int) -> bool:
        """Release the latch if ``cause`` is the latched cause; return whether it was released."""
        if not self.latched or cause != self.cause:
            return False
        self.cause = StopCause.NONE
        return True


class Freshness:
    """Computes the additional delay of a frame compared with the fastest frame of its session.

    Host and device clocks are not synchronised. So a frame's arrival time minus its host stamp is
    the delay plus an unknown constant. The additional delay is this difference minus its minimum in
    the session. The minimum is increased at the maximum drift of two crystals; otherwise clock
    drift would make all frames of a long session look late.
    """

    def __init__(self) -> None:
        self._host_us: DeviceUs | None = None
        self._min_us = 0.0
        self._at_us = 0

    def reset(self) -> None:
        """Start a session; its minimum is still unknown."""
        self._host_us = None

    def extra_delay_us(self, host_stamp: int, arrival_us: int) -> float:
        """Process a frame of the session; return its additional delay, µs."""
        if self._host_us is None:
            self._host_us = DeviceUs(host_stamp)
            self._min_us = float(arrival_us - host_stamp)
            self._at_us = arrival_us
            return 0.0
        host_us = extend_us(self._host_us, host_stamp)
        self._host_us = DeviceUs(max(self._host_us, host_us))
        self._min_us += (arrival_us - self._at_us) * DRIFT_ALLOWANCE_PPM * 1e-6
        self._at_us = arrival_us
        delay_us = float(arrival_us - host_us)
        self._min_us = min(self._min_us, delay_us)
        return delay_us - self._min_us


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

    @property
    def v_m_s(self) -> float:
        """Requested forward speed, m/s."""
        return self.first

    @property
    def yaw_rate_rad_s(self) -> float:
        """Requested yaw rate, rad/s, counter-clockwise."""
        return self.second

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

"""The device's own clock: it counts from boot, at the rate of an imperfect crystal."""

from __future__ import annotations

_MILLION = 1_000_000


class DeviceClock:
    """Microseconds since boot as the firmware counts them.

    The crystal drives two clocks. The control loop and all deadlines use *uptime*; its only error
    is drift. *Stamps* are the times of samples: they follow the uptime, and :meth:`jump_us` makes
    them jump. They are separate, because a jump of the stamps must not extend the time to live of a
    setpoint.
    """

    def __init__(self) -> None:
        """Start without drift, booted at 0."""
        self._drift_ppm = 0.0
        self._rate = 1.0
        self._true_us = 0
        """True time at which the present rate began, µs."""
        self._own_us = 0.0
        """Uptime at which the present rate began, µs."""
        self._seen_us = 0
        self.offset_us = 0
        """Stamp minus uptime, µs: the sum of the jumps since boot."""

    @property
    def drift_ppm(self) -> float:
        """Rate error of the crystal, ppm; positive if it is fast. Resets do not change it."""
        return self._drift_ppm

    @drift_ppm.setter
    def drift_ppm(self, ppm: float) -> None:
        if ppm == self._drift_ppm:
            return
        self._own_us += (self._seen_us - self._true_us) * self._rate
        self._true_us = self._seen_us
        self._drift_ppm = ppm
        self._rate = 1.0 + ppm / _MILLION

    def jump_us(self, delta: int) -> None:
        """Change the stamps by ``delta`` microseconds at once."""
        self.offset_us += delta

    def boot(self, true_us: int) -> None:
        """Restart the uptime at 0 now."""
        self._true_us = self._seen_us = true_us
        self._own_us = 0.0
        self.offset_us = 0

    def uptime_us(self, true_us: int) -> int:
        """Return the microseconds counted since boot; ``true_us`` must not decrease."""
        self._seen_us = true_us
        if self._rate == 1.0:
            return int(self._own_us) + true_us - self._true_us
        return int(self._own_us + (true_us - self._true_us) * self._rate)

    def stamp_us(self, true_us: int) -> int:
        """Return the stamp of a sample taken at ``true_us``, without changing the clock's state."""
        return int(self._own_us + (true_us - self._true_us) * self._rate) + self.offset_us

    def true_us(self, uptime_us: int) -> int:
        """Return the first whole true microsecond at which the uptime is at least ``uptime_us``."""
        if self._rate == 1.0 and self._own_us == 0.0:
            return self._true_us + uptime_us
        return self._true_us - int((self._own_us - uptime_us) / self._rate // 1)

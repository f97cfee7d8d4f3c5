"""The device's own clock: true time seen through a crystal, from boot on."""

from __future__ import annotations

_MILLION = 1_000_000


class DeviceClock:
    """Microseconds since boot as the firmware counts them.

    Two readings of one crystal. *Uptime* is the timer that paces the control loop and every
    deadline: it drifts and does nothing else. *Stamps* are what samples are marked with: they
    follow the uptime, and jump by what :meth:`jump_us` says. A device whose stamps jump must
    not hold a setpoint for longer because of it.
    """

    def __init__(self) -> None:
        """True to the microsecond, booted at 0."""
        self._drift_ppm = 0.0
        self._rate = 1.0
        self._true_us = 0
        """Where the present rate began, in true time ..."""
        self._own_us = 0.0
        """... and in the device's."""
        self._seen_us = 0
        self.offset_us = 0
        """Stamp less uptime: the sum of the jumps since boot."""

    @property
    def drift_ppm(self) -> float:
        """How much quicker than true time the crystal runs; set at any time, outlives resets."""
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
        """Let stamps go ``delta`` microseconds ahead at once, or back where it is negative."""
        self.offset_us += delta

    def boot(self, true_us: int) -> None:
        """Begin at 0 at this moment."""
        self._true_us = self._seen_us = true_us
        self._own_us = 0.0
        self.offset_us = 0

    def uptime_us(self, true_us: int) -> int:
        """Microseconds counted since boot; true times must not go back between calls."""
        self._seen_us = true_us
        if self._rate == 1.0:
            return int(self._own_us) + true_us - self._true_us
        return int(self._own_us + (true_us - self._true_us) * self._rate)

    def stamp_us(self, true_us: int) -> int:
        """What a sample of that moment is marked with, as things are; changes nothing."""
        return int(self._own_us + (true_us - self._true_us) * self._rate) + self.offset_us

    def true_us(self, uptime_us: int) -> int:
        """First whole true microsecond at which the uptime has reached a value."""
        if self._rate == 1.0 and self._own_us == 0.0:
            return self._true_us + uptime_us
        return self._true_us - int((self._own_us - uptime_us) / self._rate // 1)

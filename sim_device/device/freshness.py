"""Additional delay of a frame compared with the fastest frame of its session.

The watchdog subtracts it from the time to live of a setpoint.
"""

from __future__ import annotations

from protocol.clock import DeviceUs, extend_us

DRIFT_ALLOWANCE_PPM = 250
"""Maximum drift between the clocks of host and device, ppm; two crystals of ±100 ppm differ by up
to 200 ppm. The smallest delay of a session is increased at this rate."""


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

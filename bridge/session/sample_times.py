"""Age of each stream's newest sample, from its device stamp.

Sans-I/O. A sample that arrives may be old: the device may repeat it, its stamp may not advance, or
a buffer may delay it. All streams share one mapping from device stamps to host time. The fastest
frames define this mapping, and ping replies count too. If ping replies arrive without delay, this
module also detects streams that are all late by the same time. If the link delays ping replies too,
:mod:`bridge.session.round_trip` detects the delay.
"""

from __future__ import annotations

import math

FUTURE_S = 0.3
"""Maximum time by which a frame may be faster than the fastest frame so far, s. A larger difference
is a clock jump. The value equals the age at which samples are stale."""
DRIFT = 0.02
"""Maximum relative clock drift that is accepted: twice the maximum of the emulator's faults."""
FOLLOWING = 0.7
"""Rate at which the mapping follows if all frames arrive later, s/s. If a link's delay grows by up
to 1 s, samples stay fresh. If the device's clock runs at less than 0.3 of its nominal rate, samples
become stale."""
RESYNC_S = 1.0
"""Time after which rejected samples count as a clock reset if their stamps advance, s. A run
ends earlier, because its data are stale after 0.3 s."""


class SampleTimes:
    """Checks the stamps of one device's streams."""

    def __init__(self) -> None:
        """Create an empty record."""
        self.taken_s: dict[type, float] = {}
        """Host time at which each stream's newest sample was taken, s."""
        self.jumps = 0
        """Number of clock resets found."""
        self._newest_us: dict[type, int] = {}
        """Stamp of each stream's newest sample, µs."""
        self._quickest_s = math.inf
        """Host time minus device time of the fastest frame so far, s."""
        self._usual_s = math.inf
        """Host time minus device time of the fastest recent frame, s."""
        self._at_s = 0.0
        """Time of the last update of ``_quickest_s`` and ``_usual_s``, s."""
        self._rejected: dict[type, tuple[float, int]] = {}
        """Streams with rejected samples: start of the rejection (s) and newest rejected stamp
        (µs)."""

    def forget(self) -> None:
        """Discard all stamps at a new session or boot."""
        self.taken_s.clear()
        self._newest_us.clear()
        self._rejected.clear()
        self._quickest_s = self._usual_s = math.inf

    def observe(self, device_us: int, now_s: float) -> None:
        """Use the stamp of a frame that is not a sample, such as a ping reply."""
        delay_s = now_s - device_us * 1e-6
        if delay_s < self._quickest_s - FUTURE_S:
            return  # only samples detect a clock jump
        self._follow(delay_s, now_s)

    def _follow(self, delay_s: float, now_s: float) -> None:
        """Update the mapping with a frame's host time minus device time."""
        elapsed_s, self._at_s = now_s - self._at_s, now_s
        self._quickest_s = min(delay_s, self._quickest_s + DRIFT * elapsed_s)
        self._usual_s = min(delay_s, self._usual_s + FOLLOWING * elapsed_s)

    def note(self, stream: type, now_s: float) -> None:
        """Record the arrival of a message whose stamp is not used."""
        self.taken_s[stream] = now_s

    def take(self, stream: type, device_us: int, now_s: float) -> bool:
        """Add a sample's stamp and arrival. Return False if it is not newer than the last."""
        device_s = device_us * 1e-6
        delay_s = now_s - device_s
        jumped = math.isfinite(self._quickest_s) and delay_s < self._quickest_s - FUTURE_S
        if jumped or device_us <= self._newest_us.get(stream, -math.inf):
            if not self._clock_reset(stream, device_us, now_s):
                return False
            self._quickest_s = self._usual_s = delay_s
            self._at_s = now_s
        else:
            self._follow(delay_s, now_s)
            if self._rejected:
                self._rejected.pop(stream, None)
        self._newest_us[stream] = device_us
        self.taken_s[stream] = device_s + self._usual_s
        return True

    def _clock_reset(self, stream: type, device_us: int, now_s: float) -> bool:
        """Return True if the stamps of rejected samples advanced long enough for a clock reset."""
        since_s, newest_us = self._rejected.get(stream, (now_s, device_us - 1))
        if device_us <= newest_us:
            since_s = now_s
        self._rejected[stream] = (since_s, device_us)
        if now_s - since_s <= RESYNC_S:
            return False
        del self._rejected[stream]
        self.jumps += 1
        return True

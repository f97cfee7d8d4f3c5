"""When the newest sample of each stream was taken, by its device stamp.

Sans-I/O. A sample that arrives now may be old: a device repeats it, a stream's stamp stands still,
a buffer delays it. Its arrival says only that the link works. The quickest of the other frames maps
device stamps to host time, and the stamps of all streams share it. Replies to pings are such frames
too: where they come at once, streams that all lag by the same time are old. What delays the replies
as well is the link, which :mod:`bridge.session.round_trip` judges.
"""

from __future__ import annotations

import math

FUTURE_S = 0.3
"""Time by which a stamp may precede the quickest frame so far, s: more is not a quicker link but a
clock that has jumped. It equals the age at which samples count as stale."""
DRIFT = 0.02
"""Drift between the clocks that no stamp is rejected for, as a share: twice the worst that the
emulator's faults have."""
FOLLOWING = 0.7
"""Share of the time by which the map follows frames that all come later than before. A link whose
delay grows by up to 1 s makes no sample stale, and a device's clock that runs at less than 0.3 of
its rate does."""
RESYNC_S = 1.0
"""Time for which a stream's samples must be rejected, each newer than the one before, until its
clock counts as set anew, s. A run has ended by then, for its data are stale after 0.3 s."""


class SampleTimes:
    """Judges the stamps of one device's streams, one boot after the other."""

    def __init__(self) -> None:
        """No sample was taken."""
        self.taken_s: dict[type, float] = {}
        """Host time at which the newest sample of each stream was taken."""
        self.jumps = 0
        """How often a stream's clock was found to be set anew."""
        self._newest_us: dict[type, int] = {}
        """Stamp of the newest sample of each stream."""
        self._quickest_s = math.inf
        """Host time less device time, of the quickest frame so far."""
        self._usual_s = math.inf
        """The same of the quickest frame of late."""
        self._at_s = 0.0
        """When both were brought up to date."""
        self._rejected: dict[type, tuple[float, int]] = {}
        """Streams whose samples are rejected: since when, and the newest stamp among them."""

    def forget(self) -> None:
        """Begin anew: another session or boot."""
        self.taken_s.clear()
        self._newest_us.clear()
        self._rejected.clear()
        self._quickest_s = self._usual_s = math.inf

    def hear(self, device_us: int, now_s: float) -> None:
        """Take the stamp of a frame that is no sample, such as the answer to a ping."""
        delay_s = now_s - device_us * 1e-6
        if delay_s < self._quickest_s - FUTURE_S:
            return  # a clock that has jumped is for the samples to show
        self._follow(delay_s, now_s)

    def _follow(self, delay_s: float, now_s: float) -> None:
        """Bring the map up to date with a frame's host time less device time."""
        elapsed_s, self._at_s = now_s - self._at_s, now_s
        self._quickest_s = min(delay_s, self._quickest_s + DRIFT * elapsed_s)
        self._usual_s = min(delay_s, self._usual_s + FOLLOWING * elapsed_s)

    def take(self, stream: type, device_us: int, now_s: float) -> bool:
        """Take a sample's stamp and arrival; False for one that is not newer than the last."""
        device_s = device_us * 1e-6
        delay_s = now_s - device_s
        jumped = math.isfinite(self._quickest_s) and delay_s < self._quickest_s - FUTURE_S
        if jumped or device_us <= self._newest_us.get(stream, -math.inf):
            if not self._set_anew(stream, device_us, now_s):
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

    def _set_anew(self, stream: type, device_us: int, now_s: float) -> bool:
        """Whether a stream's clock now counts as set anew, for its samples go on advancing."""
        since_s, newest_us = self._rejected.get(stream, (now_s, device_us - 1))
        if device_us <= newest_us:
            since_s = now_s
        self._rejected[stream] = (since_s, device_us)
        if now_s - since_s <= RESYNC_S:
            return False
        del self._rejected[stream]
        self.jumps += 1
        return True

"""Device microseconds to host time, with a bound on the error of every sample.

Host time is a straight line over device time, and every exchange fences it in. A device
stamp can never be later than its arrival (upper fence; every telemetry frame gives one),
and a device's receive stamp never earlier than our sending (lower fence; pings give those).
The line must pass below all upper and above all lower fences. What remains is a slope
interval and, at any moment, an offset interval; its middle is the estimate and its half
width an honest bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from protocol.clock import DeviceUs, HostNs, extend_us

_new = tuple.__new__

MAX_DRIFT_PPM = 300.0
"""Two crystals of ±100 ppm, with room."""
BUCKET_US = 500_000
BUCKETS = 60
"""Half a minute of history: longer and a crystal's own drift with temperature shows."""
STAMP_NS = 1_000
"""A device's stamp is up to this much before the moment that it names."""
STEP_NS = 1_000_000
STEP_SAMPLES = 5
"""Five contradictions of over 1 ms are a clock that jumped; one is a damaged stamp."""


class Mapped(NamedTuple):
    """A device moment in host time."""

    host_ns: HostNs
    bound_ns: int


@dataclass(frozen=True, slots=True)
class Fit:
    """The line at its reference moment, and how far it may be off."""

    device_us: int
    host_ns: float
    drift: float
    """Host seconds per device second, less 1."""
    bound_ns: float
    drift_bound: float


class TimeSync:
    """Fences, line and bounds of one boot of one device."""

    def __init__(self, min_up_ns: int = 0, min_down_ns: int = 0) -> None:
        """Know nothing yet.

        ``min_up_ns`` and ``min_down_ns`` declare what no frame to the device, and none from
        it, is quicker than: the time on a wire of a known baud rate, an adapter's own. The
        fences move together by as much, and the bound halves or better; a declaration that is
        not true makes it dishonest, so the default declares nothing.
        """
        self._min_up_ns = min_up_ns
        self._min_down_ns = min_down_ns
        self.fit: Fit | None = None
        self.samples = 0
        self.steps = 0
        """Clock steps found so far."""
        self.round_trip_ns = 0
        self._last: DeviceUs | None = None
        self._upper: dict[int, tuple[int, int]] = {}
        self._lower: dict[int, tuple[int, int]] = {}
        self._upper_corners: list[tuple[int, int]] | None = None
        self._lower_corners: list[tuple[int, int]] | None = None
        """Of the fences, until one changes."""
        self._contradictions = 0

    def reset(self) -> None:
        """Forget everything: another boot, or the clock has stepped."""
        self.fit = None
        self._last = None
        self._upper.clear()
        self._lower.clear()
        self._upper_corners = self._lower_corners = None
        self._contradictions = 0

    def extend(self, low32: int) -> DeviceUs:
        """Undo the wrap of a 32-bit device stamp."""
        self._last = DeviceUs(low32) if self._last is None else extend_us(self._last, low32)
        return self._last

    def observe(self, low32: int, arrived_ns: HostNs) -> tuple[DeviceUs, Mapped | None]:
        """Take a frame's stamp and arrival; its moment on the device and on the host.

        :meth:`extend`, :meth:`arrival` and :meth:`map` in one: every message passes here.
        """
        last = self._last
        self._last = device_us = DeviceUs(low32) if last is None else extend_us(last, low32)
        quickest_ns = arrived_ns - self._min_down_ns
        known = self._upper.get(device_us // BUCKET_US)
        fit = self.fit
        if (
            known is None or quickest_ns - device_us * 1000 < known[1] - known[0] * 1000
        ) and not self._is_future(device_us, arrived_ns):
            self.arrival(device_us, arrived_ns)
        if fit is None or self._contradictions:
            return device_us, None
        elapsed_ns = (device_us - fit.device_us) * 1000.0
        host_ns = round(fit.host_ns + elapsed_ns * (1.0 + fit.drift))
        bound_ns = round(fit.bound_ns + abs(elapsed_ns) * fit.drift_bound) + STAMP_NS
        return device_us, _new(Mapped, (host_ns, bound_ns))

    def arrival(self, device_us: DeviceUs, host_ns: HostNs) -> None:
        """A frame stamped ``device_us`` was here at ``host_ns``."""
        latest_ns = host_ns - self._min_down_ns
        if self._fence(self._upper, device_us, latest_ns, keep_smaller=True):
            self._upper_corners = None

    def exchange(
        self, sent_ns: HostNs, received_us: DeviceUs, replied_us: DeviceUs, arrived_ns: HostNs
    ) -> bool:
        """A ping and its reply; False where the clock was found to have stepped."""
        self.samples += 1
        self.round_trip_ns = arrived_ns - sent_ns - (replied_us - received_us) * 1000
        if self._contradicts(sent_ns, received_us, replied_us, arrived_ns):
            self._contradictions += 1
            if self._contradictions >= STEP_SAMPLES:
                self.reset()
                self.steps += 1
                return False
            return True
        self._contradictions = 0
        # The stamp is cut, so the moment that it names may be just before our sending. Without
        # room for that, two fences close together bend the slope by thousands of ppm.
        floor_ns = HostNs(sent_ns + self._min_up_ns - STAMP_NS - 1)
        if self._fence(self._lower, received_us, floor_ns, keep_smaller=False):
            self._lower_corners = None
        self.arrival(replied_us, arrived_ns)
        self._refit(replied_us)
        return True

    def _is_future(self, device_us: int, arrived_ns: int) -> bool:
        """Whether a stamp is later than its arrival: one stream's fault, which bends no line.

        A clock that steps is found by the pings.
        """
        if self.fit is None:
            return False
        mapped = self._at(self.fit, device_us)
        return mapped.host_ns - mapped.bound_ns - STEP_NS > arrived_ns

    def map(self, device_us: DeviceUs) -> Mapped | None:
        """Host time of a device moment, or None while nothing is known, or all is in doubt.

        A device's stamp is the moment cut to whole microseconds; the bound has room for that.
        """
        fit = self.fit
        if fit is None or self._contradictions:
            return None
        return self._at(fit, device_us)

    @staticmethod
    def _at(fit: Fit, device_us: int) -> Mapped:
        elapsed_ns = (device_us - fit.device_us) * 1000.0
        host_ns = fit.host_ns + elapsed_ns * (1.0 + fit.drift)
        bound_ns = fit.bound_ns + abs(elapsed_ns) * fit.drift_bound
        return _new(Mapped, (HostNs(round(host_ns)), round(bound_ns) + STAMP_NS))

    # ---- fences ---------------------------------------------------------------------------

    @staticmethod
    def _fence(
        side: dict[int, tuple[int, int]], device_us: int, host_ns: int, *, keep_smaller: bool
    ) -> bool:
        """Keep, per bucket of device time, the tightest fence; whether that is this one."""
        bucket = device_us // BUCKET_US
        known = side.get(bucket)
        if known is not None:
            slack, slack_known = host_ns - device_us * 1000, known[1] - known[0] * 1000
            if (slack < slack_known) is not keep_smaller:
                return False
        elif len(side) >= BUCKETS:
            del side[min(side)]
        side[bucket] = (device_us, host_ns)
        return True

    def _contradicts(self, sent_ns: int, received_us: int, replied_us: int, arrived: int) -> bool:
        fit = self.fit
        if fit is None:
            return False
        received, replied = self._at(fit, received_us), self._at(fit, replied_us)
        early = received.host_ns + received.bound_ns + STEP_NS < sent_ns
        late = replied.host_ns - replied.bound_ns - STEP_NS > arrived
        return early or late

    def _refit(self, at_us: int) -> None:
        if not self._upper or not self._lower:
            return
        base_ns = next(iter(self._upper.values()))[1]
        if self._upper_corners is None:
            self._upper_corners = _corners(self._upper, side=1)
        if self._lower_corners is None:
            self._lower_corners = _corners(self._lower, side=-1)
        upper = _around(self._upper_corners, at_us, base_ns)
        lower = _around(self._lower_corners, at_us, base_ns)
        slow, fast = _slopes(upper, lower)
        # Each fence carried to the moment of the fit along whichever slope is the laxer.
        high_ns = min(ns - min(at * (1 + slow), at * (1 + fast)) for at, ns in upper)
        low_ns = max(ns - max(at * (1 + slow), at * (1 + fast)) for at, ns in lower)
        # Where they cross, they contradict each other by as much as that.
        middle, half = 0.5 * (high_ns + low_ns), 0.5 * abs(high_ns - low_ns)
        self.fit = Fit(at_us, base_ns + middle, 0.5 * (slow + fast), half, 0.5 * (fast - slow))


def _corners(fences: dict[int, tuple[int, int]], *, side: int) -> list[tuple[int, int]]:
    """The fences that a line can touch: the corners of their convex hull on its side.

    A handful of the 60, which is what makes the fit cheap. ``side`` is 1 for fences above the
    line and -1 below it.
    """
    corners: list[tuple[int, int]] = []
    ordered = sorted(fences.values())
    first_us, first_ns = ordered[0]
    for device_us, host_ns in ordered:
        x = (device_us - first_us) * 1000
        y = side * (host_ns - first_ns - x)  # less the slope of 1: the hull is of small numbers
        while len(corners) > 1:
            (x1, y1), (x2, y2) = corners[-2:]
            if (x2 - x1) * (y - y1) > (y2 - y1) * (x - x1):
                break
            corners.pop()
        corners.append((x, y))
    return [(first_us + x // 1000, first_ns + side * y + x) for x, y in corners]


def _around(corners: list[tuple[int, int]], at_us: int, base_ns: int) -> list[tuple[float, float]]:
    """Corners in device and host nanoseconds, from the moment of the fit."""
    return [(float((us - at_us) * 1000), float(ns - base_ns)) for us, ns in corners]


def _slopes(
    upper: list[tuple[float, float]], lower: list[tuple[float, float]]
) -> tuple[float, float]:
    """Least and greatest drift of a line below all upper and above all lower fences."""
    fast = MAX_DRIFT_PPM * 1e-6
    slow = -fast
    for upper_at, upper_ns in upper:
        for lower_at, lower_ns in lower:
            span = upper_at - lower_at
            if span == 0.0:
                continue
            slope = (upper_ns - lower_ns) / span - 1.0
            if span > 0.0:
                fast = min(fast, slope)
            else:
                slow = max(slow, slope)
    if slow > fast:  # rounding of stamps to whole microseconds
        slow = fast = 0.5 * (slow + fast)
    return slow, fast

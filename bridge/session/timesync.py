"""Synchronisation of device time to host time, with an error bound for every sample.

Host time is modelled as a linear function of device time: a line. Every exchange constrains this
line. Every telemetry frame gives an upper constraint: its device stamp is not later than its
arrival at the host. Every ping gives a lower constraint: the device's receive stamp is not earlier
than the host's transmission. Possible lines are below all upper and above all lower constraints.
They have an interval of slopes and, at any time, an interval of offsets. The middle of the interval
of offsets is the estimate, and half of its width is a strict error bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from protocol.clock import DeviceUs, HostNs, extend_us

_new = tuple.__new__

MAX_DRIFT_PPM = 300.0
"""Maximum relative clock drift, ppm. It is for two crystals of ±100 ppm, with a margin."""
BUCKET_US = 500_000
"""Device time for which one constraint is stored on each side, µs."""
BUCKETS = 60
"""Number of constraints that are stored on each side. They cover 30 s. In a longer time a crystal's
drift changes with temperature."""
STAMP_NS = 1_000
"""Resolution of a device stamp, ns. The stamp is truncated to whole microseconds."""
STEP_NS = 1_000_000
"""Minimum violation of a constraint that counts towards a clock step, ns."""
STEP_SAMPLES = 5
"""Number of consecutive violations that count as a clock step. A single violation is a damaged
stamp."""


class Mapped(NamedTuple):
    """A device time converted to host time, with its error bound."""

    host_ns: HostNs
    bound_ns: int


@dataclass(frozen=True, slots=True)
class Fit:
    """The fitted line at its reference time, and its error bounds."""

    device_us: int
    host_ns: float
    drift: float
    """Host seconds per device second, minus 1."""
    bound_ns: float
    drift_bound: float


class TimeSync:
    """Constraints, fitted line and error bounds for one boot of one device."""

    def __init__(self, min_up_ns: int = 0, min_down_ns: int = 0) -> None:
        """Create an empty synchronisation.

        Declared delays tighten the constraints, so the bound is at most half as large. A declared
        delay that is too long makes the bound wrong. The default 0 is always valid.

        Args:
            min_up_ns: Minimum delay of a frame to the device, ns: the transmission time at a known
                baud rate, plus the adapter's latency.
            min_down_ns: Minimum delay of a frame from the device, ns.

        """
        self._min_up_ns = min_up_ns
        self._min_down_ns = min_down_ns
        self.fit: Fit | None = None
        self.samples = 0
        self.steps = 0
        """Number of clock steps found."""
        self.round_trip_ns = 0
        self._last: DeviceUs | None = None
        self._upper: dict[int, tuple[int, int]] = {}
        self._lower: dict[int, tuple[int, int]] = {}
        self._upper_corners: list[tuple[int, int]] | None = None
        self._lower_corners: list[tuple[int, int]] | None = None
        """Corners of the convex hulls of the upper and of the lower constraints; None after a
        change."""
        self._contradictions = 0

    @property
    def constraints(self) -> tuple[int, int]:
        """Numbers of stored upper and lower constraints."""
        return len(self._upper), len(self._lower)

    def reset(self) -> None:
        """Discard all data after a reboot."""
        self._last = None
        self._discard()

    def _discard(self) -> None:
        """Discard the relation of the clocks; the extension of device stamps continues."""
        self.fit = None
        self._upper.clear()
        self._lower.clear()
        self._upper_corners = self._lower_corners = None
        self._contradictions = 0

    def extend(self, low32: int) -> DeviceUs:
        """Extend a 32-bit device stamp over its wraps."""
        self._last = DeviceUs(low32) if self._last is None else extend_us(self._last, low32)
        return self._last

    def observe(self, low32: int, arrived_ns: HostNs) -> tuple[DeviceUs, Mapped | None]:
        """Add a frame's stamp and arrival; return its device time and host time.

        It combines :meth:`extend`, :meth:`arrival` and :meth:`map` for speed, because it runs for
        every message.
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
        """Add the upper constraint of a frame stamped ``device_us`` that arrived at ``host_ns``."""
        latest_ns = host_ns - self._min_down_ns
        if self._fence(self._upper, device_us, latest_ns, keep_smaller=True):
            self._upper_corners = None

    def exchange(
        self, sent_ns: HostNs, received_us: DeviceUs, replied_us: DeviceUs, arrived_ns: HostNs
    ) -> bool:
        """Add a ping and its reply. Return False if the device's clock has stepped."""
        self.samples += 1
        self.round_trip_ns = arrived_ns - sent_ns - (replied_us - received_us) * 1000
        if self._contradicts(sent_ns, received_us, replied_us, arrived_ns):
            self._contradictions += 1
            if self._contradictions >= STEP_SAMPLES:
                self._discard()
                self.steps += 1
                return False
            return True
        self._contradictions = 0
        # The stamp is truncated, so it may be just before the transmission. Without this margin,
        # two close constraints change the slope by thousands of ppm.
        floor_ns = HostNs(sent_ns + self._min_up_ns - STAMP_NS - 1)
        if self._fence(self._lower, received_us, floor_ns, keep_smaller=False):
            self._lower_corners = None
        self.arrival(replied_us, arrived_ns)
        self._refit(replied_us)
        return True

    def _is_future(self, device_us: int, arrived_ns: int) -> bool:
        """Return True if a stamp is later than its arrival.

        Such a stamp is an error of one stream, so it must not change the line. Pings detect clock
        steps.
        """
        if self.fit is None:
            return False
        mapped = self._at(self.fit, device_us)
        return mapped.host_ns - mapped.bound_ns - STEP_NS > arrived_ns

    def map(self, device_us: DeviceUs) -> Mapped | None:
        """Convert a device time to host time; None before the first fit or during a possible step.

        The bound includes the truncation of the device's stamps to whole microseconds.
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

    # ---- constraints ------------------------------------------------------------------------

    @staticmethod
    def _fence(
        side: dict[int, tuple[int, int]], device_us: int, host_ns: int, *, keep_smaller: bool
    ) -> bool:
        """Keep the tightest constraint of each time bucket; return True if the new one is kept."""
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
        # Move each constraint to the time of the fit, along the slope that loosens it most.
        high_ns = min(ns - min(at * (1 + slow), at * (1 + fast)) for at, ns in upper)
        low_ns = max(ns - max(at * (1 + slow), at * (1 + fast)) for at, ns in lower)
        # If the constraints contradict each other, the bound is the size of the contradiction.
        middle, half = 0.5 * (high_ns + low_ns), 0.5 * abs(high_ns - low_ns)
        self.fit = Fit(at_us, base_ns + middle, 0.5 * (slow + fast), half, 0.5 * (fast - slow))


def _corners(fences: dict[int, tuple[int, int]], *, side: int) -> list[tuple[int, int]]:
    """Return the constraints that can limit the line: the corners of their convex hull.

    The corners are few, so the fit is fast. ``side`` is 1 for upper and -1 for lower constraints.
    """
    corners: list[tuple[int, int]] = []
    ordered = sorted(fences.values())
    first_us, first_ns = ordered[0]
    for device_us, host_ns in ordered:
        x = (device_us - first_us) * 1000
        y = side * (host_ns - first_ns - x)  # minus slope 1, to keep the numbers small
        while len(corners) > 1:
            (x1, y1), (x2, y2) = corners[-2:]
            if (x2 - x1) * (y - y1) > (y2 - y1) * (x - x1):
                break
            corners.pop()
        corners.append((x, y))
    return [(first_us + x // 1000, first_ns + side * y + x) for x, y in corners]


def _around(corners: list[tuple[int, int]], at_us: int, base_ns: int) -> list[tuple[float, float]]:
    """Return the corners in device and host nanoseconds relative to the time of the fit."""
    return [(float((us - at_us) * 1000), float(ns - base_ns)) for us, ns in corners]


def _slopes(
    upper: list[tuple[float, float]], lower: list[tuple[float, float]]
) -> tuple[float, float]:
    """Return the minimum and maximum drift of the lines that satisfy all constraints."""
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
    if slow > fast:  # caused by the truncation of stamps to whole µs
        slow = fast = 0.5 * (slow + fast)
    return slow, fast

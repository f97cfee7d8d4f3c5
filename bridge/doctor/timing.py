"""Timing analysis of a capture: clock offset and drift, delays, gaps and host stalls.

The arrival time of a frame minus its stamp is the sum of clock offset and delay. The minimum of
this sum in each half second is the offset plus the shortest delay. The slope of a line through
these minima is the clock drift. The distance of a frame above the line is its additional delay. A
jump of the line is a step of a clock or of the link's delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from protocol.clock import elapsed_us

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.doctor.wire_view import WireView

    Floats = NDArray[np.float64]

BUCKET_S = 0.5
"""Duration of an interval whose minimum offset is used, s."""
STEP_MS = 5.0
"""Minimum jump of the offset between two intervals that is reported, ms."""
HOLE_S = 0.3
"""Minimum time without a frame that is reported as a gap, s. A device sends a frame every 4 ms."""
STALL_S = 0.1
"""Minimum pause in reading that is reported as a stall of the host, s."""
AFTER_STALL_S = 0.1
"""Time after a stall in which frames are still late, s."""
_MS = 0.001
MIN_FRAMES = 50
"""Minimum number of frames that is analysed."""
DRIFT_BUCKETS = 6
"""Minimum number of intervals for a drift. Fewer intervals do not show the scatter."""
DRIFT_SIGMAS = 4.0
"""Uncertainty of the drift in standard errors. The value is large, because delays are not
Gaussian."""
STAMP_S = 5e-6
"""Lower bound of the scatter of an offset, s. It is the resolution of a stamp and of its
reading."""
_AROUND = 3
"""Number of intervals before and after a step that are compared."""
_MIN_TIMER_MS, _MAX_TIMER_MS = 4.0, 260.0
"""Range of the latency timers of drivers, ms. An FTDI adapter's timer is at most 255 ms."""
_TIMER_TOLERANCE, _TIMER_SHARE = 0.03, 0.1
"""Relative tolerance of a timer's period, and the share of reads that must match it."""


@dataclass(frozen=True, slots=True)
class FrameGap:
    """A period without frames."""

    at_s: float
    """Start, s since the beginning of the capture."""
    for_s: float
    missing: int
    """Number of frames lost in the period, from the sequence numbers; at most 255."""
    stamped_s: float
    """Increase of the stamps over the period, s."""


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A jump of the clock offset."""

    at_s: float
    by_ms: float
    """Size of the jump, ms; positive: frames arrive later relative to their stamps."""
    round_trip_ms: float | None
    """Increase of the round-trip time at the jump, ms; None: no pings."""


@dataclass(slots=True)
class Timing:
    """Result of the analysis; empty for a capture with too few frames."""

    duration_s: float = 0.0
    drift_ppm: float | None = None
    """Drift of the device clock relative to the host clock, ppm; positive: the device is slow."""
    drift_error_ppm: float | None = None
    """Uncertainty of the drift from the scatter of the delays, ppm; None: too short a capture."""
    delay_ms: dict[str, float] = field(default_factory=dict)
    """Additional delay relative to the shortest delay, ms: ``p50``, ``p95``, ``p99``, ``max``."""
    round_trip_ms: dict[str, float] = field(default_factory=dict)
    """Round-trip time, ms: ``min``, ``p50``, ``p99``, ``max``."""
    timer_ms: float | None = None
    """Period of the adapter's latency timer, ms; None: no timer was detected."""
    holes: list[FrameGap] = field(default_factory=list)
    stalls: list[FrameGap] = field(default_factory=list)
    """Periods without frames in which no frame was lost: the host did not read."""
    steps: list[ClockStep] = field(default_factory=list)


def measure(view: WireView) -> Timing:
    """Analyse the timing of a capture."""
    timing = Timing()
    arrived = np.array(view.marks.arrived_ns, dtype=np.int64)
    if view.round_trips:
        trips = np.array([trip for _, trip in view.round_trips]) * 1e-6
        timing.round_trip_ms = {
            "min": float(trips.min()),
            "p50": float(np.percentile(trips, 50)),
            "p99": float(np.percentile(trips, 99)),
            "max": float(trips.max()),
        }
    if len(arrived) < MIN_FRAMES:
        return timing
    begin_ns = int(arrived[0])
    at_s: Floats = ((arrived - begin_ns) * 1e-9).astype(np.float64)
    timing.duration_s = float(at_s[-1])
    stamp_s, boots = _unwrapped(np.array(view.marks.stamp_us, dtype=np.int64), view, arrived)
    skipped = np.array(view.marks.skipped, dtype=np.int64)
    _find_holes(timing, at_s, stamp_s, skipped, boots)
    trips_at = [((at - begin_ns) * 1e-9, trip * 1e-6) for at, trip in view.round_trips]
    delays: list[Floats] = []
    slopes: list[tuple[int, float, float | None]] = []
    late = _of_stalls(timing, at_s)
    for first, last in zip(boots, [*boots[1:], len(at_s)], strict=True):
        piece = slice(first, last)
        _judge_clock(timing, at_s[piece], stamp_s[piece], late[piece], trips_at, delays, slopes)
    if delays:
        extra = np.concatenate(delays) * 1e3
        timing.delay_ms = {
            name: float(np.percentile(extra, share))
            for name, share in (("p50", 50), ("p95", 95), ("p99", 99), ("max", 100))
        }
    if slopes:
        _, slope, error = max(slopes, key=lambda each: each[0])
        timing.drift_ppm = slope * 1e6
        timing.drift_error_ppm = None if error is None else error * 1e6
    # After a stall, frames are on time again. If they stay late, the link has become slower.
    timing.stalls = [
        stall
        for stall in timing.stalls
        if not any(abs(step.at_s - stall.at_s) < 2.0 * BUCKET_S for step in timing.steps)
    ]
    timing.timer_ms = _timer_ms(np.array(view.chunk_ns, dtype=np.int64))
    return timing


def _unwrapped(
    stamps: NDArray[np.int64], view: WireView, arrived: NDArray[np.int64]
) -> tuple[Floats, list[int]]:
    """Return the stamps in seconds without wraps, and the index of the first frame of each boot."""
    boots = [0]
    for boot in view.boots[1:]:
        index = int(np.searchsorted(arrived, boot.at_ns))
        if boots[-1] < index < len(arrived):
            boots.append(index)
    step = elapsed_us(stamps[:-1], stamps[1:])
    return np.concatenate(([0.0], np.cumsum(step))) * 1e-6, boots


def _find_holes(
    timing: Timing, at_s: Floats, stamp_s: Floats, skipped: NDArray[np.int64], boots: list[int]
) -> None:
    wait_s = np.diff(at_s)
    for index in np.flatnonzero(wait_s > STALL_S).tolist():
        if index + 1 in boots:
            continue
        missing = int(skipped[index + 1])
        hole = FrameGap(
            round(float(at_s[index]), 3),
            round(float(wait_s[index]), 3),
            missing,
            round(float(stamp_s[index + 1] - stamp_s[index]), 3),
        )
        # A stall: the next frame was stamped during the period, so it waited to be read.
        if missing == 0 and hole.stamped_s < 0.5 * hole.for_s:
            timing.stalls.append(hole)
        elif hole.for_s > HOLE_S:
            timing.holes.append(hole)


def _of_stalls(timing: Timing, at_s: Floats) -> NDArray[np.bool_]:
    """Return a mask of the frames that a stall delayed. They do not show the link's delay."""
    late = np.zeros(len(at_s), np.bool_)
    for stall in timing.stalls:
        end_s = stall.at_s + stall.for_s
        late |= (at_s > stall.at_s + _MS) & (at_s < end_s + AFTER_STALL_S)
    return late


def _judge_clock(  # noqa: PLR0913, PLR0917 - frames in, results into three lists
    timing: Timing,
    at_s: Floats,
    stamp_s: Floats,
    late: NDArray[np.bool_],
    trips: list[tuple[float, float]],
    delays: list[Floats],
    slopes: list[tuple[int, float, float | None]],
) -> None:
    """Find the steps, drift and delays of one boot."""
    if len(at_s) < MIN_FRAMES:
        return
    offset = at_s - stamp_s
    bucket = ((at_s - at_s[0]) / BUCKET_S).astype(np.int64)
    firsts = np.flatnonzero(np.diff(bucket, prepend=-1))
    least = np.minimum.reduceat(offset, firsts)
    middles = at_s[firsts]
    cuts = [0]
    for index in _steps(least):
        before = least[max(0, index - _AROUND) : index]
        after = least[index : index + _AROUND]
        at = float(middles[index])
        timing.steps.append(
            ClockStep(
                round(at, 2), float(np.median(after) - np.median(before)) * 1e3, _grown(trips, at)
            )
        )
        cuts.append(index)
    cuts.append(len(least))
    for first, last in pairwise(cuts):
        if last - first < _AROUND:
            continue
        x, y = middles[first:last], least[first:last]
        slope = _robust_slope(x, y)
        slopes.append((last - first, slope, _slope_error(x, y, slope)))
        begin = firsts[first]
        end = firsts[last] if last < len(firsts) else len(at_s)
        rest = offset[begin:end] - slope * at_s[begin:end]
        rest = rest[~late[begin:end]]
        if len(rest):
            delays.append(rest - np.percentile(rest, 0.5))


def _steps(least: Floats) -> list[int]:
    """Return the intervals at which the offset changes for longer than one interval."""
    found: list[int] = []
    index = 1
    while index < len(least) - 1:
        before = least[max(0, index - _AROUND) : index]
        after = least[index : index + _AROUND]
        jump = float(np.median(after) - np.median(before))
        if (
            abs(jump) * 1e3 > STEP_MS
            and abs(float(least[index] - least[index - 1])) * 1e3 > 0.5 * STEP_MS
        ):
            found.append(index)
            index += _AROUND
        else:
            index += 1
    return found


def _grown(trips: list[tuple[float, float]], at_s: float) -> float | None:
    """Return the increase of the median round trip at a moment, ms; None: too few pings."""
    before = [trip for when, trip in trips if at_s - 3.0 <= when < at_s - 0.25]
    after = [trip for when, trip in trips if at_s + 0.25 <= when < at_s + 3.0]
    if not before or not after:
        return None
    return float(np.median(after) - np.median(before))


def _robust_slope(x: Floats, y: Floats) -> float:
    """Return the median slope of point pairs half the span apart (a reduced Theil-Sen fit)."""
    half = len(x) // 2
    return float(np.median((y[half:] - y[: len(y) - half]) / (x[half:] - x[: len(x) - half])))


def _slope_error(x: Floats, y: Floats, slope: float) -> float | None:
    """Return the uncertainty of the slope; None for too few points.

    σ follows from the median of the residuals. Each of the n/2 pairs has an error of √2·σ over half
    the span. The error of their median is 1.25/√(n/2) times this error. Correlated residuals do not
    average out. An example is the beat between a host that reads every millisecond and the device's
    stamps. So the uncertainty is at least 1.5 times the range of the residuals over the span. The
    factor is 1.5, because the fit has reduced that range.
    """
    count = len(x)
    if count < DRIFT_BUCKETS:
        return None
    rest = y - slope * x
    sigma = max(1.48 * float(np.median(np.abs(rest - np.median(rest)))), STAMP_S)
    half_span = float(x[count // 2] - x[0])
    scattered = DRIFT_SIGMAS * 1.25 * sigma * math.sqrt(2.0 / (count // 2)) / half_span
    return max(scattered, 1.5 * float(np.ptp(rest)) / float(x[-1] - x[0]))


def _timer_ms(chunk_ns: NDArray[np.int64]) -> float | None:
    """Return the period of the adapter's latency timer, ms; None: the reads show no period."""
    if len(chunk_ns) < MIN_FRAMES:
        return None
    wait_ms = np.diff(chunk_ns) * 1e-6
    period = float(np.percentile(wait_ms, 99))
    share = float((np.abs(wait_ms - period) < _TIMER_TOLERANCE * period).mean())
    possible = _MIN_TIMER_MS <= period <= _MAX_TIMER_MS
    return period if possible and share > _TIMER_SHARE else None

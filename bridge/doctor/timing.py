"""When frames came against when they were stamped: clocks, delays, holes and held-up hosts.

A frame's arrival less its stamp is the offset of the clocks and the delay on its way. The
least of them in each half second is the offset and the shortest delay; a line through those
is the clocks, what lies above it is delay, and where the line jumps, a clock or the line did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.doctor.wire_view import WireView

    Floats = NDArray[np.float64]

BUCKET_S = 0.5
STEP_MS = 5.0
"""Least jump of the offset between half seconds that is told."""
HOLE_S = 0.3
"""Without a frame of a device that sends one every 4 ms."""
STALL_S = 0.1
"""A host that reads a device's frames so much later than they were sent, all at once."""
AFTER_STALL_S = 0.1
_MS = 0.001
MIN_FRAMES = 50
DRIFT_BUCKETS = 6
"""Half seconds that a drift is judged by at least: fewer do not show how much they scatter."""
DRIFT_SIGMAS = 4.0
"""Standard errors by which a drift may be off: delays are no Gaussian noise."""
STAMP_S = 5e-6
"""Least scatter of an offset that is believed: a stamp's microsecond and the time of its taking."""
_WRAP, _HALF = 1 << 32, 1 << 31
_AROUND = 3
"""Half seconds before and after a step that are compared."""
_GRID_LEAST_MS, _GRID_MOST_MS = 4.0, 260.0
"""Timers that drivers allow; an FTDI adapter's goes up to 255 ms."""
_GRID_SHARE, _GRID_OFTEN = 0.03, 0.1


@dataclass(frozen=True, slots=True)
class Hole:
    """A time without frames."""

    at_s: float
    """Since the beginning of the capture."""
    for_s: float
    missing: int
    """Frames lost in it, by sequence numbers; up to 255 can be told."""
    stamped_s: float
    """By how much the stamps went on meanwhile."""


@dataclass(frozen=True, slots=True)
class Step:
    """A jump of the clocks' offset."""

    at_s: float
    by_ms: float
    """Positive: frames came later against their stamps than before."""
    round_trip_ms: float | None
    """By how much the round trip grew there; None: no pings."""


@dataclass(slots=True)
class Timing:
    """What was found; empty where there was too little."""

    duration_s: float = 0.0
    drift_ppm: float | None = None
    """Of the device's clock against the host's; positive: the device is slow."""
    drift_error_ppm: float | None = None
    """By how much the drift may be off, from how the delays scatter; ``None``: too short a time."""
    delay_ms: dict[str, float] = field(default_factory=dict)
    """Beyond the shortest: ``p50``, ``p95``, ``p99``, ``max``."""
    round_trip_ms: dict[str, float] = field(default_factory=dict)
    """``min``, ``p50``, ``p99``, ``max``."""
    timer_ms: float | None = None
    """Period at which the adapter hands bytes over, where it seems to keep one."""
    holes: list[Hole] = field(default_factory=list)
    stalls: list[Hole] = field(default_factory=list)
    """Holes in which nothing was lost: the host, or what is before it, was held up."""
    steps: list[Step] = field(default_factory=list)


def measure(view: WireView) -> Timing:
    """Work out the timing of a capture."""
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
    # A line that became slower is no host that was held up: its frames stay late.
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
    """Stamps in seconds without their wraps, and where each boot begins."""
    boots = [0]
    for boot in view.boots[1:]:
        index = int(np.searchsorted(arrived, boot.at_ns))
        if boots[-1] < index < len(arrived):
            boots.append(index)
    step = np.diff(stamps)
    step = (step + _HALF) % _WRAP - _HALF
    return np.concatenate(([0.0], np.cumsum(step))) * 1e-6, boots


def _find_holes(
    timing: Timing, at_s: Floats, stamp_s: Floats, skipped: NDArray[np.int64], boots: list[int]
) -> None:
    wait_s = np.diff(at_s)
    for index in np.flatnonzero(wait_s > STALL_S).tolist():
        if index + 1 in boots:
            continue
        missing = int(skipped[index + 1])
        hole = Hole(
            round(float(at_s[index]), 3),
            round(float(wait_s[index]), 3),
            missing,
            round(float(stamp_s[index + 1] - stamp_s[index]), 3),
        )
        # Held up: what came then was stamped while nothing came.
        if missing == 0 and hole.stamped_s < 0.5 * hole.for_s:
            timing.stalls.append(hole)
        elif hole.for_s > HOLE_S:
            timing.holes.append(hole)


def _of_stalls(timing: Timing, at_s: Floats) -> NDArray[np.bool_]:
    """Which frames had waited for a host that was held up: they say nothing of the line."""
    late = np.zeros(len(at_s), np.bool_)
    for stall in timing.stalls:
        end_s = stall.at_s + stall.for_s
        late |= (at_s > stall.at_s + _MS) & (at_s < end_s + AFTER_STALL_S)
    return late


def _judge_clock(  # noqa: PLR0913, PLR0917 - where what is found goes
    timing: Timing,
    at_s: Floats,
    stamp_s: Floats,
    late: NDArray[np.bool_],
    trips: list[tuple[float, float]],
    delays: list[Floats],
    slopes: list[tuple[int, float, float | None]],
) -> None:
    """Steps, drift and delays of one boot."""
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
            Step(round(at, 2), float(np.median(after) - np.median(before)) * 1e3, _grown(trips, at))
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
    """Buckets from which on the offset is another, for good and not for one of them."""
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
    """By how much (ms) the round trip's middle grew at a moment."""
    before = [trip for when, trip in trips if at_s - 3.0 <= when < at_s - 0.25]
    after = [trip for when, trip in trips if at_s + 0.25 <= when < at_s + 3.0]
    if not before or not after:
        return None
    return float(np.median(after) - np.median(before))


def _robust_slope(x: Floats, y: Floats) -> float:
    """Median of the slopes between points half the span apart (Theil and Sen, thinned)."""
    half = len(x) // 2
    return float(np.median((y[half:] - y[: len(y) - half]) / (x[half:] - x[: len(x) - half])))


def _slope_error(x: Floats, y: Floats, slope: float) -> float | None:
    """By how much that slope may be off.

    Each of the n/2 pairs is off by √2·σ over half the span, and their median by 1.25/√(n/2) of
    that; σ is taken from the median of the residuals. Residuals that follow each other, as where
    a host that reads every millisecond beats with the device's stamps, add no such certainty: the
    slope may be off by their range over the span, and half as much again since the fit has made
    that range small.
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
    """The longest time between two reads, where many of them take just that: a timer's."""
    if len(chunk_ns) < MIN_FRAMES:
        return None
    wait_ms = np.diff(chunk_ns) * 1e-6
    period = float(np.percentile(wait_ms, 99))
    share = float((np.abs(wait_ms - period) < _GRID_SHARE * period).mean())
    usual = _GRID_LEAST_MS <= period <= _GRID_MOST_MS
    return period if usual and share > _GRID_OFTEN else None

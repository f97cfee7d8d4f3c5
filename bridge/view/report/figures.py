"""Figures of a report: room, coverage over time, power, clock and link."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.view.report.drawing import floor_axes, tidy
from bridge.view.report.picture import draw_floor, draw_path, floor_legend

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes

    from bridge.view.report.run_data import RunData

INK, SOFT, BLUE, RED, GREEN, ORANGE = (
    "#20262c",
    "#5d6670",
    "#1f4e79",
    "#c0504d",
    "#3f8f5f",
    "#e08a2e",
)
OTHER = "#b03a48"
_POINTS = 400
"""Number of points of the coverage curve."""
_ROOM_HEIGHTS = (2.6, 9.0)
"""Minimum and maximum height of the figure of the room, inches."""
_ROOM_REST = 1.0
"""Height of the legend and the axis labels, inches."""


def room_ratio(data: RunData) -> float:
    """Return the ratio of height to width of the room or, without a room, of the path."""
    plan = data.track.plan
    points = plan.walls if plan is not None else [(p.x_m, p.y_m) for _, p in data.track.best]
    (x0, y0), (x1, y1) = np.min(points, axis=0), np.max(points, axis=0)
    return float((y1 - y0) / max(x1 - x0, 1e-3))


def room_height(data: RunData, width: float) -> float:
    """Return the height of a figure of this width for the room, inches."""
    low, high = _ROOM_HEIGHTS
    return min(max(width * room_ratio(data) + _ROOM_REST, low), high)


def draw_room(axes: Axes, data: RunData) -> None:
    """Draw the room with swept and unswept floor, the path, and a legend below."""
    meter, report = data.meter, data.coverage
    measured = None if meter is None or report is None else (meter, report)
    draw_floor(axes, data.track, measured)
    draw_path(axes, data.track)
    floor_axes(axes)
    lines, _ = axes.get_legend_handles_labels()
    # Use a figure legend, because a legend in the low axes of a corridor would hide the axis label.
    axes.figure.legend(
        handles=[*lines, *floor_legend(data.track)],
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=8,
    )


def draw_holes(axes: Axes, holes: Sequence[tuple[float, float, float, float]]) -> None:
    """Number the largest unswept pieces; each has x, y (m), area (cm²) and inradius (m)."""
    for number, (x_m, y_m, _, _) in enumerate(holes, 1):
        axes.annotate(
            str(number),
            (x_m, y_m),
            xytext=(9, 9),
            textcoords="offset points",
            fontsize=8,
            color=INK,
            zorder=7,
            bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": ORANGE, "lw": 1},
            arrowprops={"arrowstyle": "-", "color": ORANGE, "lw": 1},
        )


def coverage_curve(data: RunData) -> tuple[list[float], list[float]]:
    """Return times since the start of the drive (s) and the swept sweepable floor (%)."""
    report, meter = data.coverage, data.meter
    if report is None or meter is None:
        return [], []
    times = np.linspace(0.0, max(report.duration_s, 1e-3), _POINTS).tolist()
    return times, [100.0 * share for share in meter.share_at(report, times)]


def draw_coverage(axes: Axes, data: RunData, *, colour: str = BLUE, label: str = "swept") -> None:
    """Draw the swept share of the sweepable floor over time."""
    times, shares = coverage_curve(data)
    axes.plot(times, shares, color=colour, lw=1.8, label=label)


def draw_bounds(axes: Axes, data: RunData, paper_share: float | None) -> None:
    """Draw the lower bound of the time, the paper's coverage, and marks at 90 and 99 %."""
    report = data.coverage
    if report is None:
        return
    bound = report.min_time_s
    axes.plot(
        [0.0, bound, max(bound, report.duration_s)],
        [0.0, 100.0, 100.0],
        color=SOFT,
        lw=1.0,
        ls="--",
        label=f"lower bound: top speed, no overlap ({bound:.0f} s)",
    )
    for share, time_s, face in ((90, report.t90_s, "white"), (99, report.t99_s, ORANGE)):
        if time_s is not None:
            text = f"{share} % after {time_s:.0f} s"
            axes.plot([time_s], [share], "o", ms=6, mec=ORANGE, mfc=face, ls="none", label=text)
    if paper_share is not None:
        axes.axhline(
            100.0 * paper_share, color=RED, lw=0.8, ls=":", label="the paper (under the footprint)"
        )


def finish_coverage(axes: Axes) -> None:
    """Draw axes, grid and legend of a coverage plot."""
    axes.set_xlabel("time since the start of the drive (s)")
    axes.set_ylabel("swept share of the sweepable floor (%)")
    axes.set_ylim(0, 103)
    axes.set_xlim(left=0)
    tidy(axes)
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def draw_power(data: RunData, axes: Axes) -> None:
    """Draw the battery voltage and the motor current."""
    times, volts, left, right = np.array(data.power).T
    axes.plot(times, volts, color=GREEN, lw=1.2)
    axes.set_ylabel("battery (V)", color=GREEN)
    axes.set_xlabel("time in the log (s)")
    tidy(axes)
    beside = axes.twinx()
    beside.plot(times, left + right, color=ORANGE, lw=0.8, alpha=0.9)
    beside.set_ylabel("both motors (A)", color=ORANGE)
    beside.set_ylim(bottom=0)
    beside.spines[["top"]].set_visible(False)


def draw_clock(data: RunData, axes: Axes) -> None:
    """Draw the error bound of the clock and the round-trip time."""
    times, bound, trip, _ = np.array(data.clock).T
    axes.plot(times, bound, color=BLUE, lw=1.2, label="error bound")
    axes.plot(times, trip, color=SOFT, lw=0.9, label="round trip")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("time (ms)")
    axes.set_xlabel("time in the log (s)")
    tidy(axes)
    axes.legend(frameon=False, fontsize=8)


def draw_link(data: RunData, axes: Axes) -> None:
    """Draw the received and the lost frames of each second."""
    seconds, frames, lost = np.array(data.link).T
    whole = slice(-1)  # the last second is incomplete
    axes.plot(seconds[whole], frames[whole], color=BLUE, lw=1.2, label="frames a second")
    axes.fill_between(seconds, 0, lost, color=RED, lw=0, label="lost", step="mid")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time in the log (s)")
    tidy(axes)
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def draw_pose_error(data: RunData, axes: Axes) -> None:
    """Draw the distance between estimated and true position."""
    times, error = np.array(data.pose_error).T
    axes.plot(times, 1000.0 * error, color=OTHER, lw=1.2)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("position error (mm)")
    axes.set_xlabel("time since the first pose (s)")
    tidy(axes)


Panel = tuple[str, str, "Callable[[RunData, Axes], None]"]
"""Heading, note and drawing function of a plot."""


def panels(data: RunData) -> list[Panel]:
    """Return heading, note and drawing function of each plot for which the log has data."""
    made: list[Panel] = []
    if len(data.power) > 1:
        note = "A charged 16 V pack drops by a few tenths of a volt while the motors run."
        made.append(("Power", note, draw_power))
    if len(data.pose_error) > 1:
        note = "Only a simulation knows the true position."
        made.append(("Position error of the estimate", note, draw_pose_error))
    if len(data.clock) > 1:
        note = "The bound is the largest error of a sample's time; below 2 ms is good."
        made.append(("Clock", note, draw_clock))
    if len(data.link) > 2:  # noqa: PLR2004 - two whole seconds make a line
        note = "A constant rate shows a healthy link; lost frames are red."
        made.append(("Link", note, draw_link))
    return made

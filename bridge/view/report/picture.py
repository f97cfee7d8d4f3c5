"""The picture of a run: room, path, swept and unswept floor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.evaluation.metrics import CoverageMeter
from bridge.view.output import write
from bridge.view.report.drawing import as_png, blank, drawn_text, floor_axes
from bridge.view.report.run_track import load_track

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from bridge.evaluation.metrics import CoverageReport
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.view.report.run_track import RunTrack

MIN_SPAN_M = 1.0
_WALL, _OBSTACLE = "#30343b", "#9aa2ad"
_MOUTH, _BODY, _MISSED = "#8fd0b5", "#d9efe5", "#f0a35e"
_PATH, _ESTIMATE = "#1f4e79", "#b03a48"
_CARPET, _THRESHOLD, _CLIFF = "#8455a8", "#c98a00", "#c0392b"


def draw_run(log: Path, png: Path, *, warn: Callable[[str], None] = lambda _: None) -> Path:
    """Draw a run into a PNG and return its path; report each damage of the log with ``warn``.

    Raises:
        LogReadError: the log cannot be read.
        LogWriteError: the picture cannot be written.
        PlotMissingError: matplotlib is not installed.

    """
    figure = blank(8.0, 8.6)
    track = load_track(log)
    for problem in track.problems:
        warn(problem)
    axes = figure.add_subplot()
    draw_floor(axes, track)
    draw_path(axes, track)
    floor_axes(axes)
    figure.suptitle(drawn_text(_title(track)), fontsize=10, x=0.06, ha="left")
    lines, _ = axes.get_legend_handles_labels()
    axes.legend(
        handles=[*lines, *floor_legend(track)],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.07),
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    write(png, as_png(figure, dpi=120))  # always a PNG, for any suffix of the file
    return png


def draw_floor(
    axes: Axes,
    track: RunTrack,
    measured: tuple[CoverageMeter, CoverageReport] | None = None,
) -> None:
    """Draw swept and missed floor and the room's marks; draw nothing for an unknown room.

    ``measured`` is the run's coverage if the caller has already computed it.
    """
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - an extra

    if track.plan is None:
        return
    if measured is None:
        meter = CoverageMeter(track.plan, track.model, 0.01)
        measured = meter, meter.measure((t, *pose) for t, pose in track.best)
    meter, report = measured
    swept = np.isfinite(report.first_swept_s)
    layers = np.zeros(swept.shape)
    layers[report.body_swept] = 1
    layers[meter.regions.sweepable] = 3
    layers[swept] = 2
    x0, y0 = report.origin_m
    rows, columns = swept.shape
    size = report.resolution_m
    axes.imshow(
        np.ma.masked_equal(layers, 0),
        origin="lower",
        extent=(x0, x0 + columns * size, y0, y0 + rows * size),
        cmap=ListedColormap([_BODY, _MOUTH, _MISSED]),
        vmin=1,
        vmax=3,
        interpolation="nearest",
        zorder=1,
    )
    draw_plan(axes, track.plan)


def draw_plan(axes: Axes, plan: FloorPlan, *, obstacles: str = _OBSTACLE) -> None:
    """Draw the contents of a room file: walls, obstacles, carpets, thresholds and cliffs."""
    from matplotlib.patches import Polygon  # noqa: PLC0415 - an extra

    axes.add_patch(Polygon(plan.walls, closed=True, fill=False, edgecolor=_WALL, lw=2.5, zorder=4))
    for obstacle in plan.obstacles:
        axes.add_patch(
            Polygon(obstacle, closed=True, facecolor=obstacles, edgecolor=_WALL, lw=1.2, zorder=3)
        )
    for polygon, how in (
        *((carpet.polygon, _carpet()) for carpet in plan.carpets),
        *((cliff, _cliff()) for cliff in plan.cliffs),
    ):
        axes.add_patch(Polygon(polygon, closed=True, zorder=2, **how))
    for begin, end, _ in plan.thresholds:
        xs, ys = zip(begin, end, strict=True)
        axes.plot(xs, ys, color=_THRESHOLD, lw=3.0, solid_capstyle="butt", zorder=4)


def _carpet() -> dict[str, Any]:
    return {"facecolor": "none", "edgecolor": _CARPET, "hatch": "..", "lw": 1.2}


def _cliff() -> dict[str, Any]:
    return {"facecolor": "none", "edgecolor": _CLIFF, "hatch": "xx", "lw": 1.6}


def plan_legend(plan: FloorPlan | None) -> list[Artist]:
    """Return the legend of the room's marks."""
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    if plan is None:
        return []
    found: list[Artist] = []
    if plan.carpets:
        found.append(Patch(label="carpet", **_carpet()))
    if plan.thresholds:
        found.append(Line2D([], [], color=_THRESHOLD, lw=3.0, label="threshold"))
    if plan.cliffs:
        found.append(Patch(label="cliff: no floor", **_cliff()))
    return found


def floor_legend(track: RunTrack) -> list[Artist]:
    """Return the legend of the floor's colours and the room's marks."""
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    if track.plan is None:
        return []
    return [
        Patch(facecolor=colour, label=text)
        for colour, text in (
            (_MOUTH, "swept by the mouth"),
            (_BODY, "under the footprint only"),
            (_MISSED, "sweepable, not swept"),
        )
    ] + plan_legend(track.plan)


def draw_path(axes: Axes, track: RunTrack) -> None:
    """Draw the true and the estimated path."""
    for poses, colour, text, style in (
        (track.truth, _PATH, "path", "-"),
        (track.estimate, _ESTIMATE, "estimated path", (0, (4, 3))),
    ):
        if not poses:
            continue
        xs, ys = [p.x_m for _, p in poses], [p.y_m for _, p in poses]
        axes.plot(xs, ys, color=colour, lw=1.2, ls=style, label=text, zorder=5)
    if track.best:
        first, last = track.best[0][1], track.best[-1][1]
        mark: dict[str, Any] = {"zorder": 6, "ls": "none", "mec": "white"}
        axes.plot(first.x_m, first.y_m, "o", color=_PATH, ms=8, label="start", **mark)
        axes.plot(last.x_m, last.y_m, "s", color=_PATH, ms=8, label="end", **mark)
    _widen(axes)


def _widen(axes: Axes) -> None:
    """Add floor on both sides of a straight path if the room is unknown."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    min_m = max(MIN_SPAN_M, max(right - left, top - bottom) / 3.0)
    more_x = max(0.0, min_m - (right - left)) / 2.0
    more_y = max(0.0, min_m - (top - bottom)) / 2.0
    if more_x:
        axes.set_xlim(left - more_x, right + more_x)
    if more_y:
        axes.set_ylim(bottom - more_y, top + more_y)


def _title(track: RunTrack) -> str:
    summary = track.summary
    parts = [str(summary[k]) for k in ("room", "planner") if summary.get(k)]
    if summary.get("seed") is not None:
        parts.append(f"seed {summary['seed']}")
    lines = [", ".join(parts) or track.name]
    figures = []
    if summary.get("duration_s") is not None:
        figures.append(f"{summary['duration_s']:.0f} s")
    if summary.get("path_m") is not None:
        figures.append(f"{summary['path_m']:.1f} m")
    coverage = summary.get("coverage") or {}
    if coverage.get("mouth_sweepable") is not None:
        figures.append(f"mouth {100 * coverage['mouth_sweepable']:.1f} % of sweepable")
    if coverage.get("body_free") is not None:
        figures.append(f"footprint {100 * coverage['body_free']:.1f} % of floor")
    if summary.get("outcome"):
        figures.append(str(summary["outcome"]))
    lines.append("  ·  ".join(figures))
    return "\n".join(line for line in lines if line)

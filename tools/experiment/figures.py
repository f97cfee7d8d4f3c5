"""Figures of the report as SVG text: curves, and paths in rooms (paper: Figs. 14, 16 to 18)."""

from __future__ import annotations

from importlib.util import find_spec
from statistics import fmean
from typing import TYPE_CHECKING

from bridge.view.report.drawing import PlotMissingError, as_svg, blank, tidy
from tools.experiment.compare_tables import display_name, shared
from tools.experiment.curves import MULTIPLES
from tools.experiment.cycles import PAPER_END_MM
from tools.experiment.paper_tables import cycle_spread
from tools.experiment.tables import group
from tools.experiment.trials import OPEN_FLOOR, TrialKind, robot_label, room_of
from tools.experiment.u_cycles import PAPER_CYCLES
from tools.experiment.unswept_causes import CAUSES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from tools.experiment.paired_differences import Pair
    from tools.experiment.store import Row

_COLOURS = {"recovery": "#1f4e79", "paper": "#c0504d", "u-shape": "#6b9e46", "random": "#8a8f98"}
_OTHER = "#444444"
_THEIRS = ("#7b4fa3", "#c98a1b", "#2a9d8f", "#b5446e")
_CAUSE_COLOURS = ("#7b4fa3", "#c0504d", "#1f4e79", "#7fa7cc", "#c98a1b")


def check() -> None:
    """Check, before the runs start, that figures can be drawn.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    if find_spec("matplotlib") is None:
        raise PlotMissingError


def coverage_curves(rows: Sequence[Row], noise: str) -> str:
    """Draw coverage against time and energy, in multiples of their references."""
    figure = blank(9.6, 4.0)
    over_time, over_energy = figure.subplots(1, 2, sharey=True)
    at_level = [row for row in rows if row["noise"] == noise]
    for (planner,), runs in group(at_level, "planner").items():
        colour = _COLOURS.get(planner, _OTHER)
        for axes, curve in ((over_time, "coverage"), (over_energy, "by_energy")):
            shares = _mean_curve(runs, curve)
            xs = [0, *MULTIPLES[: len(shares)]]
            axes.plot(xs, [0, *shares], "o-", ms=3, color=colour, label=planner)
    over_time.set_xlabel("time / reference time")
    over_energy.set_xlabel("energy / reference energy")
    _finish(over_time, over_energy)
    return as_svg(figure)


def zimablue_curves(rows: Sequence[Row]) -> str:
    """Draw the coverage of our planners and zimablue's, against their own references."""
    figure = blank(9.6, 4.0)
    over_time, over_path = figure.subplots(1, 2, sharey=True)
    theirs = 0
    for (planner, noise), runs in group(shared(rows), "planner", "noise").items():
        name, colour, style = f"{planner}, {noise}", _COLOURS.get(planner, _OTHER), "o-"
        if runs[0]["kind"] == TrialKind.ZIMABLUE:
            name, colour, style = display_name(planner), _THEIRS[theirs % len(_THEIRS)], "s--"
            theirs += 1
        for axes, curve in ((over_time, "coverage"), (over_path, "by_path")):
            shares = _mean_curve(runs, curve)
            xs = [0, *MULTIPLES[: len(shares)]]
            axes.plot(xs, [0, *shares], style, ms=3, lw=1.3, color=colour, label=name)
    over_time.set_xlabel("time / own reference time")
    over_path.set_xlabel("path / own reference path")
    _finish(over_time, over_path)
    return as_svg(figure)


def versions_figure(pairs: Sequence[Pair]) -> str:
    """Draw coverage and time ratio of each run against the values with the earlier version."""
    figure = blank(9.6, 4.4)
    for axes, name, scale, unit in zip(
        figure.subplots(1, 2),
        ("mouth_sweepable", "time_ratio"),
        (100.0, 1.0),
        ("mouth, % of sweepable", "time ratio"),
        strict=True,
    ):
        for planner in dict.fromkeys(after["planner"] for _, after in pairs):
            mine = [(before, after) for before, after in pairs if after["planner"] == planner]
            axes.plot(
                [scale * before[name] for before, _ in mine],
                [scale * after[name] for _, after in mine],
                "o",
                ms=3,
                color=_COLOURS.get(planner, _OTHER),
                label=planner,
            )
        both = [scale * row[name] for pair in pairs for row in pair]
        ends = [min(both), max(both)]
        axes.plot(ends, ends, color="#b9c2cc", lw=0.8, zorder=0)
        axes.set_xlabel(f"{unit}, before")
        axes.set_ylabel(f"{unit}, after")
        axes.legend(frameon=False, fontsize=8)
        tidy(axes)
    return as_svg(figure)


def _mean_curve(runs: Sequence[Row], curve: str) -> list[float]:
    """Return the mean coverage, %, at the multiples that all runs reached."""
    shares: list[float] = []
    for k in range(len(MULTIPLES)):
        points = [run["curve"][curve][k] for run in runs]
        known = [point for point in points if point is not None]
        if len(known) < len(points):
            break
        shares.append(100 * fmean(known))
    return shares


def _finish(left: Axes, right: Axes) -> None:
    left.set_ylabel("mouth, % of sweepable")
    for axes in (left, right):
        tidy(axes)
        axes.set_ylim(0, 102)
        axes.set_xlim(left=0)
    left.legend(frameon=False, loc="lower right", fontsize=8)


def cycles_figure(rows: Sequence[Row]) -> str:
    """Draw Fig. 15: the offset after each cycle for every seed, with median and quartiles."""
    figure = blank(7.0, 3.6)
    axes = figure.add_subplot()
    for row in rows:
        points = row["offsets"]
        axes.plot(
            [0, *(point["cycle"] for point in points)],
            [0, *(point["offset_mm"] for point in points)],
            lw=0.6,
            color="#b9c2cc",
        )
    spread = cycle_spread(rows)
    cycles = range(len(spread) + 1)
    low, middle, high = ([0, *(point[k] for point in spread)] for k in range(3))
    axes.fill_between(cycles, low, high, alpha=0.2, color="#1f4e79", lw=0, label="quartiles")
    axes.plot(cycles, middle, "o-", ms=4, color="#1f4e79", label=f"median of {len(rows)} seeds")
    axes.plot([PAPER_CYCLES], [PAPER_END_MM], "D", ms=7, color="#c0504d", label="the paper: 7 mm")
    axes.set_xlabel("U-shaped cycles")
    axes.set_ylabel("offset, mm")
    axes.set_xlim(0, PAPER_CYCLES + 0.3)
    axes.set_ylim(bottom=0)
    tidy(axes)
    axes.legend(frameon=False, loc="upper left")
    return as_svg(figure)


def smoothing_figure(row: Row) -> str:
    """Draw Fig. 12: the forward speed before and after smoothing."""
    figure = blank(7.0, 3.2)
    axes = figure.add_subplot()
    times, wanted, sent = zip(*row["smoothing"], strict=True)
    axes.plot(times, wanted, lw=0.9, color="#c0504d", label="before smoothing")
    axes.plot(times, sent, lw=1.4, color="#1f4e79", label="after: low-pass and acceleration limit")
    axes.set_xlabel("time, s")
    axes.set_ylabel("forward speed, m/s")
    axes.set_ylim(top=1.3 * max(wanted))
    tidy(axes)
    axes.legend(frameon=False, loc="upper right", ncols=2, fontsize=8)
    return as_svg(figure)


def loss_figure(rows: Sequence[Row]) -> str:
    """Draw the lost coverage by cause, a bar for each planner and noise level."""
    groups = group(rows, "planner", "noise")
    figure = blank(8.0, 1.2 + 0.45 * len(groups))
    axes = figure.add_subplot()
    names = [f"{planner}, {noise}" for planner, noise in groups]
    base = [0.0] * len(groups)
    for cause, colour in zip(CAUSES, _CAUSE_COLOURS, strict=True):
        widths = [100 * fmean(run["loss"][cause] for run in runs) for runs in groups.values()]
        axes.barh(names, widths, left=base, color=colour, label=cause, height=0.6)
        base = [a + b for a, b in zip(base, widths, strict=True)]
    axes.invert_yaxis()
    axes.set_xlabel("not swept, % of the sweepable floor")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        frameon=False, fontsize=8, ncols=len(CAUSES), loc="lower left", bbox_to_anchor=(0, 1)
    )
    return as_svg(figure)


def path_picture(row: Row) -> str:
    """Draw the path of a run in its room."""
    figure = blank(4.2, 4.2)
    axes = figure.add_subplot()
    if row["room"] != OPEN_FLOOR:  # the walls of this room are 10 m away
        _room(axes, row["room"])
    xs, ys = zip(*row["path"], strict=True) if row["path"] else ((), ())
    colour = _COLOURS.get(row["planner"].partition(",")[0], _OTHER)
    axes.plot(xs, ys, lw=0.8, color=colour)
    if xs:
        axes.plot(xs[0], ys[0], "o", ms=6, color="black")
        axes.plot(xs[-1], ys[-1], "s", ms=6, color="black")
    mouth, body = row.get("mouth_sweepable"), row.get("body_free")
    title = f"{row['room']}, {display_name(row['planner'])}, {row['noise']}, seed {row['seed']}"
    if row["robot"]:
        title += f", robot {robot_label(row['robot'])}"
    if row.get("offsets"):
        title += f"\n{len(row['offsets'])} cycles, {row['path_m']:.1f} m, {row['duration_s']:.0f} s"
    elif mouth is not None and body is not None:
        title += f"\nmouth {100 * mouth:.1f} %, body {100 * body:.1f} %, {row['duration_s']:.0f} s"
    axes.set_title(title, fontsize=8)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return as_svg(figure)


def _room(axes: Axes, name: str) -> None:
    from bridge.view.report.picture import draw_plan

    plan = room_of(name)
    draw_plan(axes, plan, obstacles="#c9ced6")
    xs, ys = zip(*plan.walls, strict=True)
    axes.set_xlim(min(xs) - 0.1, max(xs) + 0.1)
    axes.set_ylim(min(ys) - 0.1, max(ys) + 0.1)

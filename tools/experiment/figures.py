"""The report's figures as SVG text: curves, and paths in their rooms (Figs. 14, 16 to 18)."""

from __future__ import annotations

import io
from importlib.util import find_spec
from statistics import fmean
from typing import TYPE_CHECKING

from bridge.view.picture import PlotMissingError
from tools.experiment.tables import group
from tools.experiment.trials import room_of
from tools.experiment.worker import MULTIPLES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tools.experiment.store import Row

_COLOURS = {"recovery": "#1f4e79", "paper": "#c0504d", "u-shape": "#6b9e46", "random": "#8a8f98"}
_OTHER = "#444444"


def check() -> None:
    """Find out before hours of runs whether figures can be drawn.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    if find_spec("matplotlib") is None:
        raise PlotMissingError


def coverage_curves(rows: Sequence[Row], noise: str) -> str:
    """Coverage against time in multiples of the lower bound, and against energy."""
    figure = _figure(9.6, 3.8)
    over_time, over_energy = figure.subplots(1, 2, sharey=True)
    at_level = [row for row in rows if row["noise"] == noise]
    for (planner,), runs in group(at_level, "planner").items():
        colour = _COLOURS.get(planner, _OTHER)
        points = range(len(MULTIPLES))
        shares = [100 * fmean(run["curve"]["coverage"][k] for run in runs) for k in points]
        energy = [
            1000 * fmean(run["curve"]["energy_wh"][k] / run["sweepable_m2"] for run in runs)
            for k in points
        ]
        over_time.plot([0, *MULTIPLES], [0, *shares], "o-", ms=3, color=colour, label=planner)
        over_energy.plot([0, *energy], [0, *shares], "o-", ms=3, color=colour)
    over_time.set_xlabel("time / (sweepable area / (W · cruise speed))")
    over_energy.set_xlabel("energy, mWh per sweepable m²")
    over_time.set_ylabel("mouth, % of sweepable")
    for axes in (over_time, over_energy):
        axes.grid(alpha=0.25)
        axes.set_ylim(0, 102)
    over_time.legend(frameon=False, loc="lower right")
    return _svg(figure)


def path_picture(row: Row) -> str:
    """One run's path in its room."""
    figure = _figure(4.2, 4.2)
    axes = figure.add_subplot()
    _room(axes, row["room"])
    xs, ys = zip(*row["path"], strict=True) if row["path"] else ((), ())
    axes.plot(xs, ys, lw=0.8, color=_COLOURS.get(row["planner"], _OTHER))
    if xs:
        axes.plot(xs[0], ys[0], "o", ms=6, color="black")
        axes.plot(xs[-1], ys[-1], "s", ms=6, color="black")
    mouth, body = row["mouth_sweepable"], row["body_free"]
    title = f"{row['room']}, {row['planner']}, {row['noise']}, seed {row['seed']}"
    if mouth is not None:
        title += f"\nmouth {100 * mouth:.1f} %, body {100 * body:.1f} %, {row['duration_s']:.0f} s"
    axes.set_title(title, fontsize=8)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return _svg(figure)


def _room(axes: Axes, name: str) -> None:
    from matplotlib.patches import Polygon

    plan = room_of(name)
    axes.add_patch(Polygon(plan.walls, closed=True, fill=False, edgecolor="#30343b", lw=2))
    for obstacle in plan.obstacles:
        axes.add_patch(Polygon(obstacle, closed=True, facecolor="#c9ced6", edgecolor="#30343b"))
    xs, ys = zip(*plan.walls, strict=True)
    axes.set_xlim(min(xs) - 0.1, max(xs) + 0.1)
    axes.set_ylim(min(ys) - 0.1, max(ys) + 0.1)


def series_figure(
    lines: Sequence[tuple[str, Sequence[float], Sequence[float]]], x_label: str, y_label: str
) -> str:
    """Plain curves: name, x and y of each."""
    figure = _figure(7.0, 3.2)
    axes = figure.add_subplot()
    for name, xs, ys in lines:
        axes.plot(xs, ys, lw=1.0, label=name)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=8)
    return _svg(figure)


def _figure(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def _svg(figure: Figure) -> str:
    """The figure, the same text for the same data."""
    import matplotlib as mpl

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "sweepctl", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]

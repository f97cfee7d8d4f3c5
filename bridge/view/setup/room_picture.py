"""Picture of a room: free, reachable and sweepable floor, carpets, thresholds and cliffs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.view.report.drawing import as_png, blank, drawn_text, floor_axes
from bridge.view.report.picture import draw_plan, plan_legend

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from bridge.evaluation.room_facts import RoomFacts
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_FREE, _REACHABLE, _SWEEPABLE, _ROBOT = "#f2c9a5", "#f7efb2", "#bfe3d0", "#1f4e79"
_WIDTH, _MIN_HEIGHT, _MAX_HEIGHT, _REST = 8.0, 4.0, 12.0, 1.6
"""Size of the picture, inches; ``_REST`` is for title and legend."""


def room_picture(plan: FloorPlan, model: RobotModel, facts: RoomFacts) -> bytes:
    """Draw a room for a robot; return the PNG.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    x0, y0, x1, y1 = plan.bounds()
    height = _WIDTH * (y1 - y0) / max(x1 - x0, 1e-3) + _REST
    figure = blank(_WIDTH, min(max(height, _MIN_HEIGHT), _MAX_HEIGHT))
    axes = figure.add_subplot()
    _draw_floor(axes, facts)
    draw_plan(axes, plan)
    _draw_start(axes, plan, model)
    for area in facts.separate:
        axes.plot(area.x_m, area.y_m, "x", color="#c0392b", ms=9, mew=2, zorder=6)
    margin_m = 0.03 * max(x1 - x0, y1 - y0)
    axes.set_xlim(x0 - margin_m, x1 + margin_m)
    axes.set_ylim(y0 - margin_m, y1 + margin_m)
    floor_axes(axes)
    figure.suptitle(drawn_text(_title(plan, model, facts)), fontsize=10, x=0.06, ha="left")
    figure.legend(
        handles=_legend(plan, facts),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    return as_png(figure, dpi=120)


def _title(plan: FloorPlan, model: RobotModel, facts: RoomFacts) -> str:
    return (
        f"{plan.name}\n{facts.free_m2:.2f} m² free; a robot of {model.robot_diameter_m:g} m "
        f"reaches {facts.reachable_m2:.2f} m² and sweeps {facts.sweepable_m2:.2f} m²"
    )


def _draw_floor(axes: Axes, facts: RoomFacts) -> None:
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - an extra

    regions = facts.regions
    layers = np.zeros(regions.free.shape)
    layers[regions.free] = 1
    layers[regions.reachable] = 2
    layers[regions.sweepable] = 3
    raster, (rows, columns) = regions.raster, regions.free.shape
    size_m = raster.resolution_m
    axes.imshow(
        np.ma.masked_equal(layers, 0),
        origin="lower",
        extent=(
            raster.x_min_m,
            raster.x_min_m + columns * size_m,
            raster.y_min_m,
            raster.y_min_m + rows * size_m,
        ),
        cmap=ListedColormap([_FREE, _REACHABLE, _SWEEPABLE]),
        vmin=1,
        vmax=3,
        interpolation="nearest",
        zorder=1,
    )


def _draw_start(axes: Axes, plan: FloorPlan, model: RobotModel) -> None:
    """Draw the footprint at the start, with its heading."""
    from matplotlib.patches import Circle  # noqa: PLC0415 - an extra

    x_m, y_m, theta_rad = plan.start
    radius_m = model.radius_m
    axes.add_patch(
        Circle((x_m, y_m), radius_m, facecolor="white", edgecolor=_ROBOT, lw=1.6, zorder=5)
    )
    tip = (x_m + radius_m * math.cos(theta_rad), y_m + radius_m * math.sin(theta_rad))
    axes.annotate(
        "", tip, (x_m, y_m), arrowprops={"arrowstyle": "-|>", "color": _ROBOT, "lw": 1.6}, zorder=6
    )


def _legend(plan: FloorPlan, facts: RoomFacts) -> list[Artist]:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    found: list[Artist] = [
        Patch(facecolor=colour, label=text)
        for colour, text in (
            (_SWEEPABLE, "sweepable: the mouth can reach it"),
            (_REACHABLE, "reachable: the footprint can cover it"),
            (_FREE, "free: not reachable"),
        )
    ]
    found.append(
        Line2D([], [], marker="o", ls="none", mfc="white", mec=_ROBOT, ms=9, label="start")
    )
    if facts.separate:
        found.append(
            Line2D([], [], marker="x", ls="none", color="#c0392b", ms=8, mew=2, label="cut off")
        )
    return found + plan_legend(plan)

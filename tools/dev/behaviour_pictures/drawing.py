"""Drawing of rooms, robots, paths and maps."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.view.report.drawing import blank, floor_axes
from bridge.view.report.picture import draw_plan
from tools.dev.behaviour_pictures.runs import MODEL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from tools.dev.behaviour_pictures.runs import MapView, PicturedRun, Sample

_MARGIN_M = 0.06
"""Margin around a drawn room, m."""
_SHORT_M = 0.05
"""Minimum length of a drawn piece of the path, m."""
GREY, BLUE, GREEN, ORANGE, RED = "#8a919c", "#1f4e79", "#2a8c63", "#d9822b", "#b03a48"
VIOLET, _SWEPT, _FORBIDDEN = "#7a4ea3", "#d9efe5", "#f3c9a0"
_HULL = "#30343b"
_ROBOT: dict[str, Any] = {"fill": False, "ec": _HULL, "lw": 1.2, "zorder": 7}
_TOP_M_S = 0.3
"""Upper end of the speed's colour scale, m/s."""
_STATES = {
    "approach": ("transit", GREY),
    "transit": ("transit", GREY),
    "recovery-transit": ("transit", GREY),
    "step": ("transit", GREY),
    "recovery-back": ("transit", GREY),
    "recovery-step": ("transit", GREY),
    "recovery-return": ("transit", GREY),
    "perimeter": ("perimeter pass", BLUE),
    "lane": ("lane", GREEN),
    "recovery-lane": ("recovery lane", ORANGE),
    "heading-fix": ("heading fix", VIOLET),
}
"""Legend text and colour of the planner's states."""
_STANDING = frozenset({"idle", "think", "finished"})
"""States in which the robot stands still."""


def xy(poses: Sequence[Pose2]) -> tuple[list[float], list[float]]:
    """Return the x and y coordinates of poses, m."""
    return [pose.x_m for pose in poses], [pose.y_m for pose in poses]


def true_path(run: PicturedRun, begin_s: float, end_s: float) -> list[Pose2]:
    """Return the true poses of a time span."""
    return [pose for t_s, pose in run.truth if begin_s <= t_s <= end_s]


def true_at(run: PicturedRun, t_s: float) -> Pose2:
    """Return the true pose at a time."""
    return min(run.truth, key=lambda entry: abs(entry[0] - t_s))[1]


def draw_room(axes: Axes, plan: FloorPlan) -> None:
    """Draw the walls and obstacles of a room, with a margin."""
    draw_plan(axes, plan, obstacles="#c9ced6")
    floor_axes(axes)
    x0, y0, x1, y1 = plan.bounds()
    axes.set_xlim(x0 - _MARGIN_M, x1 + _MARGIN_M)
    axes.set_ylim(y0 - _MARGIN_M, y1 + _MARGIN_M)


def draw_swept(axes: Axes, run: PicturedRun, end_s: float) -> None:
    """Draw the floor that the mouth had swept until a time."""
    from matplotlib.colors import ListedColormap

    from bridge.evaluation.metrics import CoverageMeter

    meter = CoverageMeter(run.plan, MODEL, 0.01)
    report = meter.measure((t_s, *pose) for t_s, pose in run.truth if t_s <= end_s)
    done = np.isfinite(report.first_swept_s)
    x0, y0 = report.origin_m
    rows, columns = done.shape
    size = report.resolution_m
    axes.imshow(
        np.ma.masked_equal(done, 0),
        origin="lower",
        extent=(x0, x0 + columns * size, y0, y0 + rows * size),
        cmap=ListedColormap([_SWEPT]),
        interpolation="nearest",
        zorder=1,
    )


def draw_robot(axes: Axes, pose: Pose2, *, mouth: bool = True) -> None:
    """Draw the footprint, the heading and the mouth."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle(pose[:2], MODEL.radius_m, **_ROBOT))
    bow = pose.transform(MODEL.radius_m, 0.0)
    axes.plot([pose.x_m, bow[0]], [pose.y_m, bow[1]], color=_HULL, lw=1.2, zorder=7)
    if mouth:
        half = 0.5 * MODEL.cleaning_width_m
        ends = pose.transform(0.0, half), pose.transform(0.0, -half)
        axes.plot(*zip(*ends, strict=True), color=_HULL, lw=3.0, zorder=7)


def draw_path(axes: Axes, samples: Sequence[Sample], *, states: Sequence[str] = ()) -> None:
    """Draw the estimated path, coloured by the planner's state."""
    shown: set[str] = set()
    begin = 0
    for k in range(1, len(samples) + 1):
        if k < len(samples) and samples[k].state == samples[begin].state:
            continue
        state = samples[begin].state
        part = samples[begin : min(k + 1, len(samples))]
        begin = k
        if state in _STANDING or (states and state not in states):
            continue
        if sum(a.obs.pose.distance_m(b.obs.pose) for a, b in itertools.pairwise(part)) < _SHORT_M:
            continue
        name, colour = _STATES[state]
        thin = name == "transit"
        axes.plot(
            *xy([sample.obs.pose for sample in part]),
            color=colour,
            lw=1.0 if thin else 1.8,
            ls=(0, (3, 2)) if thin else "-",
            label=None if name in shown else name,
            zorder=5,
        )
        shown.add(name)


def put_note(axes: Axes, x_m: float, y_m: float, text: str, to: tuple[float, float]) -> None:
    """Draw a note with an arrow; ``to`` is the offset of the text in points."""
    axes.annotate(
        text,
        (x_m, y_m),
        to,
        textcoords="offset points",
        fontsize=8,
        ha="center",
        va="center",
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": GREY, "lw": 0.6},
        arrowprops={"arrowstyle": "-|>", "color": "#30343b", "lw": 0.8},
        zorder=9,
    )


def put_legend(axes: Axes, columns: int = 3, **place: Any) -> None:  # noqa: ANN401 - matplotlib's
    """Put a legend below the axes."""
    how = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False, **place}
    axes.legend(ncols=columns, fontsize=8, **how)


def side_by_side(
    width: float,
    height: float,
    count: int,
    **ratios: Any,  # noqa: ANN401 - matplotlib's
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes side by side; width and height in inches."""
    figure = blank(width, height)
    axes = figure.subplots(1, count, squeeze=False, **ratios)
    return figure, list(axes[0])


def put_title(axes: Axes, text: str) -> None:
    """Put a title above the left edge of the axes."""
    axes.set_title(text, fontsize=9, loc="left")


def draw_map(axes: Axes, view: MapView) -> None:
    """Draw occupied and forbidden cells."""
    from matplotlib.colors import ListedColormap

    layers = np.where(view.occupied, 2, np.where(view.forbidden > 0, 1, 0))
    axes.imshow(
        np.ma.masked_equal(layers, 0),
        origin="lower",
        extent=view.extent,
        cmap=ListedColormap([_FORBIDDEN, RED]),
        vmin=1,
        vmax=2,
        interpolation="nearest",
        zorder=2,
    )


def map_legend() -> list[Artist]:
    """Return the handles of a legend for maps."""
    from matplotlib.patches import Patch

    return [
        Patch(color=RED, label="occupied cell"),
        Patch(color=_FORBIDDEN, label="cell forbidden to the axle"),
        Patch(facecolor="#c9ced6", edgecolor="#30343b", label="true obstacle"),
    ]


def draw_speed(axes: Axes, samples: Sequence[Sample]) -> Any:  # noqa: ANN401 - matplotlib's
    """Draw the path, coloured by the speed."""
    from matplotlib.collections import LineCollection

    samples = samples[::4]
    points = np.array([sample.obs.pose[:2] for sample in samples])
    lines = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)),
        cmap="viridis",
        norm=_norm(),
        lw=2.4,
        zorder=5,
    )
    lines.set_array(np.array([sample.command.v_m_s for sample in samples[1:]]))
    axes.add_collection(lines)
    return lines


def _norm() -> Any:  # noqa: ANN401 - matplotlib's
    from matplotlib.colors import Normalize

    return Normalize(0.0, _TOP_M_S)


def unique_handles(*groups: Sequence[Artist]) -> list[Artist]:
    """Return the legend handles of all panels, one handle for each name."""
    return list({str(artist.get_label()): artist for group in groups for artist in group}.values())

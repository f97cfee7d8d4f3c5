"""Picture of a robot: footprint, mouth, wheels, sensors with their cones, blind arcs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.view.report.drawing import as_png, blank, drawn_text, floor_axes
from bridge.view.setup.hull import Arc, hull_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bridge.motion.robot_model import RangerMount, RobotModel

_VIEW = 2.4
"""Half of the picture's side, in radii of the footprint. It shows short infrared ranges
completely."""
_FOOTPRINT, _RIM, _MOUTH, _WHEEL = "#eef1f4", "#8a929c", "#2f9e6e", "#30343b"
_CONE, _NEAR, _SEEN = "#1f6fb2", "#c0392b", "#1f6fb2"
_RIM_POINTS = 200
"""Number of corners of a drawn piece of the hull."""
_VISIBLE_RAD = math.radians(5.0)
"""Minimum size of a drawn piece of the hull, rad. A smaller piece would be invisible."""
_WHEEL_WIDTH_M = 0.02
"""Width of a drawn wheel, m. The robot file does not specify it."""


def robot_picture(model: RobotModel) -> bytes:
    """Draw a robot from above, with the heading up; return the PNG.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    figure = blank(8.0, 8.8)
    axes = figure.add_subplot()
    _draw_body(axes, model)
    for name, mount in model.rangers.items():
        _draw_ranger(axes, name, mount, model)
    _draw_hull(axes, model)
    half_m = _VIEW * model.radius_m
    axes.set_xlim(half_m, -half_m)  # y to the left, as seen by a person behind the robot
    axes.set_ylim(-half_m, half_m)
    floor_axes(axes)
    axes.set_xlabel("y (m), left of the axle's centre")
    axes.set_ylabel("x (m), ahead of the axle")
    axes.grid(alpha=0.25)
    figure.suptitle(drawn_text(_title(model)), fontsize=10, x=0.06, ha="left")
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return as_png(figure, dpi=120)


def _title(model: RobotModel) -> str:
    return (
        f"{model.name}\nfootprint {model.robot_diameter_m:g} m, mouth "
        f"{model.cleaning_width_m:g} m wide and {model.mouth_offset_m:g} m ahead of the axle, "
        f"wheel base {model.wheel_base_m:g} m"
    )


def _draw_body(axes: Axes, model: RobotModel) -> None:
    """Draw footprint, heading, wheels and mouth. The picture's axes are (y, x) of the robot."""
    from matplotlib.patches import Circle, Rectangle  # noqa: PLC0415 - an extra

    radius_m = model.radius_m
    axes.add_patch(Circle((0.0, 0.0), radius_m, facecolor=_FOOTPRINT, edgecolor="none", zorder=1))
    for side in (1.0, -1.0):
        left_m = side * 0.5 * model.wheel_base_m - 0.5 * _WHEEL_WIDTH_M
        corner = (left_m, -0.5 * model.wheel_diameter_m)
        axes.add_patch(
            Rectangle(corner, _WHEEL_WIDTH_M, model.wheel_diameter_m, color=_WHEEL, zorder=3)
        )
    axes.plot([], [], "s", color=_WHEEL, label="wheels")
    axes.annotate(
        "",
        (0.0, 0.55 * radius_m),
        (0.0, 0.0),
        arrowprops={"arrowstyle": "-|>", "color": _WHEEL, "lw": 1.6},
        zorder=5,
    )
    half_m = 0.5 * model.cleaning_width_m
    axes.plot(
        [half_m, -half_m],
        [model.mouth_offset_m] * 2,
        color=_MOUTH,
        lw=6.0,
        solid_capstyle="butt",
        label="mouth",
        zorder=4,
    )
    axes.plot(0.0, 0.0, "+", color=_WHEEL, ms=9, zorder=6)


def _draw_ranger(axes: Axes, name: str, mount: RangerMount, model: RobotModel) -> None:
    """Draw a sensor and its cone to the maximum range; the part below the minimum range is red."""
    far_m = min(mount.max_range_m, 2.0 * _VIEW * model.radius_m)
    _cone(axes, mount, mount.min_range_m, far_m, color=_CONE, alpha=0.16)
    _cone(axes, mount, 0.0, mount.min_range_m, color=_NEAR, alpha=0.35)
    axes.plot(mount.y_m, mount.x_m, "o", color=_CONE, ms=7, mec="white", zorder=7)
    at_m = min(0.5 * (model.radius_m + far_m), 1.75 * model.radius_m)
    reach_m = max(at_m - mount.centre_distance_m, 0.0)
    label_y = mount.y_m + reach_m * math.sin(mount.yaw_rad)
    label_x = mount.x_m + reach_m * math.cos(mount.yaw_rad)
    axes.annotate(
        f"{name}\n{mount.min_range_m:g} to {mount.max_range_m:g} m",
        (label_y, label_x),
        xytext=(0, 16 if abs(math.sin(mount.yaw_rad)) > math.cos(mount.yaw_rad) else 0),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        color=_CONE,
        zorder=8,
        bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 1.0},
    )


def _cone(axes: Axes, mount: RangerMount, near_m: float, far_m: float, **how: Any) -> None:  # noqa: ANN401 - matplotlib's
    """Draw a sensor's cone between two ranges; a beam is a line."""
    from matplotlib.patches import Wedge  # noqa: PLC0415 - an extra

    if mount.cone_rad > 0.0:
        # The picture's horizontal axis is the robot's y, to the left. So angles are relative to the
        # robot's x.
        middle_deg, half_deg = 90.0 - math.degrees(mount.yaw_rad), math.degrees(mount.cone_rad) / 2
        axes.add_patch(
            Wedge(
                (mount.y_m, mount.x_m),
                far_m,
                middle_deg - half_deg,
                middle_deg + half_deg,
                width=far_m - near_m,
                zorder=2,
                **how,
            )
        )
        return
    sine, cosine = math.sin(mount.yaw_rad), math.cos(mount.yaw_rad)
    axes.plot(
        [mount.y_m + near_m * sine, mount.y_m + far_m * sine],
        [mount.x_m + near_m * cosine, mount.x_m + far_m * cosine],
        color=how["color"],
        lw=2.0,
        alpha=0.6,
        zorder=2,
    )


def _draw_hull(axes: Axes, model: RobotModel) -> None:
    """Draw the rim. Its colour shows how the sensors measure an object in contact with it."""

    def rim(arc: Arc, colour: str, width: float, label: str) -> None:
        more_rad = 0.5 * max(_VISIBLE_RAD - arc.width_rad, 0.0)
        bearings = np.linspace(arc.begin_rad - more_rad, arc.end_rad + more_rad, _RIM_POINTS)
        left_m, ahead_m = model.radius_m * np.sin(bearings), model.radius_m * np.cos(bearings)
        how: dict[str, Any] = {
            "color": colour,
            "lw": width,
            "solid_capstyle": "butt",
            "label": label,
        }
        axes.plot(left_m, ahead_m, zorder=5, **how)

    view = hull_view(model)
    rim(Arc(0.0, 2.0 * math.pi), _RIM, 2.0, "hull: a touching object is not measured")
    for arcs, colour, label in (
        (view.measured, _SEEN, "hull: a touching object is measured"),
        (view.too_near, _NEAR, "hull: nearer than the sensor's minimum range"),
    ):
        for index, arc in enumerate(arcs):
            rim(arc, colour, 6.0, label if index == 0 else "_again")
    axes.plot([], [], color=_CONE, lw=6.0, alpha=0.3, label="range sensor: its cone or beam")
    axes.plot([], [], color=_NEAR, lw=6.0, alpha=0.5, label="nearer than its minimum range")

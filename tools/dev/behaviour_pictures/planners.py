"""Pictures of the planners ``recovery`` and ``paper``."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.registry import make_planner
from bridge.motion.legs import Drive
from bridge.view.report.drawing import tidy
from tools.cli.rooms import load_room
from tools.dev.behaviour_pictures.drawing import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    draw_map,
    draw_path,
    draw_robot,
    draw_room,
    draw_speed,
    draw_swept,
    map_legend,
    put_legend,
    put_note,
    put_title,
    side_by_side,
    true_at,
    unique_handles,
    xy,
)
from tools.dev.behaviour_pictures.runs import (
    MODEL,
    PicturedRun,
    recovery_run,
    simulate,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _draw_span(axes: Axes, run: PicturedRun, begin_s: float, end_s: float) -> None:
    """Draw the path of a time span, and the floor swept and the robot at its end."""
    samples = run.between(begin_s, end_s)
    draw_room(axes, run.plan)
    draw_swept(axes, run, end_s)
    draw_path(axes, samples)
    draw_robot(axes, samples[-1].obs.pose)
    put_legend(axes, 3, bbox_to_anchor=(0.5, -0.13))


def recovery_phases() -> Figure:
    """Draw the perimeter passes, and the lanes that follow."""
    run = recovery_run("case-2")
    first_end_s = run.first("perimeter-end")[0]
    end_s = run.first("finish")[0]
    figure, panels = side_by_side(8.2, 4.3, 2)
    for axes, (begin, end) in zip(panels, ((0.0, first_end_s), (first_end_s, end_s)), strict=True):
        _draw_span(axes, run, begin, end)
    put_title(panels[0], f"until {first_end_s:.0f} s: the perimeter of the walls")
    put_title(panels[1], f"until {end_s:.0f} s: lanes, and the perimeter of the box")
    return figure


def recovery_occluded() -> Figure:
    """Draw a lane that an obstacle ended early, and the return to the occluded region."""
    from matplotlib.patches import Polygon

    run = recovery_run("case-2")
    found_s, found = run.first("occlusion")
    lane_s = max(t for t, e in run.events if e.kind == "lane" and t < found_s)
    cut_s = max(t for t, e in run.events if e.kind == "lane-end" and t < found_s)
    back_s, _ = run.first("recovery-begin", found_s)
    end_s, _ = run.first("recovery-end", back_s)
    figure, panels = side_by_side(8.2, 4.3, 2)
    x, y, length = (float(found.data[key]) for key in ("x_m", "y_m", "length_m"))
    lane = next(
        s.leg
        for s in run.between(lane_s, cut_s)
        if isinstance(s.leg, Drive) and s.leg.purpose == "lane"
    )
    c, s = math.cos(lane.heading_rad), math.sin(lane.heading_rad)
    half = 0.5 * MODEL.cleaning_width_m
    strip = [
        (x + u * c - w * s, y + u * s + w * c)
        for u, w in ((0, -half), (length, -half), (length, half), (0, half))
    ]
    for axes, (begin, end) in zip(panels, ((lane_s, cut_s), (back_s, end_s)), strict=True):
        axes.add_patch(
            Polygon(
                strip,
                closed=True,
                fill=False,
                hatch="////",
                ec=ORANGE,
                lw=1.2,
                label="occluded region",
                zorder=4,
            )
        )
        _draw_span(axes, run, begin, end)
    put_title(panels[0], f"{cut_s:.0f} s: the box ends the lane early")
    put_title(panels[1], f"{end_s:.0f} s: the recovery lane has swept it")
    return figure


def recovery_bump() -> Figure:
    """Draw the evidence that a closed bumper switch adds to the map."""
    from matplotlib.patches import Arc, Patch

    run = recovery_run("columns")
    hit = next(s for s in run.samples if s.obs.bumper_left != s.obs.bumper_right)
    figure, panels = side_by_side(8.2, 4.6, 2)
    before = min(run.maps, key=lambda view: abs(view.t_s - hit.t_s))
    after = min((view for view in run.maps if view.t_s > before.t_s), key=lambda view: view.t_s)
    pose = hit.obs.pose
    for axes, view, title in (
        (panels[0], before, "before the contact"),
        (panels[1], after, "after the contact"),
    ):
        draw_room(axes, run.plan)
        draw_map(axes, view)
        draw_robot(axes, pose)
        if axes is panels[1]:
            low = math.degrees(pose.theta_rad) + (-10.0 if hit.obs.bumper_left else -87.0)
            size = 2.0 * MODEL.radius_m + 0.015
            how: dict[str, Any] = {"color": VIOLET, "lw": 3.5, "zorder": 8}
            axes.add_patch(Arc(pose[:2], size, size, theta1=low, theta2=low + 97.0, **how))
        axes.set_xlim(pose.x_m - 0.36, pose.x_m + 0.36)
        axes.set_ylim(pose.y_m - 0.36, pose.y_m + 0.36)
        put_title(axes, title)
    handles = [*map_legend(), Patch(color=VIOLET, label="closed bumper switch")]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def recovery_heading() -> Figure:
    """Draw a heading fix along a known wall."""
    run = recovery_run("two-rooms", "harsh", 1)
    along_s = next(sample.t_s for sample in run.samples if sample.state == "heading-fix")
    fixes = [(t, e) for t, e in run.events if e.kind == "heading-fix" and t <= along_s]
    begin_s, _ = fixes[-1]
    samples = run.between(begin_s, begin_s + 25.0)
    last = max(k for k, sample in enumerate(samples) if sample.state == "heading-fix")
    samples = samples[: last + 1]
    figure, (floor, sigma) = side_by_side(8.2, 3.6, 2, width_ratios=[1.1, 1.0])
    draw_room(floor, run.plan)
    floor.plot(
        *xy([s.obs.pose for s in samples]),
        color=GREY,
        lw=1.2,
        ls=(0, (3, 2)),
        label="transit",
        zorder=5,
    )
    draw_path(floor, samples, states=["heading-fix"])
    pose = samples[-1].obs.pose
    draw_robot(floor, pose)
    xs, ys = xy([s.obs.pose for s in samples])
    edge_m = MODEL.radius_m + 0.2
    floor.set_xlim(min(xs) - edge_m, max(xs) + edge_m)
    floor.set_ylim(min(ys) - edge_m, max(ys) + edge_m)
    side = 1.0 if samples[-1].obs.infrared_left_m is not None else -1.0
    beside_rad, distance_m = pose.theta_rad + side * math.pi / 2, MODEL.radius_m + 0.035
    wall_x_m = pose.x_m + distance_m * math.cos(beside_rad)
    wall_y_m = pose.y_m + distance_m * math.sin(beside_rad)
    put_note(floor, wall_x_m, wall_y_m, "wall followed before", (60, 60))
    put_legend(floor, 2)
    span = run.between(begin_s - 60.0, samples[-1].t_s + 30.0)
    sigma.plot(
        [s.t_s for s in span],
        [math.degrees(s.obs.heading_sigma_rad) for s in span],
        color=BLUE,
        lw=1.5,
        label="σ of the heading",
    )
    sigma.axhline(0.8, color=RED, ls="--", lw=1.0, label="limit 0.8°")
    sigma.axvspan(begin_s, samples[-1].t_s, color=VIOLET, alpha=0.15, lw=0, label="heading fix")
    sigma.set_xlabel("time (s)")
    sigma.set_ylabel("σ (°)")
    sigma.set_ylim(0.0, None)
    tidy(sigma)
    put_legend(sigma, 3)
    return figure


@cache
def _cliff_run() -> PicturedRun:
    room = load_room("empty", MODEL.radius_m)
    pit = ((1.2, 0.9), (1.9, 0.9), (1.9, 1.5), (1.2, 1.5))
    return simulate(replace(room, cliffs=(pit,)), RecoveryPlanner(MODEL), "typical", 1)


def recovery_cliff() -> Figure:
    """Draw a pit: lanes end at the pit, and the robot never follows its edge."""
    run = _cliff_run()
    end_s = run.first("finish")[0]
    figure, (floor, near) = side_by_side(8.2, 4.0, 2, width_ratios=[1.2, 1.0])
    draw_room(floor, run.plan)
    draw_swept(floor, run, end_s)
    drawn = ["perimeter", "lane", "recovery-lane"]
    draw_path(floor, run.between(0.0, end_s), states=drawn)
    put_title(floor, "the room empty with a pit of 0.7 m × 0.6 m")
    put_legend(floor, 3, bbox_to_anchor=(0.5, -0.13))
    t_s, _ = next((t, e) for t, e in run.events if e.kind == "obstacle" and "cliff" in e.text)
    samples = run.between(t_s - 6.0, t_s + 6.0)
    draw_room(near, run.plan)
    lines = draw_speed(near, samples)
    figure.colorbar(lines, ax=near, shrink=0.8).ax.set_title("m/s", fontsize=8)
    draw_robot(near, true_at(run, t_s))
    x, y = true_at(run, t_s)[:2]
    near.set_xlim(x - 0.6, x + 0.6)
    near.set_ylim(y - 0.6, y + 0.6)
    put_title(near, "cliff detected: stop, back off")
    return figure


def recovery_stuck() -> Figure:
    """Draw two contacts at one place, and the path along the obstacle."""
    run = recovery_run("comprehensive")
    shut_s, shut = run.first("passage-shut")
    end_s = run.first("perimeter-end", shut_s)[0]
    begin_s = shut_s - 14.0
    figure, panels = side_by_side(8.2, 5.0, 2)
    x, y = float(shut.data["x_m"]), float(shut.data["y_m"])
    spans = (
        (begin_s, shut_s, "two contacts at one place"),
        (shut_s, end_s, "then along the obstacle"),
    )
    for axes, (begin, end, title) in zip(panels, spans, strict=True):
        draw_room(axes, run.plan)
        draw_map(
            axes, max((view for view in run.maps if view.t_s <= end), key=lambda view: view.t_s)
        )
        draw_path(axes, run.between(begin, end))
        draw_robot(axes, run.between(begin, end)[-1].obs.pose, mouth=False)
        axes.set_xlim(x - 0.6, x + 0.6)
        axes.set_ylim(y - 0.5, y + 0.7)
        put_title(axes, f"{begin:.0f} to {end:.0f} s: {title}")
    for t_s, event in run.events:
        if begin_s <= t_s <= shut_s and event.kind == "obstacle" and "bumper" in event.text:
            panels[0].plot(
                event.data["x_m"], event.data["y_m"], "x", color="black", ms=8, mew=1.6, zorder=8
            )
    lines, _ = panels[0].get_legend_handles_labels()
    more, _ = panels[1].get_legend_handles_labels()
    figure.legend(
        handles=[*map_legend(), *unique_handles(lines, more)],
        loc="outside lower center",
        ncols=3,
        fontsize=8,
        frameon=False,
    )
    return figure


def paper_lanes() -> Figure:
    """Draw the lanes of the planner ``paper``, and its return to the region that a box occluded."""
    room = load_room("case-1", MODEL.radius_m)
    run = simulate(room, make_planner("paper", MODEL, random.Random(1)), "paper", 1)
    back_s = run.first("recovery-begin")[0]
    end_s = run.first("recovery-end", back_s)[0]
    figure, panels = side_by_side(8.2, 4.6, 2)
    for axes, (begin, end) in zip(panels, ((0.0, back_s), (back_s, end_s)), strict=True):
        _draw_span(axes, run, begin, end)
    put_title(panels[0], f"until {back_s:.0f} s: lanes, until one is longer again (case 3)")
    put_title(panels[1], f"until {end_s:.0f} s: back by Length, and the occluded region")
    return figure

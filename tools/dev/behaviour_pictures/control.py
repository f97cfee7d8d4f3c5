"""Pictures of drives, turns, wall following and speed limits."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.legs import Drive, GoTo, Turn
from bridge.view.report.drawing import tidy
from tools.cli.rooms import load_room
from tools.dev.behaviour_pictures.drawing import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    draw_robot,
    draw_room,
    draw_speed,
    put_legend,
    put_title,
    side_by_side,
    xy,
)
from tools.dev.behaviour_pictures.runs import (
    MODEL,
    PicturedRun,
    Sample,
    legs_run,
    recovery_run,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bridge.motion.legs import Leg


def _drive_span(run: PicturedRun, kind: type[Leg]) -> list[Sample]:
    return [sample for sample in run.samples if isinstance(sample.leg, kind)]


@cache
def _drive_run() -> PicturedRun:
    """Return a drive towards a wall that starts with a heading error of 60°."""
    room = load_room("empty", MODEL.radius_m)
    start = room.start._replace(x_m=0.6, y_m=1.0, theta_rad=math.radians(60.0))
    return legs_run([Drive(0.0, stop_range_m=0.048)], start=start)


def control_drive() -> Figure:
    """Draw the return to a lane after a heading error, and the stop before a wall."""
    run = _drive_run()
    samples = _drive_span(run, Drive)
    figure, (line, speeds) = side_by_side(8.2, 3.1, 2)
    line.axhline(0.0, color=GREY, lw=1.0, ls="--", label="heading line")
    line.plot(
        [s.obs.pose.x_m - samples[0].obs.pose.x_m for s in samples],
        [100.0 * (s.obs.pose.y_m - samples[0].obs.pose.y_m) for s in samples],
        color=BLUE,
        lw=1.8,
        label="path",
    )
    line.set_xlabel("distance along the line (m)")
    line.set_ylabel("distance off the line (cm)")
    put_title(line, "start with a heading error of 60°")
    tidy(line)
    put_legend(line, 2, bbox_to_anchor=(0.5, -0.22))
    begin_s = samples[0].t_s
    times = [sample.t_s - begin_s for sample in samples]
    speeds.plot(times, [s.target.v_m_s for s in samples], color=GREY, lw=1.0, label="target")
    speeds.plot(times, [s.command.v_m_s for s in samples], color=ORANGE, lw=1.4, label="command")
    speeds.plot(times, [s.obs.v_m_s for s in samples], color=BLUE, lw=1.0, label="measured")
    speeds.set_xlabel("time (s)")
    speeds.set_ylabel("speed (m/s)")
    put_title(speeds, "speed, and the stop before a wall")
    tidy(speeds)
    put_legend(speeds, 3, bbox_to_anchor=(0.5, -0.22))
    return figure


def control_turn() -> Figure:
    """Draw a turn that ends at rest, a flowing turn, and a drive to a point."""
    room = load_room("empty", MODEL.radius_m)
    start = room.start._replace(x_m=1.0, y_m=1.0, theta_rad=0.0)
    figure, (rates, floor) = side_by_side(8.2, 3.3, 2, width_ratios=[1.25, 1.0])
    for flowing, colour, name in ((False, BLUE, "to rest"), (True, ORANGE, "flowing")):
        run = legs_run(
            [Turn(math.radians(120.0), flowing=flowing), Drive(math.radians(120.0), 0.2)],
            start=start,
        )
        samples = [s for s in run.samples if s.leg is not None][:120]
        begin_s = samples[0].t_s
        turns = [s for s in samples if isinstance(s.leg, Turn)]
        times = [s.t_s - begin_s for s in turns]
        rates.plot(
            times,
            [s.target.yaw_rate_rad_s for s in turns],
            color=colour,
            lw=1.0,
            ls=":",
            label=f"{name}: target",
        )
        rates.plot(
            times,
            [s.obs.yaw_rate_rad_s for s in turns],
            color=colour,
            lw=1.5,
            label=f"{name}: measured",
        )
    rates.set_xlabel("time (s)")
    rates.set_ylabel("yaw rate (rad/s)")
    put_title(rates, "turn in place by 120°")
    tidy(rates)
    put_legend(rates, 2)
    goal = (2.2, 1.5)
    run = legs_run(
        [GoTo(*goal)], start=start._replace(x_m=0.8, y_m=0.6, theta_rad=math.radians(-35.0))
    )
    samples = _drive_span(run, GoTo)
    draw_room(floor, run.plan)
    floor.set_xlim(0.5, 2.6)
    floor.set_ylim(0.3, 1.8)
    floor.plot(*xy([s.obs.pose for s in samples]), color=BLUE, lw=1.8, label="path", zorder=5)
    floor.plot(*goal, "x", color=RED, ms=9, mew=2, ls="none", label="point", zorder=8)
    draw_robot(floor, samples[0].obs.pose)
    put_title(floor, "drive to a point, 68° off the heading")
    put_legend(floor, 2, bbox_to_anchor=(0.5, -0.2))
    return figure


def control_follow() -> Figure:
    """Draw wall following around the corners of a box."""
    run = recovery_run("case-1")
    begin_s = run.first("perimeter-begin", run.first("perimeter-end")[0])[0]
    end_s = run.first("perimeter-end", begin_s)[0]
    samples = run.between(begin_s, end_s)
    figure, (floor, gaps) = side_by_side(8.2, 3.5, 2, width_ratios=[1.1, 1.0])
    draw_room(floor, run.plan)
    lines = draw_speed(floor, samples)
    figure.colorbar(lines, ax=floor, shrink=0.8).ax.set_title("m/s", fontsize=8)
    draw_robot(floor, samples[0].obs.pose)
    xs, ys = xy([s.obs.pose for s in samples])
    edge_m = MODEL.radius_m + 0.03
    floor.set_xlim(min(xs) - edge_m, max(xs) + edge_m)
    floor.set_ylim(min(ys) - edge_m, max(ys) + edge_m)
    put_title(floor, "case-1: speed along the box")
    times = [s.t_s - begin_s for s in samples]
    hull = MODEL.radius_m - abs(MODEL.infrared_right.y_m)
    sides = [s.obs.infrared_left_m for s in samples], [s.obs.infrared_right_m for s in samples]
    ranges = max(sides, key=lambda side: sum(range_m is not None for range_m in side))
    gaps.plot(
        times,
        [math.nan if range_m is None else 100.0 * (range_m - hull) for range_m in ranges],
        color=ORANGE,
        lw=1.0,
        label="clearance to the wall by the infrared (cm)",
    )
    gaps.plot(
        times, [100.0 * s.obs.v_m_s for s in samples], color=BLUE, lw=1.2, label="speed (cm/s)"
    )
    gaps.set_xlabel("time (s)")
    gaps.set_ylabel("clearance (cm), speed (cm/s)")
    tidy(gaps)
    put_legend(gaps, 1)
    return figure


def control_limits() -> Figure:
    """Draw the speed limits for known obstacles and for obstacles that left the ultrasonic cone."""
    run = recovery_run("table-and-chair")
    begin_s, end_s = run.first("start")[0], run.first("finish")[0]
    figure, (floor, curve) = side_by_side(8.2, 3.6, 2, width_ratios=[1.25, 1.0])
    draw_room(floor, run.plan)
    samples = [
        s for s in run.between(begin_s, end_s) if s.state in {"lane", "transit", "recovery-lane"}
    ]
    begin = 0
    for k in range(1, len(samples) + 1):
        if k < len(samples) and samples[k].t_s - samples[k - 1].t_s < 0.1:  # noqa: PLR2004
            continue
        if k - begin > 1:
            lines = draw_speed(floor, samples[begin:k])
        begin = k
    figure.colorbar(lines, ax=floor, shrink=0.8).ax.set_title("m/s", fontsize=8)
    floor.set_xlim(0.8, 2.5)
    floor.set_ylim(0.1, 1.85)
    put_title(floor, "table-and-chair: lanes and transit between the legs")
    from bridge.motion.control.braking import Braking

    brake = Braking(0.75 * MODEL.max_accel_m_s2, 0.10)
    speeds = np.linspace(0.0, MODEL.max_speed_m_s, 60)
    limit_cm = [100.0 * brake.distance(v) for v in speeds]
    curve.plot(limit_cm, speeds, color=BLUE, lw=1.8, label="limit d = v·τ + v²/2a")
    stop = _drive_span(_drive_run(), Drive)
    end = stop[-1].obs.pose
    near = [s for s in stop if s.obs.pose.distance_m(end) < 0.18]  # noqa: PLR2004 - the plot's width
    curve.plot(
        [100.0 * s.obs.pose.distance_m(end) for s in near],
        [s.target.v_m_s for s in near],
        color=ORANGE,
        lw=1.4,
        label="target speed before a wall",
    )
    curve.set_xlabel("distance to standstill (cm)")
    curve.set_ylabel("speed (m/s)")
    put_title(curve, "braking distance")
    tidy(curve)
    put_legend(curve, 2)
    return figure

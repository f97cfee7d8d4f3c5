"""Pictures of the pose estimate."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.view.report.drawing import tidy
from protocol.messages.device import Encoders, Imu, Range
from protocol.messages.values import Contact
from tools.dev.behaviour_pictures.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    RED,
    VIOLET,
    draw_robot,
    draw_room,
    put_legend,
    put_title,
    side_by_side,
    true_path,
    xy,
)
from tools.dev.behaviour_pictures.runs import (
    MODEL,
    recovery_run,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bridge.motion.geometry import Pose2


class Estimates(NamedTuple):
    """Poses that two estimators compute from the messages of one run, at each encoder sample."""

    t_s: list[float]
    pose: list[Pose2]
    sigma_m: list[float]
    bias_sigma_rad_s: list[float]
    still: list[bool]
    pose_without_walls: list[Pose2]
    """Poses of an estimator that detects no walls."""
    relocaliser: Relocaliser


@cache
def _estimates(room: str, noise: str, seed: int) -> Estimates:
    """Feed a run's messages to an estimator with walls and to one without."""
    run = recovery_run(room, noise, seed)
    filters = PoseEstimator(MODEL, run.plan.start), PoseEstimator(MODEL, run.plan.start)
    walls = Relocaliser(MODEL, filters[0])
    out = Estimates([], [], [], [], [], [], walls)
    for record in run.messages:
        message, t_s = record.message, record.t_us * 1e-6
        if isinstance(message, Imu):
            for each in filters:
                each.on_imu(
                    t_s,
                    message.gyro_z_rad_s,
                    message.accel_x_m_s2,
                    message.accel_y_m_s2,
                    message.temperature_deg_c,
                )
        elif isinstance(message, Encoders):
            for each in filters:
                each.on_encoders(t_s, message.left, message.right)
            one, blind = filters
            (xx, _, _), (_, yy, _), _ = one.covariance
            out.t_s.append(t_s)
            out.pose.append(one.pose)
            out.sigma_m.append(math.sqrt(xx + yy))
            out.bias_sigma_rad_s.append(one.gyro_bias_sigma_rad_s)
            out.still.append(one.at_rest)
            out.pose_without_walls.append(blind.pose)
        elif isinstance(message, Range):
            walls.update(
                message.ultrasonic_m,
                message.infrared_left_m,
                message.infrared_right_m,
                bumper_left=bool(message.contacts & Contact.BUMPER_LEFT),
                bumper_right=bool(message.contacts & Contact.BUMPER_RIGHT),
                t_s=t_s,
                ultrasonic_age_s=message.ultrasonic_age_s,
            )
    return out


def estimation_path() -> Figure:
    """Draw path and position error with and without wall measurements."""
    run, est = recovery_run("two-rooms", "harsh", 1), _estimates("two-rooms", "harsh", 1)
    figure, (floor, errors) = side_by_side(8.2, 3.5, 2, width_ratios=[1.25, 1.0])
    draw_room(floor, run.plan)
    begin_s = run.first("start")[0]
    end_s = run.first("finish")[0]
    part = slice(0, sum(t_s <= end_s for t_s in est.t_s), 10)
    late_s = end_s - 120.0
    late = [k for k in range(0, len(est.t_s), 5) if late_s <= est.t_s[k] <= end_s]
    for poses, colour, name, width in (
        (est.pose_without_walls, RED, "wheels and gyro only", 1.2),
        (est.pose, ORANGE, "with walls", 2.4),
    ):
        floor.plot(*xy([poses[k] for k in late]), color=colour, lw=width, label=name, zorder=4)
    floor.plot(*xy(true_path(run, late_s, end_s)), color=BLUE, lw=1.0, label="true path", zorder=5)
    xs, ys = xy([*true_path(run, late_s, end_s), *(est.pose_without_walls[k] for k in late)])
    floor.set_xlim(min(xs) - 0.3, max(xs) + 0.3)
    floor.set_ylim(min(ys) - 0.3, max(ys) + 0.3)
    put_title(floor, f"two-rooms, noise harsh: {late_s:.0f} to {end_s:.0f} s")
    put_legend(floor, 2, bbox_to_anchor=(0.5, -0.17))
    times = np.array(est.t_s[part])
    truth_t = np.array([t_s for t_s, _ in run.truth])
    true_x, true_y = (np.array(values) for values in xy([pose for _, pose in run.truth]))
    for poses, colour, name in (
        (est.pose_without_walls[part], RED, "wheels and gyro only"),
        (est.pose[part], ORANGE, "with walls"),
    ):
        at_x, at_y = (np.array(values) for values in xy(poses))
        off = np.hypot(
            at_x - np.interp(times, truth_t, true_x), at_y - np.interp(times, truth_t, true_y)
        )
        errors.plot(times, 100.0 * off, color=colour, lw=1.2, label=name, zorder=3)
    band = 200.0 * np.array(est.sigma_m[part])
    errors.fill_between(times, 0.0, band, color=ORANGE, alpha=0.2, label="2σ of the filter", lw=0)
    errors.set_xlabel("time (s)")
    errors.set_ylabel("position error (cm)")
    errors.set_ylim(0.0, None)
    errors.set_xlim(begin_s, end_s)
    tidy(errors)
    put_legend(errors, 1, loc="upper left", bbox_to_anchor=(0.02, 1.0))
    return figure


def estimation_walls() -> Figure:
    """Draw the infrared hits and the walls in the state of the filter."""
    run, est = recovery_run("case-2", "typical", 1), _estimates("case-2", "typical", 1)
    figure, (floor, near) = side_by_side(8.2, 4.0, 2)
    hits: list[tuple[float, float]] = []
    for sample in run.samples[::3]:
        for mount, range_m in (
            (MODEL.infrared_left, sample.obs.infrared_left_m),
            (MODEL.infrared_right, sample.obs.infrared_right_m),
        ):
            if range_m is not None and abs(sample.obs.yaw_rate_rad_s) < 0.3:  # noqa: PLR2004
                hits.append(
                    sample.obs.pose.transform(
                        mount.x_m, mount.y_m + math.copysign(range_m, mount.y_m)
                    )
                )
    for axes in (floor, near):
        draw_room(axes, run.plan)
        axes.plot(
            *zip(*hits, strict=True), ".", ms=1.6, color=ORANGE, label="infrared hit", zorder=5
        )
        shown = False
        for i, wall in enumerate(est.relocaliser.walls.walls):
            if wall.seen_m <= 0.0:
                continue
            alpha, rho = est.relocaliser.walls.normal_rad(i), est.relocaliser.walls.offset_m(i)
            c, s = math.cos(alpha), math.sin(alpha)
            ends = [
                (wall.anchor_x_m + rho * c - u * s, wall.anchor_y_m + rho * s + u * c)
                for u in (wall.low_m, wall.high_m)
            ]
            name = None if shown else "wall in the filter's state"
            shown = True
            axes.plot(
                *zip(*ends, strict=True), color=VIOLET, lw=3.0, alpha=0.8, label=name, zorder=6
            )
    put_title(floor, "case-2, noise typical, seed 1: after the run")
    put_legend(floor, 2)
    near.set_xlim(1.3, 2.1)
    near.set_ylim(0.35, 1.15)
    pose = next(
        s.obs.pose
        for s in run.samples
        if s.obs.pose.y_m > 0.7 and 1.4 < s.obs.pose.x_m < 1.6  # noqa: PLR2004 - beside the box
    )
    draw_robot(near, pose)
    for mount in (MODEL.infrared_left, MODEL.infrared_right):
        begin = pose.transform(mount.x_m, mount.y_m)
        end = pose.transform(mount.x_m, math.copysign(0.3, mount.y_m))
        near.plot(*zip(begin, end, strict=True), color=RED, lw=0.9, ls=":", zorder=7)
    put_title(near, "beside the box; dotted: infrared beams")
    return figure


def estimation_bias() -> Figure:
    """Draw the standard deviation of the gyro bias, which is measured at standstill."""
    est = _estimates("two-rooms", "harsh", 1)
    figure, (axes,) = side_by_side(7.2, 2.9, 1)
    end_s = 420.0
    part = slice(0, sum(t_s <= end_s for t_s in est.t_s))
    times = np.array(est.t_s[part])
    sigma = np.degrees(est.bias_sigma_rad_s[part])
    axes.plot(times, sigma, color=BLUE, lw=1.4, label="σ of the bias")
    axes.axhline(0.012, color=RED, lw=1.0, ls="--", label="standstill is due (0.012 °/s)")
    axes.axhline(0.005, color=GREEN, lw=1.0, ls="--", label="standstill ends (0.005 °/s)")
    still = np.array(est.still[part])
    axes.fill_between(
        times, 0.0, 1.0, where=still.tolist(), color=ORANGE, alpha=0.5, lw=0, label="standstill"
    )
    axes.set_ylim(0.0, 0.016)
    axes.set_xlim(0.0, end_s)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("σ (°/s)")
    tidy(axes)
    put_legend(axes, 4, bbox_to_anchor=(0.5, -0.22))
    return figure

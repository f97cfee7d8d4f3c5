"""Pictures of the robot's behaviour for docs/, each drawn from a simulated run.

    .venv/bin/python -m tools.dev.behaviour_pictures --out docs/images

Every run is in virtual time, in a room of sweepctl, with a fixed seed. So equal code draws equal
pictures. ``--only NAME`` draws only one picture. The program needs the extra ``plot``.
"""

from __future__ import annotations

import argparse
import itertools
import math
import random
import sys
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bridge.coverage.planner import ScriptedPlanner
from bridge.coverage.recovery.evidence_kernels import SURE
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.estimation.relocalise import Relocaliser
from bridge.motion.legs import Drive, GoTo, Turn
from bridge.motion.robot_model import RobotModel
from bridge.session.records import DeviceMessage, EventRecord, TruthRecord
from bridge.view.report.drawing import as_png, blank, floor_axes, tidy
from bridge.view.report.picture import draw_plan
from protocol.messages.device import Encoders, Imu, Range
from protocol.messages.values import Contact
from tools.cli.console import write_line
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from bridge.coverage.planner import Planner, Script
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.legs import Leg
    from bridge.motion.observation import Observation, VelocityCommand
    from bridge.session.records import Record

MODEL = RobotModel()
_DPI = 90
_SHORT_M = 0.05
"""Minimum length of a drawn piece of the path, m."""
_MARGIN_M = 0.06
"""Margin around a drawn room, m."""
_TOP_M_S = 0.3
"""Upper end of the speed's colour scale, m/s."""
_GREY, _BLUE, _GREEN, _ORANGE, _RED = "#8a919c", "#1f4e79", "#2a8c63", "#d9822b", "#b03a48"
_VIOLET, _SWEPT, _FORBIDDEN = "#7a4ea3", "#d9efe5", "#f3c9a0"
_ROBOT: dict[str, Any] = {"fill": False, "ec": "#30343b", "lw": 1.2, "zorder": 7}
_STATES = {
    "approach": ("transit", _GREY),
    "transit": ("transit", _GREY),
    "recovery-transit": ("transit", _GREY),
    "step": ("transit", _GREY),
    "recovery-back": ("transit", _GREY),
    "recovery-step": ("transit", _GREY),
    "recovery-return": ("transit", _GREY),
    "perimeter": ("perimeter pass", _BLUE),
    "lane": ("lane", _GREEN),
    "recovery-lane": ("recovery lane", _ORANGE),
    "heading-fix": ("heading fix", _VIOLET),
}
"""Legend text and colour of the planner's states."""
_STANDING = frozenset({"idle", "think", "finished"})
"""States in which the robot stands still."""


class Sample(NamedTuple):
    """One control step."""

    t_s: float
    obs: Observation
    command: VelocityCommand
    target: VelocityCommand
    leg: Leg | None
    state: str


@dataclass(slots=True)
class PicturedRun:
    """A simulated run with the data that pictures need; times in seconds since the robot booted."""

    plan: FloorPlan
    planner: Planner
    samples: list[Sample] = field(default_factory=list)
    truth: list[tuple[float, Pose2]] = field(default_factory=list)
    events: list[tuple[float, EventRecord]] = field(default_factory=list)
    messages: list[DeviceMessage] = field(default_factory=list)
    map_span_s: tuple[float, float] = (0.0, math.inf)
    maps: list[MapView] = field(default_factory=list)
    """Maps of ``recovery``: one at the beginning of each leg and each contact."""

    def write(self, record: Record) -> None:
        """Store the data to draw. With ``write`` and ``close``, this class is a sink of the run."""
        if isinstance(record, TruthRecord):
            self.truth.append((_since_boot(record.log_ns), record.pose))
        elif isinstance(record, EventRecord):
            self.events.append((_since_boot(record.log_ns), record))
        elif isinstance(record, DeviceMessage):
            self.messages.append(record)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Do nothing."""

    def see_map(self, t_s: float) -> None:
        """Store the planner's map, if it has one."""
        if not self.map_span_s[0] <= t_s <= self.map_span_s[1]:
            return
        if isinstance(self.planner, RecoveryPlanner):
            memory = self.planner.context.evidence_map
            (left, bottom), (rows, columns) = memory.to_metres(0, 0), memory.shape
            right, top = memory.to_metres(columns, rows)
            forbidden, _ = memory.places()
            occupied = memory.wall >= SURE
            view = MapView(t_s, forbidden.copy(), occupied, (left, right, bottom, top))
            self.maps.append(view)

    def between(self, begin_s: float, end_s: float) -> list[Sample]:
        """Return the control steps of a time span."""
        return [sample for sample in self.samples if begin_s <= sample.t_s <= end_s]

    def first(self, kind: str, after_s: float = 0.0) -> tuple[float, EventRecord]:
        """Return the first event of a kind."""
        return next((t, e) for t, e in self.events if e.kind == kind and t >= after_s)


class MapView(NamedTuple):
    """The planner's map at one time."""

    t_s: float
    forbidden: NDArray[np.uint8]
    """Nonzero: bumps or a cliff forbid the cell to the axle."""
    occupied: NDArray[np.bool_]
    extent: tuple[float, float, float, float]
    """Left, right, bottom, top, metres."""


class _Recorder(PlanRunner):
    """Runs a plan and stores every control step."""

    def __init__(self, run: PicturedRun) -> None:
        super().__init__(run.planner, MODEL)
        self._run = run

    def step(self, obs: Observation) -> VelocityCommand:
        """Execute a control step of the plan and store it."""
        command = super().step(obs)
        t_s = obs.time_s - HOST_BOOT_NS * 1e-9
        sample = Sample(t_s, obs, command, self.target, self.executor.leg, self.state.state)
        last = self._run.samples[-1] if self._run.samples else None
        if last is not None and (
            last.leg is not sample.leg or (_pressed(obs) and not _pressed(last.obs))
        ):
            self._run.see_map(t_s)
        self._run.samples.append(sample)
        return command


class _Legs(ScriptedPlanner):
    """Drives given legs."""

    def __init__(self, legs: Sequence[Leg]) -> None:
        super().__init__(MODEL)
        self._legs = legs

    def script(self, obs: Observation) -> Script:  # noqa: ARG002 - the legs do not depend on it
        yield from (leg for leg in self._legs)  # a generator, which can be sent results
        return "all legs driven"


def _pressed(obs: Observation) -> bool:
    return obs.bumper_left or obs.bumper_right


def _since_boot(log_ns: int) -> float:
    return (log_ns - EPOCH_NS) * 1e-9


def _simulate(plan: FloorPlan, planner: Planner, noise: str, seed: int) -> PicturedRun:
    run = PicturedRun(plan, planner)
    run_virtual(plan, MODEL, None, run, seed=seed, noise=noise, runner=_Recorder(run))
    return run


@cache
def recovery_run(room: str, noise: str = "typical", seed: int = 1) -> PicturedRun:
    """Return a complete run of ``recovery`` in a shipped room."""
    return _simulate(load_room(room, MODEL.radius_m), RecoveryPlanner(MODEL), noise, seed)


def legs_run(legs: Sequence[Leg], start: Pose2 | None = None) -> PicturedRun:
    """Return a run of these legs in the room ``empty``, from its start pose or another pose."""
    plan = load_room("empty", MODEL.radius_m)
    plan = plan if start is None else replace(plan, start=start)
    return _simulate(plan, _Legs(legs), "typical", 1)


# ---- drawing ------------------------------------------------------------------------------


def _xy(poses: Sequence[Pose2]) -> tuple[list[float], list[float]]:
    return [pose.x_m for pose in poses], [pose.y_m for pose in poses]


def _true(run: PicturedRun, begin_s: float, end_s: float) -> list[Pose2]:
    return [pose for t_s, pose in run.truth if begin_s <= t_s <= end_s]


def _true_at(run: PicturedRun, t_s: float) -> Pose2:
    return min(run.truth, key=lambda entry: abs(entry[0] - t_s))[1]


def _floor(axes: Axes, plan: FloorPlan) -> None:
    draw_plan(axes, plan, obstacles="#c9ced6")
    floor_axes(axes)
    x0, y0, x1, y1 = plan.bounds()
    axes.set_xlim(x0 - _MARGIN_M, x1 + _MARGIN_M)
    axes.set_ylim(y0 - _MARGIN_M, y1 + _MARGIN_M)


def _swept(axes: Axes, run: PicturedRun, end_s: float) -> None:
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


def _robot(axes: Axes, pose: Pose2, *, colour: str = "#30343b", mouth: bool = True) -> None:
    """Draw the footprint, the heading and the mouth."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle(pose[:2], MODEL.radius_m, **{**_ROBOT, "ec": colour}))
    bow = pose.transform(MODEL.radius_m, 0.0)
    axes.plot([pose.x_m, bow[0]], [pose.y_m, bow[1]], color=colour, lw=1.2, zorder=7)
    if mouth:
        half = 0.5 * MODEL.cleaning_width_m
        ends = pose.transform(0.0, half), pose.transform(0.0, -half)
        axes.plot(*zip(*ends, strict=True), color=colour, lw=3.0, zorder=7)


def _by_state(axes: Axes, samples: Sequence[Sample], *, states: Sequence[str] = ()) -> None:
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
            *_xy([sample.obs.pose for sample in part]),
            color=colour,
            lw=1.0 if thin else 1.8,
            ls=(0, (3, 2)) if thin else "-",
            label=None if name in shown else name,
            zorder=5,
        )
        shown.add(name)


def _mark(axes: Axes, x_m: float, y_m: float, text: str, to: tuple[float, float]) -> None:
    """Draw a note with an arrow; ``to`` is the offset of the text in points."""
    axes.annotate(
        text,
        (x_m, y_m),
        to,
        textcoords="offset points",
        fontsize=8,
        ha="center",
        va="center",
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": _GREY, "lw": 0.6},
        arrowprops={"arrowstyle": "-|>", "color": "#30343b", "lw": 0.8},
        zorder=9,
    )


def _legend(axes: Axes, columns: int = 3, **place: Any) -> None:  # noqa: ANN401 - matplotlib's
    how = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False, **place}
    axes.legend(ncols=columns, fontsize=8, **how)


def _panels(width: float, height: float, count: int, **ratios: Any) -> tuple[Figure, list[Axes]]:  # noqa: ANN401
    figure = blank(width, height)
    axes = figure.subplots(1, count, squeeze=False, **ratios)
    return figure, list(axes[0])


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=9, loc="left")


def _map(axes: Axes, view: MapView) -> None:
    """Draw occupied and forbidden cells."""
    from matplotlib.colors import ListedColormap

    layers = np.where(view.occupied, 2, np.where(view.forbidden > 0, 1, 0))
    axes.imshow(
        np.ma.masked_equal(layers, 0),
        origin="lower",
        extent=view.extent,
        cmap=ListedColormap([_FORBIDDEN, _RED]),
        vmin=1,
        vmax=2,
        interpolation="nearest",
        zorder=2,
    )


def _map_legend() -> list[Artist]:
    from matplotlib.patches import Patch

    return [
        Patch(color=_RED, label="occupied cell"),
        Patch(color=_FORBIDDEN, label="cell forbidden to the axle"),
        Patch(facecolor="#c9ced6", edgecolor="#30343b", label="true obstacle"),
    ]


# ---- estimation ---------------------------------------------------------------------------


class Estimates(NamedTuple):
    """Poses that two estimators compute from the messages of one run, at each encoder sample."""

    t_s: list[float]
    pose: list[Pose2]
    sigma_m: list[float]
    sigma_rad: list[float]
    bias: list[float]
    bias_sigma: list[float]
    still: list[bool]
    odometry: list[Pose2]
    """Poses of an estimator that detects no walls."""
    walls: Relocaliser


@cache
def _estimates(room: str, noise: str, seed: int) -> Estimates:
    """Feed a run's messages to an estimator with walls and to one without."""
    run = recovery_run(room, noise, seed)
    filters = PoseEstimator(MODEL, run.plan.start), PoseEstimator(MODEL, run.plan.start)
    walls = Relocaliser(MODEL, filters[0])
    out = Estimates([], [], [], [], [], [], [], [], walls)
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
            (xx, _, _), (_, yy, _), (_, _, tt) = one.covariance
            out.t_s.append(t_s)
            out.pose.append(one.pose)
            out.sigma_m.append(math.sqrt(xx + yy))
            out.sigma_rad.append(math.sqrt(tt))
            out.bias.append(one.gyro_bias_rad_s)
            out.bias_sigma.append(one.gyro_bias_sigma_rad_s)
            out.still.append(one.at_rest)
            out.odometry.append(blind.pose)
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
    figure, (floor, errors) = _panels(8.2, 3.5, 2, width_ratios=[1.25, 1.0])
    _floor(floor, run.plan)
    begin_s = run.first("start")[0]
    end_s = run.first("finish")[0]
    part = slice(0, sum(t_s <= end_s for t_s in est.t_s), 10)
    late_s = end_s - 120.0
    late = [k for k in range(0, len(est.t_s), 5) if late_s <= est.t_s[k] <= end_s]
    for poses, colour, name, width in (
        (est.odometry, _RED, "wheels and gyro only", 1.2),
        (est.pose, _ORANGE, "with walls", 2.4),
    ):
        floor.plot(*_xy([poses[k] for k in late]), color=colour, lw=width, label=name, zorder=4)
    floor.plot(*_xy(_true(run, late_s, end_s)), color=_BLUE, lw=1.0, label="true path", zorder=5)
    xs, ys = _xy([*_true(run, late_s, end_s), *(est.odometry[k] for k in late)])
    floor.set_xlim(min(xs) - 0.3, max(xs) + 0.3)
    floor.set_ylim(min(ys) - 0.3, max(ys) + 0.3)
    _title(floor, f"two-rooms, noise harsh: {late_s:.0f} to {end_s:.0f} s")
    _legend(floor, 2, bbox_to_anchor=(0.5, -0.17))
    times = np.array(est.t_s[part])
    truth_t = np.array([t_s for t_s, _ in run.truth])
    true_x, true_y = (np.array(values) for values in _xy([pose for _, pose in run.truth]))
    for poses, colour, name in (
        (est.odometry[part], _RED, "wheels and gyro only"),
        (est.pose[part], _ORANGE, "with walls"),
    ):
        at_x, at_y = (np.array(values) for values in _xy(poses))
        off = np.hypot(
            at_x - np.interp(times, truth_t, true_x), at_y - np.interp(times, truth_t, true_y)
        )
        errors.plot(times, 100.0 * off, color=colour, lw=1.2, label=name, zorder=3)
    band = 200.0 * np.array(est.sigma_m[part])
    errors.fill_between(times, 0.0, band, color=_ORANGE, alpha=0.2, label="2σ of the filter", lw=0)
    errors.set_xlabel("time (s)")
    errors.set_ylabel("position error (cm)")
    errors.set_ylim(0.0, None)
    errors.set_xlim(begin_s, end_s)
    tidy(errors)
    _legend(errors, 1, loc="upper left", bbox_to_anchor=(0.02, 1.0))
    return figure


def estimation_walls() -> Figure:
    """Draw the infrared hits and the walls in the state of the filter."""
    run, est = recovery_run("case-2", "typical", 1), _estimates("case-2", "typical", 1)
    figure, (floor, near) = _panels(8.2, 4.0, 2)
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
        _floor(axes, run.plan)
        axes.plot(
            *zip(*hits, strict=True), ".", ms=1.6, color=_ORANGE, label="infrared hit", zorder=5
        )
        shown = False
        for i, wall in enumerate(est.walls.walls.walls):
            if wall.seen_m <= 0.0:
                continue
            alpha, rho = est.walls.walls.normal_rad(i), est.walls.walls.offset_m(i)
            c, s = math.cos(alpha), math.sin(alpha)
            ends = [
                (wall.anchor_x_m + rho * c - u * s, wall.anchor_y_m + rho * s + u * c)
                for u in (wall.low_m, wall.high_m)
            ]
            name = None if shown else "wall in the filter's state"
            shown = True
            axes.plot(
                *zip(*ends, strict=True), color=_VIOLET, lw=3.0, alpha=0.8, label=name, zorder=6
            )
    _title(floor, "case-2, noise typical, seed 1: after the run")
    _legend(floor, 2)
    near.set_xlim(1.3, 2.1)
    near.set_ylim(0.35, 1.15)
    pose = next(
        s.obs.pose
        for s in run.samples
        if s.obs.pose.y_m > 0.7 and 1.4 < s.obs.pose.x_m < 1.6  # noqa: PLR2004 - beside the box
    )
    _robot(near, pose)
    for mount in (MODEL.infrared_left, MODEL.infrared_right):
        begin = pose.transform(mount.x_m, mount.y_m)
        end = pose.transform(mount.x_m, math.copysign(0.3, mount.y_m))
        near.plot(*zip(begin, end, strict=True), color=_RED, lw=0.9, ls=":", zorder=7)
    _title(near, "beside the box; dotted: infrared beams")
    return figure


def estimation_bias() -> Figure:
    """Draw the standard deviation of the gyro bias, which is measured at standstill."""
    est = _estimates("two-rooms", "harsh", 1)
    figure, (axes,) = _panels(7.2, 2.9, 1)
    end_s = 420.0
    part = slice(0, sum(t_s <= end_s for t_s in est.t_s))
    times = np.array(est.t_s[part])
    sigma = np.degrees(est.bias_sigma[part])
    axes.plot(times, sigma, color=_BLUE, lw=1.4, label="σ of the bias")
    axes.axhline(0.012, color=_RED, lw=1.0, ls="--", label="rest is due (0.012 °/s)")
    axes.axhline(0.005, color=_GREEN, lw=1.0, ls="--", label="rest ends (0.005 °/s)")
    still = np.array(est.still[part])
    axes.fill_between(
        times, 0.0, 1.0, where=still.tolist(), color=_ORANGE, alpha=0.5, lw=0, label="standstill"
    )
    axes.set_ylim(0.0, 0.016)
    axes.set_xlim(0.0, end_s)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("σ (°/s)")
    tidy(axes)
    _legend(axes, 4, bbox_to_anchor=(0.5, -0.22))
    return figure


# ---- control ------------------------------------------------------------------------------


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
    figure, (line, speeds) = _panels(8.2, 3.1, 2)
    line.axhline(0.0, color=_GREY, lw=1.0, ls="--", label="heading line")
    line.plot(
        [s.obs.pose.x_m - samples[0].obs.pose.x_m for s in samples],
        [100.0 * (s.obs.pose.y_m - samples[0].obs.pose.y_m) for s in samples],
        color=_BLUE,
        lw=1.8,
        label="path",
    )
    line.set_xlabel("distance along the line (m)")
    line.set_ylabel("distance off the line (cm)")
    _title(line, "start with a heading error of 60°")
    tidy(line)
    _legend(line, 2, bbox_to_anchor=(0.5, -0.22))
    begin_s = samples[0].t_s
    times = [sample.t_s - begin_s for sample in samples]
    speeds.plot(times, [s.target.v_m_s for s in samples], color=_GREY, lw=1.0, label="target")
    speeds.plot(times, [s.command.v_m_s for s in samples], color=_ORANGE, lw=1.4, label="command")
    speeds.plot(times, [s.obs.v_m_s for s in samples], color=_BLUE, lw=1.0, label="measured")
    speeds.set_xlabel("time (s)")
    speeds.set_ylabel("speed (m/s)")
    _title(speeds, "speed, and the stop before a wall")
    tidy(speeds)
    _legend(speeds, 3, bbox_to_anchor=(0.5, -0.22))
    return figure


def control_turn() -> Figure:
    """Draw a turn that ends at rest, a flowing turn, and a drive to a point."""
    room = load_room("empty", MODEL.radius_m)
    start = room.start._replace(x_m=1.0, y_m=1.0, theta_rad=0.0)
    figure, (rates, floor) = _panels(8.2, 3.3, 2, width_ratios=[1.25, 1.0])
    for flowing, colour, name in ((False, _BLUE, "to rest"), (True, _ORANGE, "flowing")):
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
    _title(rates, "turn in place by 120°")
    tidy(rates)
    _legend(rates, 2)
    goal = (2.2, 1.5)
    run = legs_run(
        [GoTo(*goal)], start=start._replace(x_m=0.8, y_m=0.6, theta_rad=math.radians(-35.0))
    )
    samples = _drive_span(run, GoTo)
    _floor(floor, run.plan)
    floor.set_xlim(0.5, 2.6)
    floor.set_ylim(0.3, 1.8)
    floor.plot(*_xy([s.obs.pose for s in samples]), color=_BLUE, lw=1.8, label="path", zorder=5)
    floor.plot(*goal, "x", color=_RED, ms=9, mew=2, ls="none", label="point", zorder=8)
    _robot(floor, samples[0].obs.pose)
    _title(floor, "drive to a point, 68° off the heading")
    _legend(floor, 2, bbox_to_anchor=(0.5, -0.2))
    return figure


def _coloured(axes: Axes, samples: Sequence[Sample]) -> Any:  # noqa: ANN401 - matplotlib's
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


def control_follow() -> Figure:
    """Draw wall following around the corners of a box."""
    run = recovery_run("case-1")
    begin_s = run.first("perimeter-begin", run.first("perimeter-end")[0])[0]
    end_s = run.first("perimeter-end", begin_s)[0]
    samples = run.between(begin_s, end_s)
    figure, (floor, gaps) = _panels(8.2, 3.5, 2, width_ratios=[1.1, 1.0])
    _floor(floor, run.plan)
    lines = _coloured(floor, samples)
    figure.colorbar(lines, ax=floor, shrink=0.8).ax.set_title("m/s", fontsize=8)
    _robot(floor, samples[0].obs.pose)
    floor.set_xlim(0.22, 1.75)
    floor.set_ylim(0.4, 1.56)
    _title(floor, "case-1: speed along the box")
    times = [s.t_s - begin_s for s in samples]
    hull = MODEL.radius_m - abs(MODEL.infrared_right.y_m)
    sides = [s.obs.infrared_left_m for s in samples], [s.obs.infrared_right_m for s in samples]
    ranges = max(sides, key=lambda side: sum(range_m is not None for range_m in side))
    gaps.plot(
        times,
        [math.nan if range_m is None else 100.0 * (range_m - hull) for range_m in ranges],
        color=_ORANGE,
        lw=1.0,
        label="clearance to the wall by the infrared (cm)",
    )
    gaps.plot(
        times, [100.0 * s.obs.v_m_s for s in samples], color=_BLUE, lw=1.2, label="speed (cm/s)"
    )
    gaps.set_xlabel("time (s)")
    gaps.set_ylabel("clearance (cm), speed (cm/s)")
    tidy(gaps)
    _legend(gaps, 1)
    return figure


def control_limits() -> Figure:
    """Draw the speed limits for known obstacles and for obstacles that left the ultrasonic cone."""
    run = recovery_run("table-and-chair")
    begin_s, end_s = run.first("start")[0], run.first("finish")[0]
    figure, (floor, curve) = _panels(8.2, 3.6, 2, width_ratios=[1.25, 1.0])
    _floor(floor, run.plan)
    samples = [
        s for s in run.between(begin_s, end_s) if s.state in {"lane", "transit", "recovery-lane"}
    ]
    begin = 0
    for k in range(1, len(samples) + 1):
        if k < len(samples) and samples[k].t_s - samples[k - 1].t_s < 0.1:  # noqa: PLR2004
            continue
        if k - begin > 1:
            lines = _coloured(floor, samples[begin:k])
        begin = k
    figure.colorbar(lines, ax=floor, shrink=0.8).ax.set_title("m/s", fontsize=8)
    floor.set_xlim(0.8, 2.5)
    floor.set_ylim(0.1, 1.85)
    _title(floor, "table-and-chair: lanes and transit between the legs")
    from bridge.motion.control.braking import Braking

    brake = Braking(0.75 * MODEL.max_accel_m_s2, 0.10)
    speeds = np.linspace(0.0, MODEL.max_speed_m_s, 60)
    limit_cm = [100.0 * brake.distance(v) for v in speeds]
    curve.plot(limit_cm, speeds, color=_BLUE, lw=1.8, label="limit d = v·τ + v²/2a")
    stop = _drive_span(_drive_run(), Drive)
    end = stop[-1].obs.pose
    near = [s for s in stop if s.obs.pose.distance_m(end) < 0.18]  # noqa: PLR2004 - the plot's width
    curve.plot(
        [100.0 * s.obs.pose.distance_m(end) for s in near],
        [s.target.v_m_s for s in near],
        color=_ORANGE,
        lw=1.4,
        label="target speed before a wall",
    )
    curve.set_xlabel("distance to standstill (cm)")
    curve.set_ylabel("speed (m/s)")
    _title(curve, "braking distance")
    tidy(curve)
    _legend(curve, 2)
    return figure


# ---- recovery -----------------------------------------------------------------------------


def recovery_phases() -> Figure:
    """Draw the perimeter passes, and the lanes that follow."""
    run = recovery_run("case-2")
    first_end_s = run.first("perimeter-end")[0]
    end_s = run.first("finish")[0]
    figure, panels = _panels(8.2, 4.3, 2)
    for axes, (begin, end) in zip(panels, ((0.0, first_end_s), (first_end_s, end_s)), strict=True):
        _floor(axes, run.plan)
        _swept(axes, run, end)
        _by_state(axes, run.between(begin, end))
        _robot(axes, run.between(begin, end)[-1].obs.pose)
        _legend(axes, 3, bbox_to_anchor=(0.5, -0.13))
    _title(panels[0], f"until {first_end_s:.0f} s: the perimeter of the walls")
    _title(panels[1], f"until {end_s:.0f} s: lanes, and the perimeter of the box")
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
    figure, panels = _panels(8.2, 4.3, 2)
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
        _floor(axes, run.plan)
        _swept(axes, run, end)
        axes.add_patch(
            Polygon(
                strip,
                closed=True,
                fill=False,
                hatch="////",
                ec=_ORANGE,
                lw=1.2,
                label="occluded region",
                zorder=4,
            )
        )
        _by_state(axes, run.between(begin, end))
        _robot(axes, run.between(begin, end)[-1].obs.pose)
        _legend(axes, 3, bbox_to_anchor=(0.5, -0.13))
    _title(panels[0], f"{cut_s:.0f} s: the box ends the lane early")
    _title(panels[1], f"{end_s:.0f} s: the recovery lane has swept it")
    return figure


def recovery_bump() -> Figure:
    """Draw the evidence that a closed bumper switch adds to the map."""
    from matplotlib.patches import Arc, Patch

    run = recovery_run("columns")
    hit = next(s for s in run.samples if s.obs.bumper_left != s.obs.bumper_right)
    figure, panels = _panels(8.2, 4.6, 2)
    before = min(run.maps, key=lambda view: abs(view.t_s - hit.t_s))
    after = min((view for view in run.maps if view.t_s > before.t_s), key=lambda view: view.t_s)
    pose = hit.obs.pose
    for axes, view, title in (
        (panels[0], before, "before the contact"),
        (panels[1], after, "after the contact"),
    ):
        _floor(axes, run.plan)
        _map(axes, view)
        _robot(axes, pose)
        if axes is panels[1]:
            low = math.degrees(pose.theta_rad) + (-10.0 if hit.obs.bumper_left else -87.0)
            size = 2.0 * MODEL.radius_m + 0.015
            how: dict[str, Any] = {"color": _VIOLET, "lw": 3.5, "zorder": 8}
            axes.add_patch(Arc(pose[:2], size, size, theta1=low, theta2=low + 97.0, **how))
        axes.set_xlim(pose.x_m - 0.36, pose.x_m + 0.36)
        axes.set_ylim(pose.y_m - 0.36, pose.y_m + 0.36)
        _title(axes, title)
    handles = [*_map_legend(), Patch(color=_VIOLET, label="closed bumper switch")]
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
    figure, (floor, sigma) = _panels(8.2, 3.6, 2, width_ratios=[1.1, 1.0])
    _floor(floor, run.plan)
    floor.plot(
        *_xy([s.obs.pose for s in samples]),
        color=_GREY,
        lw=1.2,
        ls=(0, (3, 2)),
        label="transit",
        zorder=5,
    )
    _by_state(floor, samples, states=["heading-fix"])
    pose = samples[-1].obs.pose
    _robot(floor, pose)
    xs, ys = _xy([s.obs.pose for s in samples])
    edge_m = MODEL.radius_m + 0.2
    floor.set_xlim(min(xs) - edge_m, max(xs) + edge_m)
    floor.set_ylim(min(ys) - edge_m, max(ys) + edge_m)
    side = 1.0 if samples[-1].obs.infrared_left_m is not None else -1.0
    beside_rad, distance_m = pose.theta_rad + side * math.pi / 2, MODEL.radius_m + 0.035
    wall_x_m = pose.x_m + distance_m * math.cos(beside_rad)
    wall_y_m = pose.y_m + distance_m * math.sin(beside_rad)
    _mark(floor, wall_x_m, wall_y_m, "wall followed before", (60, 60))
    _legend(floor, 2)
    span = run.between(begin_s - 60.0, samples[-1].t_s + 30.0)
    sigma.plot(
        [s.t_s for s in span],
        [math.degrees(s.obs.heading_sigma_rad) for s in span],
        color=_BLUE,
        lw=1.5,
        label="σ of the heading",
    )
    sigma.axhline(0.8, color=_RED, ls="--", lw=1.0, label="limit 0.8°")
    sigma.axvspan(begin_s, samples[-1].t_s, color=_VIOLET, alpha=0.15, lw=0, label="heading fix")
    sigma.set_xlabel("time (s)")
    sigma.set_ylabel("σ (°)")
    sigma.set_ylim(0.0, None)
    tidy(sigma)
    _legend(sigma, 3)
    return figure


@cache
def _cliff_run() -> PicturedRun:
    room = load_room("empty", MODEL.radius_m)
    pit = ((1.2, 0.9), (1.9, 0.9), (1.9, 1.5), (1.2, 1.5))
    return _simulate(replace(room, cliffs=(pit,)), RecoveryPlanner(MODEL), "typical", 1)


def recovery_cliff() -> Figure:
    """Draw a pit: lanes end at the pit, and the robot never follows its edge."""
    run = _cliff_run()
    end_s = run.first("finish")[0]
    figure, (floor, near) = _panels(8.2, 4.0, 2, width_ratios=[1.2, 1.0])
    _floor(floor, run.plan)
    _swept(floor, run, end_s)
    drawn = ["perimeter", "lane", "recovery-lane"]
    _by_state(floor, run.between(0.0, end_s), states=drawn)
    _title(floor, "the room empty with a pit of 0.7 m × 0.6 m")
    _legend(floor, 3, bbox_to_anchor=(0.5, -0.13))
    t_s, _ = next((t, e) for t, e in run.events if e.kind == "obstacle" and "cliff" in e.text)
    samples = run.between(t_s - 6.0, t_s + 6.0)
    _floor(near, run.plan)
    lines = _coloured(near, samples)
    figure.colorbar(lines, ax=near, shrink=0.8).ax.set_title("m/s", fontsize=8)
    _robot(near, _true_at(run, t_s))
    x, y = _true_at(run, t_s)[:2]
    near.set_xlim(x - 0.6, x + 0.6)
    near.set_ylim(y - 0.6, y + 0.6)
    _title(near, "cliff detected: stop, back off")
    return figure


def recovery_stuck() -> Figure:
    """Draw two contacts at one place, and the path along the obstacle."""
    run = recovery_run("two-rooms")
    shut_s, shut = run.first("passage-shut")
    end_s = run.first("perimeter-end", shut_s)[0]
    begin_s = shut_s - 14.0
    figure, panels = _panels(8.2, 5.0, 2)
    x, y = float(shut.data["x_m"]), float(shut.data["y_m"])
    spans = (
        (begin_s, shut_s, "two contacts at one place"),
        (shut_s, end_s, "then along the obstacle"),
    )
    for axes, (begin, end, title) in zip(panels, spans, strict=True):
        _floor(axes, run.plan)
        _map(axes, max((view for view in run.maps if view.t_s <= end), key=lambda view: view.t_s))
        _by_state(axes, run.between(begin, end))
        _robot(axes, run.between(begin, end)[-1].obs.pose, mouth=False)
        axes.set_xlim(x - 0.6, x + 0.6)
        axes.set_ylim(y - 0.5, y + 0.7)
        _title(axes, f"{begin:.0f} to {end:.0f} s: {title}")
    for t_s, event in run.events:
        if begin_s <= t_s <= shut_s and event.kind == "obstacle" and "bumper" in event.text:
            panels[0].plot(
                event.data["x_m"], event.data["y_m"], "x", color="black", ms=8, mew=1.6, zorder=8
            )
    lines, _ = panels[0].get_legend_handles_labels()
    more, _ = panels[1].get_legend_handles_labels()
    figure.legend(
        handles=[*_map_legend(), *_named(lines, more)],
        loc="outside lower center",
        ncols=3,
        fontsize=8,
        frameon=False,
    )
    return figure


def paper_lanes() -> Figure:
    """Draw the lanes of the planner ``paper``, and its return to the region that a box occluded."""
    room = load_room("case-1", MODEL.radius_m)
    run = _simulate(room, make_planner("paper", MODEL, random.Random(1)), "paper", 1)
    back_s = run.first("recovery-begin")[0]
    end_s = run.first("recovery-end", back_s)[0]
    figure, panels = _panels(8.2, 4.6, 2)
    for axes, (begin, end) in zip(panels, ((0.0, back_s), (back_s, end_s)), strict=True):
        _floor(axes, run.plan)
        _swept(axes, run, end)
        _by_state(axes, run.between(begin, end))
        _robot(axes, run.between(begin, end)[-1].obs.pose)
        _legend(axes, 3, bbox_to_anchor=(0.5, -0.13))
    _title(panels[0], f"until {back_s:.0f} s: lanes, until one is longer again (case 3)")
    _title(panels[1], f"until {end_s:.0f} s: back by Length, and the occluded region")
    return figure


def _named(*groups: Sequence[Artist]) -> list[Artist]:
    """Return the legend handles of all panels, one handle for each name."""
    return list({str(artist.get_label()): artist for group in groups for artist in group}.values())


PICTURES: dict[str, Callable[[], Figure]] = {
    "estimation-path": estimation_path,
    "estimation-walls": estimation_walls,
    "estimation-bias": estimation_bias,
    "control-drive": control_drive,
    "control-turn": control_turn,
    "control-follow": control_follow,
    "control-limits": control_limits,
    "recovery-phases": recovery_phases,
    "recovery-occluded": recovery_occluded,
    "recovery-bump": recovery_bump,
    "recovery-heading": recovery_heading,
    "recovery-cliff": recovery_cliff,
    "recovery-stuck": recovery_stuck,
    "paper-lanes": paper_lanes,
}


def main() -> int:
    """Draw the pictures."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--out", type=Path, required=True, help="Folder for the PNG files.")
    options.add_argument("--only", choices=PICTURES, action="append", help="Draw only this one.")
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.only or PICTURES:
        path = given.out / f"{name}.png"
        path.write_bytes(as_png(PICTURES[name](), dpi=_DPI))
        write_line(f"{path}  {path.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The tables of the live picture: what the robot, its sensors, its planner and its wire tell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from protocol.catalogue import CATALOGUE
from protocol.values import Contact, Fault, Mode, PlannerPhase, StopCause, flag_labels, label

if TYPE_CHECKING:
    from bridge.host import Host

_RATE_NS = 1_000_000_000
_RATES_SHOWN = ("imu", "encoders", "range", "status", "power", "planner_state")


class Rates:
    """Messages a second of each type, from the link's own counts."""

    def __init__(self, host: Host) -> None:
        """Know none yet."""
        self._host = host
        self._at_ns = 0
        self._counts: dict[int, int] = {}
        self._bytes = (0, 0)
        self.hz: dict[str, float] = {}
        self.bytes_s = (0.0, 0.0)
        """In and out."""

    def look(self, now_ns: int) -> None:
        """Count anew where a second has passed."""
        since_s = (now_ns - self._at_ns) / 1e9
        if since_s * 1e9 < _RATE_NS:
            return
        statistics = self._host.session.link.statistics
        counts = dict(statistics.by_type)
        total = statistics.bytes_in, statistics.bytes_out
        if self._at_ns:
            self.hz = {
                CATALOGUE.by_type[t].name: (n - self._counts.get(t, 0)) / since_s
                for t, n in counts.items()
                if t in CATALOGUE.by_type
            }
            self.bytes_s = (
                (total[0] - self._bytes[0]) / since_s,
                (total[1] - self._bytes[1]) / since_s,
            )
        self._at_ns, self._counts, self._bytes = now_ns, counts, total


def _rows(rows: list[tuple[str, str | Text]]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    names = max((len(name) for name, _ in rows), default=0)
    table.add_column(style="dim", no_wrap=True, min_width=names)  # a value is cut before its name
    table.add_column(overflow="ellipsis", no_wrap=True)
    for name, value in rows:
        # A device's own words, too: no markup.
        table.add_row(name, Text(value) if isinstance(value, str) else value)
    return table


def state_table(host: Host) -> Table:
    """Session, run, mode, stop, faults, pose and battery."""
    state, mission, hello = host.state, host.mission, host.hello
    pose, status, power = host.estimator.pose, state.status, state.power
    rows: list[tuple[str, str | Text]] = [
        ("session", f"{host.session.state.value}, run {mission.phase.value}")
    ]
    if hello is not None:
        version = f"{hello.version_major}.{hello.version_minor}.{hello.version_patch}"
        rows.append(("device", f"{hello.name} {version}, node {host.session.node}"))
    if status is not None:
        cause = label(StopCause, status.stop_cause)
        stopped = status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}
        rows += [
            ("mode", label(Mode, status.mode)),
            ("stop", Text(cause, style="bold red" if stopped else "")),
        ]
        faults = ", ".join(flag_labels(Fault, status.faults))
        rows.append(("faults", Text(faults or "none", style="yellow" if faults else "")))
    degrees, rate = math.degrees(pose.theta_rad), math.degrees(host.estimator.yaw_rate_rad_s)
    rows += [
        ("pose", f"{pose.x_m:+.3f} m {pose.y_m:+.3f} m {degrees:+.0f}°"),
        ("speed", f"{host.estimator.v_m_s:+.2f} m/s {rate:+.0f}°/s"),
        ("path", f"{host.path_m:.1f} m"),
    ]
    if power is not None:
        rows.append(("battery", _battery(power.battery_v, host.model.battery_v)))
    return _rows(rows)


def status_line(host: Host) -> str:
    """What matters most in one line, for a reader without a picture."""
    state, mission, pose = host.state, host.mission, host.estimator.pose
    parts = [f"{host.session.state.value}, run {mission.phase.value}"]
    if state.status is not None:
        parts.append(f"mode {label(Mode, state.status.mode)}")
        if state.status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}:
            parts.append(f"stop {label(StopCause, state.status.stop_cause)}")
        faults = flag_labels(Fault, state.status.faults)
        parts += [f"faults {', '.join(faults)}"] if faults else []
    parts += [
        f"pose {pose.x_m:+.2f} m {pose.y_m:+.2f} m {math.degrees(pose.theta_rad):+.0f}°",
        f"{host.estimator.v_m_s:+.2f} m/s",
        f"path {host.path_m:.1f} m",
    ]
    if state.power is not None:
        parts.append(f"battery {state.power.battery_v:.2f} V")
    wire = host.session.link.statistics
    parts.append(f"{wire.lost} frames lost, {wire.damaged} damaged")
    return "; ".join(parts)


def compact_table(host: Host, rates: Rates) -> Table:
    """What matters most, for a small terminal."""
    state, mission, pose = host.state, host.mission, host.estimator.pose
    status, power, ranges = state.status, state.power, state.range
    rows: list[tuple[str, str | Text]] = [
        ("session", f"{host.session.state.value}, run {mission.phase.value}")
    ]
    if status is not None:
        cause = label(StopCause, status.stop_cause)
        faults = ", ".join(flag_labels(Fault, status.faults))
        stopped = status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}
        rows += [
            ("mode", f"{label(Mode, status.mode)}, load {status.load} %"),
            ("stop", Text(cause, style="bold red" if stopped else "")),
            ("faults", Text(faults or "none", style="yellow" if faults else "")),
        ]
    degrees = math.degrees(pose.theta_rad)
    rows += [
        ("pose", f"{pose.x_m:+.2f} m {pose.y_m:+.2f} m {degrees:+.0f}°"),
        ("speed", f"{host.estimator.v_m_s:+.2f} m/s, path {host.path_m:.1f} m"),
    ]
    if power is not None:
        rows.append(("battery", _battery(power.battery_v, host.model.battery_v)))
    if ranges is not None:
        seen = (ranges.ultrasonic_m, ranges.infrared_left_m, ranges.infrared_right_m)
        front, left, right = ("-" if r is None else f"{r:.2f}" for r in seen)
        touched = ", ".join(flag_labels(Contact, ranges.contacts))
        rows.append(("front", f"{front} m, left {left}, right {right} {touched}"))
    if state.imu is not None:
        rows.append(("gyro z", f"{math.degrees(state.imu.gyro_z_rad_s):+.2f} °/s"))
    if mission.runner is not None:
        rows.append(("planner", mission.runner.state.state))
    wire = host.session.link.statistics
    shown = " ".join(f"{n} {rates.hz[n]:.0f}" for n in _RATES_SHOWN[:3] if n in rates.hz)
    rows += [("Hz", shown or "-"), ("wire", f"{wire.lost} lost, {wire.damaged} damaged")]
    return _rows(rows)


def _battery(volts: float, nominal_v: float) -> Text:
    # Empty at three quarters of the nominal voltage, full at it: 12 V and 16 V of the paper's pack.
    share = (volts / nominal_v - 0.75) / 0.25
    style = "red" if share < 0.2 else "yellow" if share < 0.4 else "green"  # noqa: PLR2004 - fifths
    return Text.assemble(f"{volts:.2f} V ", (_bar(share, 10), style))


def _bar(share: float, width: int) -> str:
    full = round(max(0.0, min(1.0, share)) * width)
    return "█" * full + "░" * (width - full)


def sensor_table(host: Host) -> Table:
    """Ranges, contacts, inertial sensor, encoders and currents."""
    state, model = host.state, host.model
    ranges, imu, encoders, power = state.range, state.imu, state.encoders, state.power
    rows: list[tuple[str, str | Text]] = []
    if ranges is not None:
        for name, value, mount in (
            ("front", ranges.ultrasonic_m, model.ultrasonic),
            ("left", ranges.infrared_left_m, model.infrared_left),
            ("right", ranges.infrared_right_m, model.infrared_right),
        ):
            rows.append((name, _range(value, mount.max_range_m)))
        touched = flag_labels(Contact, ranges.contacts)
        rows.append(("contact", Text(", ".join(touched) or "none", "red" if touched else "")))
    if imu is not None:
        rate = math.degrees(imu.gyro_z_rad_s)
        rows += [
            ("gyro z", f"{rate:+7.2f} °/s"),
            (
                "accel",
                f"{imu.accel_x_m_s2:+.2f} {imu.accel_y_m_s2:+.2f} {imu.accel_z_m_s2:+.2f} m/s²",
            ),
        ]
    if encoders is not None:
        rows.append(("counts", f"{encoders.left} {encoders.right}"))
    if power is not None:
        rows += [
            ("motors", f"{power.motor_left_a:.2f} A {power.motor_right_a:.2f} A"),
            ("logic", f"{power.logic_v:.2f} V"),
        ]
    return _rows(rows or [("", "no data yet")])


def _range(value: float | None, most_m: float) -> Text:
    if value is None:
        return Text("nothing", style="dim")
    return Text.assemble(f"{value:.3f} m ", (_bar(value / most_m, 12), "cyan"))


def planner_table(host: Host) -> Table:
    """What drives, and the paper's variables."""
    runner, device = host.mission.runner, host.state.planner
    if runner is None and device is None:
        return _rows([("", "no plan")])
    rows: list[tuple[str, str | Text]] = []
    if runner is not None:
        state = runner.state
        rows += [
            ("state", Text(state.state, style="bold")),
            ("T", str(state.turn_count)),
            ("D, Prev-D", f"{state.lane_distance_m:.2f} m {state.previous_lane_distance_m:.2f} m"),
            ("Length", f"{state.length_m:.2f} m, case {state.case or '-'}"),
        ]
        if state.target is not None:
            rows.append(("target", f"{state.target[0]:+.2f} m {state.target[1]:+.2f} m"))
    elif device is not None:
        rows.append(("on board", label(PlannerPhase, device.phase)))
    return _rows(rows)


def wire_table(host: Host, rates: Rates) -> Table:
    """Rates, losses and the clock."""
    wire, sync = host.session.link.statistics, host.sync
    shown = [
        f"{name.removesuffix('_state')} {rates.hz[name]:.0f}"
        for name in _RATES_SHOWN
        if name in rates.hz
    ]
    lines = [", ".join(shown[:3]), ", ".join(shown[3:])]
    bad = wire.lost or wire.damaged
    rows: list[tuple[str, str | Text]] = [
        ("Hz", lines[0] or "-"),
        ("", lines[1]),
        ("frames", f"{wire.frames_in} in, {wire.frames_out} out"),
        ("lost", Text(f"{wire.lost}, {wire.damaged} damaged", style="yellow" if bad else "")),
        ("B/s", f"{rates.bytes_s[0]:.0f} in, {rates.bytes_s[1]:.0f} out"),
    ]
    if sync.round_trip_ns:
        rows.append(("trip", f"{sync.round_trip_ns / 1e6:.2f} ms"))
    if sync.fit is not None:
        rows.append(("clock", f"±{sync.fit.bound_ns / 1e6:.3f} ms"))
    return _rows(rows)

"""The tables of the dashboard: robot, sensors, planner and link."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from bridge.io import clock
from bridge.run.robot_state import PLUGGED
from bridge.session.monitor import texts
from bridge.session.states import State
from protocol.messages.device import Encoders, Imu, LinkCounters, Power, Range, Status
from protocol.messages.values import (
    Contact,
    Fault,
    Mode,
    PlannerPhase,
    StopCause,
    fault_labels,
    flag_labels,
    label,
)
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.planner import PlannerState as RunnerState
    from bridge.run.snapshot import Snapshot
    from protocol.schema.message import Message, MessageSpec

_RATE_NS = 1_000_000_000
"""Period at which rates are computed, ns."""
_AGED_S = 2.0
"""Age beyond which a value is dimmed, s: several periods of the slowest stream."""
_FROZEN_S = 0.5
"""Time without encoder counts after which no speed is shown, s: the time to live of a setpoint."""
_NO_LANE_VARIABLES = frozenset({"recovery", "u-shape", "random"})
"""Planners whose state lacks the variables of the paper's Table 1. The state of a plug-in's planner
may have them."""
_RATES_SHOWN = ("imu", "encoders", "range", "status", "power", "planner_state")
"""Messages whose rates are shown."""


class Rates:
    """Rate of each message, from the counts of the link."""

    def __init__(self, look: Callable[[], Snapshot]) -> None:
        """Begin without rates; ``look`` returns the present snapshot of the run."""
        self._look = look
        self._at_ns = 0
        self._counts: dict[int, int] = {}
        self._bytes = (0, 0)
        self.hz: dict[str, float] = {}
        """Rate by name of the message, Hz."""
        self.bytes_s = (0.0, 0.0)
        """Received and sent bytes a second."""

    def look(self, now_ns: int) -> None:
        """Compute the rates again if the counts are a second newer than those of the last rates."""
        statistics, counted_ns = self._look().session.link
        now_ns = now_ns if counted_ns is None else counted_ns
        since_s = (now_ns - self._at_ns) / 1e9
        if since_s * 1e9 < _RATE_NS:
            return
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


_Rows = list[tuple[str, str | Text]]


def _rows(rows: _Rows) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    names = max((len(name) for name, _ in rows), default=0)
    table.add_column(style="dim", no_wrap=True, min_width=names)  # long values are cut, not names
    table.add_column(overflow="ellipsis", no_wrap=True)
    for name, value in rows:
        # Some values come from the device: Text takes them without markup.
        table.add_row(name, Text(value) if isinstance(value, str) else value)
    return table


def _session(host: Snapshot, now_s: float) -> Text:
    """Return the state of session and run; after a loss, the time until the run ends."""
    state, mission = host.session.state, host.mission
    left_s = mission.holds_for_s(now_s)
    if left_s is None:
        return Text(f"{state.value}, run {mission.phase.value}")
    if mission.asking:
        return Text(f"{state.value}, run waits, ends in {left_s:.0f} s", "bold yellow")
    return Text(f"{state.value}, run ends in {left_s:.0f} s", "bold red")


def _speed(host: Snapshot, now_s: float) -> str | None:
    """Return speed and yaw rate; None without recent encoder counts.

    Without new counts, the estimate still contains the last speed.
    """
    at_s = host.state.arrived_s.get(Encoders)
    if host.session.state is not State.READY or at_s is None or now_s - at_s > _FROZEN_S:
        return None
    degrees_s = math.degrees(host.estimator.yaw_rate_rad_s)
    return f"{host.estimator.v_m_s:+.2f} m/s {degrees_s:+.0f}°/s"


def _aged(host: Snapshot, kind: type[Message], now_s: float) -> bool:
    """Return whether the newest message of a kind is older than ``_AGED_S``."""
    at_s = host.state.arrived_s.get(kind)
    return at_s is None or now_s - at_s > _AGED_S


def _shown(rows: list[tuple[str, str | Text | None]], *, dim: bool = False) -> _Rows:
    """Return rows with a dash for unknown values; with ``dim`` the values are dimmed."""
    found: _Rows = []
    for name, value in rows:
        text = Text("-") if value is None else Text(value) if isinstance(value, str) else value
        if dim or value is None:
            text.stylize("dim")
        found.append((name, text))
    return found


def _pose(host: Snapshot, digits: int) -> Text:
    """Return the estimated pose, dimmed while the device is lost."""
    pose = host.estimator.pose
    text = Text(
        f"{pose.x_m:+.{digits}f} m {pose.y_m:+.{digits}f} m {math.degrees(pose.theta_rad):+.0f}°"
    )
    if host.hello is not None and host.session.state is not State.READY:
        text.stylize("dim")
    return text


def _status_rows(host: Snapshot, now_s: float, *, load: bool = False) -> _Rows:
    """Return the rows of mode, stop and faults; with ``load`` the processor load too."""
    status = host.state.status
    if status is None:
        return _shown([("mode", None), ("stop", None), ("faults", None)])
    cause = label(StopCause, status.stop_cause)
    stopped = status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}
    faults = ", ".join(fault_labels(status.faults))
    mode = label(Mode, status.mode)
    mode += ", speed limited by the device" if status.faults & Fault.LIMITED else ""
    mode += ", drivers off" if status.faults & Fault.DRIVERS_OFF else ""
    mode += f", load {status.load} %" if load else ""
    return _shown(
        [
            ("mode", mode),
            ("stop", Text(cause, style="bold red" if stopped else "")),
            ("faults", Text(faults or "none", style="yellow" if faults else "")),
        ],
        dim=_aged(host, Status, now_s),
    )


def state_table(host: Snapshot, now_s: float) -> Table:
    """Return the table of session, run, mode, stop, faults, pose and battery."""
    hello, power = host.hello, host.state.power
    rows: _Rows = [("session", _session(host, now_s))]
    if hello is not None:
        version = f"{hello.version_major}.{hello.version_minor}.{hello.version_patch}"
        rows.append(("device", Text(f"{hello.name} {version}, node {host.session.node}")))
    rows += _status_rows(host, now_s)
    rows += _shown([("pose", _pose(host, 3)), ("speed", _speed(host, now_s))])
    rows += _shown([("path", f"{host.path_m:.1f} m")])
    battery = None if power is None else _battery(power.battery_v, host.model.battery_v)
    rows += _shown([("battery", battery)], dim=_aged(host, Power, now_s))
    return _rows(rows)


def status_line(host: Snapshot, now_s: float | None = None) -> str:
    """Return the state of the run as one line, for output without a dashboard."""
    now_s = clock.now() / 1e9 if now_s is None else now_s
    state, pose = host.state, host.estimator.pose
    parts = [_session(host, now_s).plain]
    if state.status is not None:
        parts.append(f"mode {label(Mode, state.status.mode)}")
        if state.status.stop_cause not in {StopCause.NONE, StopCause.SESSION_END}:
            parts.append(f"stop {label(StopCause, state.status.stop_cause)}")
        faults = fault_labels(state.status.faults)
        parts += [f"faults {', '.join(faults)}"] if faults else []
    parts += [
        f"pose {pose.x_m:+.2f} m {pose.y_m:+.2f} m {math.degrees(pose.theta_rad):+.0f}°",
        f"speed {_speed(host, now_s) or '-'}",
        f"path {host.path_m:.1f} m",
    ]
    if state.power is not None:
        parts.append(f"battery {state.power.battery_v:.2f} V")
    wire = host.session.link.statistics
    parts.append(f"{wire.lost} frames lost, {wire.damaged} damaged")
    return "; ".join(parts)


def compact_table(host: Snapshot, rates: Rates, now_s: float) -> Table:
    """Return the most important values as one table, for a small window."""
    state, mission = host.state, host.mission
    power, ranges, imu = state.power, state.range, state.imu
    rows: _Rows = [("session", _session(host, now_s))]
    rows += _status_rows(host, now_s, load=True)
    speed = _speed(host, now_s) or "-"
    rows += _shown([("pose", _pose(host, 2)), ("speed", f"{speed}, path {host.path_m:.1f} m")])
    battery = None if power is None else _battery(power.battery_v, host.model.battery_v)
    rows += _shown([("battery", battery)], dim=_aged(host, Power, now_s))
    front = None
    if ranges is not None:
        seen = (ranges.ultrasonic_m, ranges.infrared_left_m, ranges.infrared_right_m)
        ahead, left, right = ("-" if r is None else f"{r:.2f}" for r in seen)
        touched = ", ".join(flag_labels(Contact, ranges.contacts))
        front = f"{ahead} m, left {left}, right {right} {touched}"
    rows += _shown([("front", front)], dim=_aged(host, Range, now_s))
    rate = None if imu is None else f"{math.degrees(imu.gyro_z_rad_s):+.2f} °/s"
    rows += _shown([("gyro z", rate)], dim=_aged(host, Imu, now_s))
    if mission.runner is not None:
        rows += _shown([("planner", mission.runner.state.state)])
    for kind, message in state.plugged.items():
        spec = CATALOGUE.by_class[kind]
        values = ", ".join(f"{name} {text}" for name, text in _fields(spec, message))
        rows += _shown([(spec.name, values)], dim=_aged(host, kind, now_s))
    wire = host.session.link.statistics
    shown = " ".join(f"{n} {rates.hz[n]:.0f}" for n in _RATES_SHOWN[:3] if n in rates.hz)
    rows += _shown([("Hz", shown or "-"), ("link", f"{wire.lost} lost, {wire.damaged} damaged")])
    rows += _device_link(state.counters, troubles_only=True)
    return _rows(rows)


def _battery(volts: float, nominal_v: float) -> Text:
    # The battery is empty at 3/4 of the nominal voltage, and full at the nominal voltage: 12 V and
    # 16 V with the paper's battery.
    share = (volts / nominal_v - 0.75) / 0.25
    style = "red" if share < 0.2 else "yellow" if share < 0.4 else "green"  # noqa: PLR2004 - fifths
    return Text.assemble(f"{volts:.2f} V ", (_bar(share, 10), style))


def _bar(share: float, width: int) -> str:
    full = round(max(0.0, min(1.0, share)) * width)
    return "█" * full + "░" * (width - full)


def sensor_table(host: Snapshot, now_s: float) -> Table:
    """Return the table of ranges, contacts, inertial sensor, encoders and currents."""
    state, model = host.state, host.model
    ranges, imu, encoders, power = state.range, state.imu, state.encoders, state.power
    seen: tuple[Text | None, ...] = (None, None, None, None)
    if ranges is not None:
        touched = flag_labels(Contact, ranges.contacts)
        seen = (
            _range(ranges.ultrasonic_m, model.ultrasonic.max_range_m),
            _range(ranges.infrared_left_m, model.infrared_left.max_range_m),
            _range(ranges.infrared_right_m, model.infrared_right.max_range_m),
            Text(", ".join(touched) or "none", "red" if touched else ""),
        )
    names = ("front", "left", "right", "contact")
    rows = _shown(list(zip(names, seen, strict=True)), dim=_aged(host, Range, now_s))
    rate = accel = None
    if imu is not None:
        rate = f"{math.degrees(imu.gyro_z_rad_s):+7.2f} °/s"
        accel = f"{imu.accel_x_m_s2:+.2f} {imu.accel_y_m_s2:+.2f} {imu.accel_z_m_s2:+.2f} m/s²"
    rows += _shown([("gyro z", rate), ("accel", accel)], dim=_aged(host, Imu, now_s))
    counts = None if encoders is None else f"{encoders.left} {encoders.right}"
    rows += _shown([("counts", counts)], dim=_aged(host, Encoders, now_s))
    motors = logic = None
    if power is not None:
        motors = f"{power.motor_left_a:.2f} A {power.motor_right_a:.2f} A"
        logic = f"{power.logic_v:.2f} V"
    rows += _shown([("motors", motors), ("logic", logic)], dim=_aged(host, Power, now_s))
    return _rows(rows)


def _range(value: float | None, max_m: float) -> Text:
    if value is None:
        return Text("no echo", style="dim")
    return Text.assemble(f"{value:.3f} m ", (_bar(value / max_m, 12), "cyan"))


def planner_table(host: Snapshot, planner: str = "") -> Table:
    """Return the table of the planner; for the planner ``paper`` with the paper's variables."""
    runner, device = host.mission.runner, host.state.planner
    if runner is None and device is None:
        return _rows([("", "no planner")])
    rows: _Rows = [("planner", planner)] if planner else []
    if runner is not None:
        state = runner.state
        rows.append(("state", Text(state.state, style="bold")))
        if planner == "paper":
            rows += _lane_rows(state)
        else:
            rows += [("turns", str(runner.turns)), ("lanes", f"{runner.lane_length_m:.1f} m")]
            if planner not in _NO_LANE_VARIABLES and _sets_lane_variables(state):
                rows += _lane_rows(state)
        if state.target is not None:
            x_m, y_m = state.target
            away_m = math.dist(state.target, host.estimator.pose[:2])
            rows.append(("target", f"{x_m:+.2f} m {y_m:+.2f} m, {away_m:.2f} m away"))
    elif device is not None:
        rows.append(("on board", label(PlannerPhase, device.phase)))
    return _rows(rows)


def _lane_rows(state: RunnerState) -> _Rows:
    """Return the rows of the variables of the paper's Table 1."""
    lanes = f"{state.lane_distance_m:.2f} m {state.previous_lane_distance_m:.2f} m"
    return [
        ("T", str(state.turn_count)),
        ("D, Prev-D", lanes),
        ("Length", f"{state.length_m:.2f} m, case {state.case or '-'}"),
    ]


def _sets_lane_variables(state: RunnerState) -> bool:
    """Return whether a planner has set any of the variables of the paper's Table 1."""
    return bool(state.lane_distance_m or state.length_m or state.case)


def plugged_table(host: Snapshot, now_s: float) -> Table | None:
    """Return the table of the messages of plug-ins; None if no plug-in has a message."""
    rows: _Rows = []
    for kind in PLUGGED:
        spec, message = CATALOGUE.by_class[kind], host.state.plugged.get(kind)
        if message is None:
            rows += _shown([(spec.name, None)])
            continue
        dim = _aged(host, kind, now_s)
        rows.append((spec.name, ""))
        rows += _shown([(f"  {name}", text) for name, text in _fields(spec, message)], dim=dim)
    return _rows(rows) if rows else None


def _fields(spec: MessageSpec, message: Message) -> list[tuple[str, str]]:
    """Return the names of a message's fields, and their values with units."""
    units = {field.name: "%" for field in spec.fields if field.unit == "percent"}
    return [
        (name, f"{value} {units.get(name, unit)}".rstrip())
        for name, value, unit in texts(spec, message)
    ]


def _device_link(counters: LinkCounters | None, *, troubles_only: bool = False) -> _Rows:
    """Return the rows with the link counters of the device."""
    if counters is None:
        return [] if troubles_only else _shown([("device", None)])
    dropped = (counters.receive_dropped or 0) + (counters.send_dropped or 0)
    bad = counters.damaged or dropped
    text = f"{counters.damaged} damaged, {dropped} dropped"
    rows: _Rows = []
    if bad or not troubles_only:
        rows.append(("device", Text(text, style="yellow" if bad else "")))
    errors = max(counters.can_send_errors or 0, counters.can_receive_errors or 0)
    if errors or counters.can_bus_offs:
        bus = f"{errors} errors, {counters.can_bus_offs or 0} × off"
        rows.append(("CAN", Text(bus, style="yellow")))
    return rows


def link_table(host: Snapshot, rates: Rates) -> Table:
    """Return the table of rates, losses, round trip and clock."""
    wire, sync = host.session.link.statistics, host.sync
    shown = [
        f"{name.removesuffix('_state')} {rates.hz[name]:.0f}"
        for name in _RATES_SHOWN
        if name in rates.hz
    ]
    lines = [", ".join(shown[:3]), ", ".join(shown[3:])]
    bad = wire.lost or wire.damaged
    rows: _Rows = [
        ("Hz", lines[0] or "-"),
        ("", lines[1]),
        ("frames", f"{wire.frames_in} in, {wire.frames_out} out"),
        ("lost", Text(f"{wire.lost}, {wire.damaged} damaged", style="yellow" if bad else "")),
        ("B/s", f"{rates.bytes_s[0]:.0f} in, {rates.bytes_s[1]:.0f} out"),
    ]
    lost = host.session.state is not State.READY
    rows += _device_link(host.state.counters)
    if sync.round_trip_ns:
        rows += _shown([("trip", f"{sync.round_trip_ns / 1e6:.2f} ms")], dim=lost)
    if sync.fit is not None:
        rows += _shown([("clock", f"±{sync.fit.bound_ns / 1e6:.3f} ms")], dim=lost)
    return _rows(rows)

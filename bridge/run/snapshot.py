"""Immutable state of a robot, for other threads and processes.

The loop replaces its :class:`Snapshot` as a whole and never changes it. Other threads read the
newest snapshot instead of the host. Its attributes have the same names as the host's attributes.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

from bridge.session.link_stats import wire_summary
from bridge.session.monitor import physical
from bridge.supervise.inputs import newest_of
from protocol.messages.device import LinkCounters
from protocol.messages.values import Fault, Mode, ResetCause, StopCause, fault_labels, label
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.coverage.planner import PlannerState as RunnerState
    from bridge.coverage.swept_map import OccupancyArray
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.run.ending import Ending
    from bridge.run.mission import Phase
    from bridge.session.round_trip import LinkTrouble
    from bridge.session.states import State
    from bridge.session.timesync import Fit
    from protocol.link import LinkStatistics
    from protocol.messages.device import (
        Encoders,
        Hello,
        Imu,
        PlannerState,
        Power,
        Range,
        Status,
    )
    from protocol.schema.message import Message

M = TypeVar("M", bound="Message")


class StateSnapshot(NamedTuple):
    """Newest messages and the host times (s) of their samples."""

    imu: Imu | None
    encoders: Encoders | None
    range: Range | None
    power: Power | None
    status: Status | None
    planner: PlannerState | None
    """State of the device's own planner."""
    arrived_s: Mapping[type[Message], float]
    """Host time of each type's newest sample, s, from its device stamp; of a plug-in's message: its
    arrival."""
    plugged: Mapping[type[Message], Message] = MappingProxyType({})
    """Newest message of each class of a plug-in."""
    counters: LinkCounters | None = None
    """Numbers of frames that the device has received and dropped."""

    def newest(self, kind: type[M]) -> M | None:
        """Return the newest message of a plug-in's class; None if none has arrived."""
        return newest_of(self.plugged, kind)


class RunnerSnapshot(NamedTuple):
    """State of the runner."""

    state: RunnerState
    turns: int
    lane_length_m: float


class MissionSnapshot(NamedTuple):
    """State of the run."""

    phase: Phase
    ending: Ending | None
    runner: RunnerSnapshot | None
    asking: bool
    """True if the device has returned and the operator must decide whether the run continues."""
    link: LinkTrouble | None
    """Reason why the link allows no motion; None: motion is allowed."""
    ends_s: float | None
    """Host time at which a run with a lost device ends (s); None: the device is not lost."""

    def holds_for_s(self, now_s: float) -> float | None:
        """Seconds until a run with a lost device ends; None: the device is not lost."""
        return None if self.ends_s is None else max(0.0, self.ends_s - now_s)


class LinkSnapshot(NamedTuple):
    """The link's counts, at most 0.1 s old."""

    statistics: LinkStatistics
    counted_ns: int | None = None
    """Host time of the counts, ns; None: now."""


class SessionSnapshot(NamedTuple):
    """State of the session."""

    state: State
    node: int | None
    link: LinkSnapshot
    signs: bool
    """True if motion commands are signed: a key is set and its challenge has arrived."""


class EstimatorSnapshot(NamedTuple):
    """The pose estimate."""

    pose: Pose2
    v_m_s: float
    yaw_rate_rad_s: float


class SyncSnapshot(NamedTuple):
    """State of the time synchronisation."""

    round_trip_ns: int
    fit: Fit | None


class Swept(Protocol):
    """The swept floor, for drawing."""

    revision: int
    """Number that increases with every change."""

    @property
    def swept_m2(self) -> float:
        """Area of the covered cells, m²."""
        ...

    def to_occupancy(self) -> OccupancyArray:
        """Return a copy of the cells: 0 swept, -1 unknown."""
        ...


class Snapshot(NamedTuple):
    """State of a robot and its run at one time."""

    model: RobotModel
    state: StateSnapshot
    mission: MissionSnapshot
    session: SessionSnapshot
    estimator: EstimatorSnapshot
    sync: SyncSnapshot
    hello: Hello | None
    path_m: float
    holding: bool
    """True if supervision has paused the run. The operator must continue it."""
    swept: Swept
    """The loop's own map. Other threads may only copy it and read its area."""


def snapshot_to_dict(seen: Snapshot, now_s: float) -> dict[str, Any]:
    """Return session, device, run, sensors, pose and link for JSON; unknown values are None.

    ``now_s`` is host time; ages are in seconds since the sample was taken.
    """
    state, mission, sync = seen.state, seen.mission, seen.sync
    status, power, ranges, imu = state.status, state.power, state.range, state.imu
    pose, runner = seen.estimator.pose, mission.runner
    ages = {kind.__name__.lower(): round(now_s - at_s, 3) for kind, at_s in state.arrived_s.items()}
    return {
        "session": seen.session.state.value,
        "run": mission.phase.value,
        "device": None if seen.hello is None else _device(seen.hello, seen.session.node),
        "mode": None if status is None else label(Mode, status.mode),
        "stop": None if status is None else label(StopCause, status.stop_cause),
        "faults": None if status is None else fault_labels(status.faults),
        "limited": None if status is None else bool(status.faults & Fault.LIMITED),
        "drivers": None if status is None else not status.faults & Fault.DRIVERS_OFF,
        "load_percent": None if status is None else status.load,
        "pose": {"x_m": pose.x_m, "y_m": pose.y_m, "theta_rad": pose.theta_rad},
        "v_m_s": seen.estimator.v_m_s,
        "yaw_rate_rad_s": seen.estimator.yaw_rate_rad_s,
        "path_m": seen.path_m,
        "planner": None if runner is None else runner.state.state,
        "range": None
        if ranges is None
        else {
            "ultrasonic_m": ranges.ultrasonic_m,
            "infrared_left_m": ranges.infrared_left_m,
            "infrared_right_m": ranges.infrared_right_m,
            "contacts": ranges.contacts,
        },
        "imu": None
        if imu is None
        else {
            "accel_m_s2": [imu.accel_x_m_s2, imu.accel_y_m_s2, imu.accel_z_m_s2],
            "gyro_rad_s": [imu.gyro_x_rad_s, imu.gyro_y_rad_s, imu.gyro_z_rad_s],
        },
        "power": None
        if power is None
        else {
            "battery_v": power.battery_v,
            "logic_v": power.logic_v,
            "motor_left_a": power.motor_left_a,
            "motor_right_a": power.motor_right_a,
        },
        "plugins": {
            CATALOGUE.by_class[kind].name: physical(CATALOGUE.by_class[kind], message)
            for kind, message in state.plugged.items()
        },
        "age_s": ages,
        "clock": {
            "round_trip_ms": sync.round_trip_ns / 1e6,
            "bound_ms": None if sync.fit is None else sync.fit.bound_ns / 1e6,
        },
        "wire": wire_summary(seen.session.link.statistics),
        "device_link": None if state.counters is None else _counters(state.counters),
    }


def _counters(counters: LinkCounters) -> dict[str, int | None]:
    """Return the device's counters by name; a counter is None if an older device lacks it."""
    names = [field.name for field in CATALOGUE.spec(LinkCounters).fields]
    return dict(zip(names, counters, strict=True))


def _device(hello: Hello, node: int | None) -> dict[str, Any]:
    return {
        "node": node,
        "uid": hello.uid.hex(),
        "boot_id": hello.boot_id,
        "firmware": f"{hello.name} {hello.version_major}.{hello.version_minor}."
        f"{hello.version_patch}",
        "reset_cause": label(ResetCause, hello.reset_cause),
    }

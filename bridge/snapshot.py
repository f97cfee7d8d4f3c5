"""What is known of a robot now, as one JSON object: for a second viewer and for scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.summary import wire_summary
from protocol.values import Fault, Mode, ResetCause, StopCause, flag_labels, label

if TYPE_CHECKING:
    from bridge.host import Host
    from protocol.messages import Hello


def snapshot(host: Host, now_s: float) -> dict[str, Any]:
    """Session, device, run, sensors, pose and wire; None for what is not known.

    ``now_s`` is host time; ages are in seconds since the message arrived. May be called from
    any thread: it reads what the loop's thread replaces as a whole.
    """
    state, mission, sync = host.state, host.mission, host.sync
    status, power, ranges, imu = state.status, state.power, state.range, state.imu
    pose, runner = host.estimator.pose, mission.runner
    ages = {kind.__name__.lower(): round(now_s - at_s, 3) for kind, at_s in state.arrived_s.items()}
    return {
        "session": host.session.state.value,
        "run": mission.phase.value,
        "device": None if host.hello is None else _device(host.hello, host.session.node),
        "mode": None if status is None else label(Mode, status.mode),
        "stop": None if status is None else label(StopCause, status.stop_cause),
        "faults": None if status is None else flag_labels(Fault, status.faults),
        "load_percent": None if status is None else status.load,
        "pose": {"x_m": pose.x_m, "y_m": pose.y_m, "theta_rad": pose.theta_rad},
        "v_m_s": host.estimator.v_m_s,
        "yaw_rate_rad_s": host.estimator.yaw_rate_rad_s,
        "path_m": host.path_m,
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
        "age_s": ages,
        "clock": {
            "round_trip_ms": sync.round_trip_ns / 1e6,
            "bound_ms": None if sync.fit is None else sync.fit.bound_ns / 1e6,
        },
        "wire": wire_summary(host.session.link.statistics),
    }


def _device(hello: Hello, node: int | None) -> dict[str, Any]:
    return {
        "node": node,
        "uid": hello.uid.hex(),
        "boot_id": hello.boot_id,
        "firmware": f"{hello.name} {hello.version_major}.{hello.version_minor}."
        f"{hello.version_patch}",
        "reset_cause": label(ResetCause, hello.reset_cause),
    }

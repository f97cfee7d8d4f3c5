"""Conversion of a recorded run to a Rerun recording."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from bridge.record.names import readable_name
from bridge.record.reader import LATEST_NS, MISREAD, LogReader
from bridge.record.wheels import WheelAngles
from bridge.view.rerun import paths, planning, scene
from bridge.view.rerun.columns import Document, RerunRecording, Series, States, TextLines
from bridge.view.run_reading import LossCounter, PoseErrors, boot_id_of, plan_of, robot_of
from protocol.messages.values import Mode, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import rerun as rr

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from bridge.record.reader import LogMessage

_SECOND_NS = 1_000_000_000
_LONGEST_GAP_NS = 86_400 * _SECOND_NS
"""Maximum pause that is filled with one point per second, ns. It is a day."""
_LOG_LEVELS = {1: "debug", 2: "info", 3: "warning", 4: "error", 5: "error"}
"""Map of a level in ``foxglove.Log`` to the severity in Rerun."""


@dataclass(frozen=True, slots=True)
class Converted:
    """Result of a conversion."""

    reader: LogReader
    """The log's reader, which reports truncation and damage."""
    plan: FloorPlan | None
    duration_s: float


def to_rerun(path: Path, stream: rr.RecordingStream) -> Converted:
    """Convert a run's log into a Rerun recording.

    Raises:
        LogReadError: the file is missing, cannot be read, or is no MCAP file.

    """
    reader = LogReader(path)
    first = next(reader.messages(), None)
    recording = RerunRecording(stream, min(first.log_ns, LATEST_NS) if first is not None else 0)
    model = robot_of(reader)
    scene.draw_robot(recording, model)
    plan = plan_of(reader)
    if plan is not None:
        scene.draw_plan(recording, plan)
    run = RunConverter(model)
    last_ns = recording.start_ns
    for message in reader.messages(run.topics):
        run.take(message)
        last_ns = max(last_ns, min(message.log_ns, LATEST_NS))
    run.send(recording)
    stream.send_recording_name(readable_name(path.stem))
    return Converted(reader, plan, recording.seconds(last_ns))


class _Part(Protocol):
    def send(self, recording: RerunRecording) -> None: ...


class RunConverter:
    """Collects the messages of every topic that is shown, and sends them on request."""

    def __init__(self, model: RobotModel) -> None:
        self._wheel_radius_m = model.wheel_diameter_m / 2
        self._wheels = WheelAngles(2.0 * math.pi / model.counts_per_turn)
        p = paths
        self._velocity = Series(p.VELOCITY, estimated=p.BLUE)
        self._command = Series(p.VELOCITY, commanded=p.ORANGE)
        self._yaw_rate = Series(p.YAW_RATE, estimated=p.BLUE)
        self._yaw_command = Series(p.YAW_RATE, commanded=p.ORANGE)
        self._gyro = Series(p.YAW_RATE, gyro_z=p.GREY)
        self._wheel_speeds = Series(p.WHEELS, left=p.GREEN, right=p.RED)
        self._acceleration = Series(p.ACCELERATION, accel_x=p.RED, accel_y=p.GREEN)
        self._range = Series(p.RANGE, front=p.BLUE, left=p.GREEN, right=p.RED)
        self._battery = Series(p.BATTERY, battery_V=p.GREEN)
        self._current = Series(p.CURRENT, left_A=p.GREEN, right_A=p.RED)
        self._pose_error = Series(p.POSE_ERROR, position_mm=p.RED)
        self._clock = Series(p.CLOCK, bound_ms=p.ORANGE, round_trip_ms=p.GREY)
        self._link = _LinkHealth()
        self._states = {name: States(f"{p.STATES}/{name}") for name in ("planner", "mode", "stop")}
        self._lines = TextLines(p.EVENTS)
        self._path, self._truth_path = scene.path_track(), scene.truth_track()
        self._whole = scene.whole_track()
        self._motion, self._target = scene.Motion(), scene.TargetPoint()
        self._lanes, self._occlusions = planning.Lanes(), planning.OcclusionStrips(model)
        self._covariance, self._planner_text = planning.Covariance(), Document(p.PLANNER_TEXT)
        self._pose: planning.Pose | None = None
        self._planner_state = ""
        self._rays = (
            scene.Ray("front", model.ultrasonic, p.GREY),
            scene.Ray("left", model.infrared_left, p.GREY),
            scene.Ray("right", model.infrared_right, p.GREY),
        )
        self._room = scene.Maps(p.ROOM, swept=False)
        self._swept = scene.Maps(p.SWEPT, swept=True)
        self._errors = PoseErrors[int]()
        self._handlers: dict[str, Callable[[int, Any], None]] = {
            "/pose/estimate": self._on_estimate,
            "/truth/pose": self._on_truth,
            "/cmd": self._on_command,
            "/planner": self._on_planner,
            "/events": self._on_event,
            "/log": self._on_log,
            "/clock/sync": self._on_clock,
            "/device/imu": self._on_imu,
            "/device/encoders": self._on_encoders,
            "/device/range": self._on_range,
            "/device/power": self._on_power,
            "/device/status": self._on_status,
        }
        self._maps = {"/map/room": self._room, "/map/coverage": self._swept}
        self.topics = _AnyOf({*self._handlers, *self._maps})

    def take(self, message: LogMessage) -> None:
        """Collect one message; skip it if it cannot be decoded or has no valid time."""
        if message.log_ns > LATEST_NS:
            return
        self._link.count(message)
        topic = message.channel.topic
        try:
            if topic in self._handlers:
                self._handlers[topic](message.log_ns, message.decoded)
            elif topic in self._maps:
                self._maps[topic].add(message.log_ns, message.data)
        except MISREAD:
            return

    def send(self, recording: RerunRecording) -> None:
        """Send all collected values."""
        for time_ns, error_m in self._errors.take():
            self._pose_error.add(time_ns, error_m * 1e3)
        parts: list[_Part] = [self._velocity, self._command, self._yaw_rate, self._yaw_command]
        parts += [self._gyro, self._wheel_speeds, self._acceleration, self._range, self._battery]
        parts += [self._current, self._pose_error, self._clock, self._link, self._lines]
        parts += [self._whole, self._path, self._truth_path, self._motion, self._target]
        parts += [self._lanes, self._occlusions, self._covariance, self._planner_text]
        parts += [self._room, self._swept, *self._rays, *self._states.values()]
        for part in parts:
            part.send(recording)

    def _on_estimate(self, time_ns: int, estimate: Any) -> None:  # noqa: ANN401 - decoded
        x_m, y_m, theta_rad = map(float, (estimate.x_m, estimate.y_m, estimate.theta_rad))
        self._path.add(time_ns, x_m, y_m)
        self._whole.add(time_ns, x_m, y_m)
        self._pose = (x_m, y_m, theta_rad)
        self._motion.add(time_ns, *self._pose)
        self._covariance.add(time_ns, estimate)
        self._velocity.add(time_ns, estimate.v_m_s)
        self._yaw_rate.add(time_ns, estimate.yaw_rate_rad_s)
        self._errors.add_estimate(time_ns, x_m, y_m)

    def _on_truth(self, time_ns: int, truth: Any) -> None:  # noqa: ANN401 - type of a decoded value
        x_m, y_m = map(float, (truth.pose.position.x, truth.pose.position.y))
        self._truth_path.add(time_ns, x_m, y_m)
        self._errors.add_truth(time_ns, x_m, y_m)

    def _on_command(self, time_ns: int, command: Any) -> None:  # noqa: ANN401 - decoded
        self._command.add(time_ns, command.v_m_s)
        self._yaw_command.add(time_ns, command.yaw_rate_rad_s)

    def _on_planner(self, time_ns: int, state: Any) -> None:  # noqa: ANN401 - decoded
        name = str(state.state)
        self._states["planner"].add(time_ns, name)
        self._planner_text.add(time_ns, planning.describe(state))
        if name != self._planner_state:
            self._planner_state = name
            self._lanes.state(time_ns, name, self._pose)
        has_target = state.HasField("target_x_m")
        point = (float(state.target_x_m), float(state.target_y_m)) if has_target else None
        self._target.add(time_ns, point)

    def _on_event(self, time_ns: int, event: Any) -> None:  # noqa: ANN401 - type of a decoded value
        self._lines.add(time_ns, str(event.severity), f"{event.source} {event.kind}: {event.text}")
        if event.source == "planner" and event.kind == "lane":
            self._occlusions.lane(time_ns, event.data_json, self._pose)
        elif event.source == "planner" and event.kind == "occlusion":
            self._occlusions.report(time_ns, event.data_json, self._pose)

    def _on_log(self, time_ns: int, line: Any) -> None:  # noqa: ANN401 - type of a decoded value
        level = _LOG_LEVELS.get(line.level, "info")
        self._lines.add(time_ns, level, f"{line.name}: {line.message}")

    def _on_clock(self, time_ns: int, clock: Any) -> None:  # noqa: ANN401 - type of a decoded value
        self._clock.add(time_ns, clock.bound_ns * 1e-6, clock.round_trip_ns * 1e-6)

    def _on_imu(self, time_ns: int, imu: Any) -> None:  # noqa: ANN401 - type of a decoded value
        self._gyro.add(time_ns, imu.gyro_z_rad_s)
        self._acceleration.add(time_ns, imu.accel_x_m_s2, imu.accel_y_m_s2)

    def _on_encoders(self, time_ns: int, encoders: Any) -> None:  # noqa: ANN401 - decoded
        turned = self._wheels.advance((encoders.left, encoders.right), encoders.t_us)
        self._wheel_speeds.add(time_ns, *(self._wheel_radius_m * rate for rate in turned[2:]))

    def _on_range(self, time_ns: int, ranges: Any) -> None:  # noqa: ANN401 - decoded
        values = [
            getattr(ranges, name) if ranges.HasField(name) else None
            for name in ("ultrasonic_m", "infrared_left_m", "infrared_right_m")
        ]
        self._range.add(time_ns, *values)
        for ray, value in zip(self._rays, values, strict=True):
            ray.add(time_ns, value)

    def _on_power(self, time_ns: int, power: Any) -> None:  # noqa: ANN401 - type of a decoded value
        self._battery.add(time_ns, power.battery_v)
        self._current.add(time_ns, power.motor_left_a, power.motor_right_a)

    def _on_status(self, time_ns: int, status: Any) -> None:  # noqa: ANN401 - decoded
        self._states["mode"].add(time_ns, label(Mode, status.mode))
        self._states["stop"].add(time_ns, label(StopCause, status.stop_cause))


class _AnyOf:
    """The set of the handled topics and all topics of the link."""

    def __init__(self, topics: set[str]) -> None:
        self._topics = topics

    def __contains__(self, topic: object) -> bool:
        raw = ("/device/", "/raw/uart/rx", "/raw/can")
        return topic in self._topics or str(topic).startswith(raw)


class _LinkHealth:
    """Frames, bytes and lost frames of the link, for each second."""

    def __init__(self) -> None:
        self._series = Series(
            paths.LINK, frames_per_s=paths.BLUE, rx_kB_per_s=paths.GREEN, lost_per_s=paths.RED
        )
        self._second_ns = 0
        self._frames = self._bytes = 0
        self._losses = LossCounter()

    def count(self, message: LogMessage) -> None:
        """Count a message of the device, or received bytes."""
        topic = message.channel.topic
        device = topic.startswith("/device/")
        if self._second_ns == 0:
            self._second_ns = message.log_ns
        if message.log_ns - self._second_ns > _LONGEST_GAP_NS:
            self._second_ns = message.log_ns
        while message.log_ns - self._second_ns >= _SECOND_NS:
            self._second_ns += _SECOND_NS
            lost = self._losses.update()
            self._series.add(self._second_ns, self._frames, self._bytes / 1e3, lost)
            self._frames = self._bytes = 0
        if device:
            self._frames += 1
            self._losses.add(message.sequence, boot_id_of(message))
        elif topic == "/raw/uart/rx":
            self._bytes += len(message.data)
        elif topic == "/raw/can":
            with contextlib.suppress(*MISREAD):
                self._bytes += 0 if message.decoded.outgoing else len(message.decoded.data)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        self._series.send(recording)

"""An artificial run in the form of a real log: one pass of lanes over a small room."""

from __future__ import annotations

import functools
import itertools
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bridge.config import to_toml
from bridge.coverage.planner import PlannerState
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.log_writer import RunWriter
from bridge.session.records import (
    ClockRecord,
    CommandRecord,
    CoverageRecord,
    DeviceMessage,
    EventRecord,
    LogRecord,
    PlannerRecord,
    PoseRecord,
    RawBytes,
    Record,
    RoomRecord,
    RunInfo,
    Severity,
    TruthRecord,
)
from protocol.imu import NOMINAL
from protocol.messages.device import Encoders, Imu, Power, Range, Status
from protocol.schema.catalogue import CATALOGUE
from support.wheel_speeds import wheel_speeds_m_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from protocol.schema.message import Message

EPOCH_NS = 1_700_000_000_000_000_000
STEP_NS = 20_000_000
_SPEED_M_S = 0.2
_TURN_RAD_S = 1.0
_LANE_M = 0.16
_GRID_M = 0.02

PLAN = FloorPlan(
    "synthetic",
    ((0.0, 0.0), (2.06, 0.0), (2.06, 2.057), (0.0, 2.057)),
    (((0.9, 1.0), (1.7, 1.0), (1.7, 1.5), (0.9, 1.5)),),
    Pose2(0.17, 0.17, 0.0),
)


def run_info(*, plan: FloorPlan | None = PLAN) -> RunInfo:
    """Return the description of the artificial run."""
    return RunInfo(
        port="memory",
        planner="u-shape",
        seed=1,
        version="0.0.test",
        opened_unix_ns=EPOCH_NS,
        clock_offset_ns=EPOCH_NS - 5_000_000_000,
        robot=RobotModel(),
        robot_toml=to_toml(RobotModel()),
        plan=plan,
        extra={"room": "synthetic"},
    )


def _path() -> Iterator[tuple[Pose2, float, float, str]]:
    """Yield pose, speed, yaw rate and state of every step: three lanes until the box."""
    dt_s = STEP_NS * 1e-9
    pose, side = PLAN.start, 1.0
    for _ in range(4):
        for state, length_m, turn_rad in (
            ("lane", 1.7, 0.0),
            ("turn", 0.0, math.pi / 2),
            ("shift", _LANE_M, 0.0),
            ("turn", 0.0, math.pi / 2),
        ):
            v, w = (_SPEED_M_S, 0.0) if length_m else (0.0, side * _TURN_RAD_S)
            steps = round((length_m / v if v else turn_rad / _TURN_RAD_S) / dt_s)
            w = side * turn_rad / (steps * dt_s) if not v else 0.0
            for _ in range(steps):
                pose = Pose2(
                    pose.x_m + v * dt_s * math.cos(pose.theta_rad),
                    pose.y_m + v * dt_s * math.sin(pose.theta_rad),
                    pose.theta_rad + w * dt_s,
                )
                yield pose, v, w, state
        side = -side


def synthetic_run(seed: int = 1) -> Iterator[Record]:
    """Yield every kind of record, in time order, at the rates of a real run."""
    model, rng = RobotModel(), np.random.default_rng(seed)
    columns, rows = round(2.06 / _GRID_M), round(2.06 / _GRID_M)
    swept = np.full((rows, columns), -1, dtype=np.int8)
    xs, ys = np.meshgrid((np.arange(columns) + 0.5) * _GRID_M, (np.arange(rows) + 0.5) * _GRID_M)
    left = right = 0.0
    sequence = itertools.count()
    last_state, turns = "", 0
    yield RoomRecord(EPOCH_NS, PLAN)
    yield LogRecord(EPOCH_NS, Severity.INFO, "session", "agreed with the device")
    for step, (pose, v, w, state) in enumerate(_path()):
        now_ns = EPOCH_NS + step * STEP_NS
        t_us = step * 20_000
        noise = rng.normal(0.0, 1.0, 8)
        vl, vr = wheel_speeds_m_s(model, v, w)
        left += vl * 0.02 / model.metres_per_count
        right += vr * 0.02 / model.metres_per_count
        yield RawBytes(now_ns, False, bytes(rng.integers(0, 256, 60, dtype=np.uint8)))  # noqa: FBT003 - a named tuple's field

        def device(message: Message, at_us: int = t_us, log_ns: int = now_ns) -> DeviceMessage:
            name = CATALOGUE.spec(type(message)).name
            return DeviceMessage(
                log_ns, log_ns - 900_000, 15_000, 1, next(sequence) % 256, at_us, name, message
            )

        if step % 100 == 0:
            yield device(NOMINAL.info())
        yield device(Encoders(int(left) % 65536, int(right) % 65536))
        gyro = int(math.degrees(w) * 131 + 6 * noise[0])
        yield device(Imu(int(90 * noise[1]), int(80 * noise[2]), 16384, -900, 3, -5, gyro))
        if step % 3 == 0:
            ahead = min(
                4000, int(1000 * abs((1.9 if math.cos(pose.theta_rad) > 0 else 0.16) - pose.x_m))
            )
            yield device(
                Range(ahead, int(40 + 2 * noise[4]), 255 if step % 400 > 200 else 60, 0, 30)
            )
        if step % 5 == 0:
            yield device(Status(1, 0, 0, 240, 31))
        if step % 10 == 0:
            load = int(20 + 12 * abs(v) * 10 + noise[5])
            yield device(Power(int(16400 - step * 0.05), 200, max(0, load), max(0, load - 2)))
        if state != last_state:
            turns += state == "turn"
            last_state = state
            target = (pose.x_m + 0.5, pose.y_m) if state == "lane" else None
            yield PlannerRecord(
                now_ns, "u-shape", PlannerState(state, turns, 1.7, 1.7, 0.16, 1, target)
            )
            yield EventRecord(
                now_ns, Severity.INFO, "planner", state, f"began a {state}", {"turns": turns}
            )
        yield CommandRecord(now_ns, v, w, v, w)
        seen = Pose2(pose.x_m + 0.004 * noise[6], pose.y_m + 0.004 * noise[7], pose.theta_rad)
        yield PoseRecord(
            now_ns, seen, v, w, (1e-5, 0.0, 0.0, 0.0, 1e-5, 0.0, 0.0, 0.0, 1e-4), 1e-4, 1.0
        )
        yield TruthRecord(now_ns, pose)
        yield RawBytes(now_ns, True, bytes(rng.integers(0, 256, 22, dtype=np.uint8)))  # noqa: FBT003 - a named tuple's field
        along = (xs - pose.x_m) * math.cos(pose.theta_rad) + (ys - pose.y_m) * math.sin(
            pose.theta_rad
        )
        across = (ys - pose.y_m) * math.cos(pose.theta_rad) - (xs - pose.x_m) * math.sin(
            pose.theta_rad
        )
        swept[(np.abs(along) < 0.02) & (np.abs(across) < 0.08)] = 0
        if step % 50 == 0:
            yield ClockRecord(now_ns, EPOCH_NS - 1_000_000, 12.5, 15_000, 2_100_000, step, 7)
            yield CoverageRecord(now_ns, swept.copy(), 0.0, 0.0, _GRID_M)


def summary() -> dict[str, object]:
    """Return the made-up run's end."""
    return {"outcome": "complete", "room": "synthetic", "coverage": {"body_free": 0.5}}


def first_records(seconds: float) -> Iterator[Record]:
    """Yield the records of the first seconds of a made-up run."""
    for record in synthetic_run():
        if record.log_ns > EPOCH_NS + round(seconds * 1e9):
            return
        yield record


def write_synthetic_log(path: Path, records: Iterable[Record] | None = None) -> Path:
    """Write a complete log of these records, by default of the whole made-up run."""
    writer = RunWriter(path, run_info())
    for record in synthetic_run() if records is None else records:
        writer.write(record)
    writer.close(summary())
    return path


@functools.cache
def small_log() -> bytes:
    """Return the log of the first 300 records of a made-up run."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_synthetic_log(
            Path(folder) / "run.mcap", itertools.islice(synthetic_run(), 300)
        )
        return path.read_bytes()

"""Conversion of a run's state to JSON for the dashboard of another process, and back.

The other process converts the JSON back to a :class:`Snapshot`. It draws the snapshot with the same
code as the owner, so the drawing costs the owner no time.
"""

from __future__ import annotations

import base64
import dataclasses
import zlib
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from bridge.config import parse_robot
from bridge.coverage.planner import PlannerState as RunnerState
from bridge.coverage.swept_map import SWEPT, UNKNOWN, OccupancyArray
from bridge.errors import BridgeError, NoOwnerError
from bridge.motion.geometry import Pose2
from bridge.run.mission import Phase
from bridge.run.snapshot import (
    EstimatorSnapshot,
    LinkSnapshot,
    MissionSnapshot,
    RunnerSnapshot,
    SessionSnapshot,
    Snapshot,
    StateSnapshot,
    SyncSnapshot,
)
from bridge.session.states import State
from bridge.session.timesync import Fit
from protocol.link import LinkStatistics
from protocol.messages.device import (
    Encoders,
    Hello,
    Imu,
    LinkCounters,
    PlannerState,
    Power,
    Range,
    Status,
)
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.robot_model import RobotModel
    from bridge.run.snapshot import Swept
    from protocol.schema.message import Message

_MAX_CELLS = 4096 * 4096
"""Maximum number of cells of a swept map that is decoded."""


class SnapshotWriter:
    """Writes the snapshots of one run. The swept map is packed again only after a change."""

    def __init__(self) -> None:
        self._swept: tuple[int, dict[str, Any]] | None = None
        """Revision of the map and its packed cells; replaced as a whole."""

    def write(self, seen: Snapshot, now_s: float) -> dict[str, Any]:
        """Return a snapshot for JSON. Ages are relative to the host time ``now_s``, s."""
        state, mission, session = seen.state, seen.mission, seen.session
        kept = (state.imu, state.encoders, state.range, state.power, state.status, state.planner)
        others = (state.counters, seen.hello, *state.plugged.values())
        messages = [m for m in (*kept, *others) if m is not None]
        ends_s, runner = mission.ends_s, mission.runner
        pose, fit = seen.estimator.pose, seen.sync.fit
        return {
            "messages": {CATALOGUE.by_class[type(m)].name: _plain(m) for m in messages},
            "age_s": {
                CATALOGUE.by_class[kind].name: now_s - at_s
                for kind, at_s in state.arrived_s.items()
            },
            "run": mission.phase.value,
            "asking": mission.asking,
            "ends_in_s": None if ends_s is None else ends_s - now_s,
            "holding": seen.holding,
            "runner": None
            if runner is None
            else {
                "state": _runner_state(runner.state),
                "turns": runner.turns,
                "lane_length_m": runner.lane_length_m,
            },
            "session": session.state.value,
            "node": session.node,
            "signs": session.signs,
            "link": dataclasses.asdict(session.link.statistics),
            "link_age_s": now_s - (session.link.counted_ns or 0) / 1e9,
            "pose": list(pose),
            "v_m_s": seen.estimator.v_m_s,
            "yaw_rate_rad_s": seen.estimator.yaw_rate_rad_s,
            "round_trip_ns": seen.sync.round_trip_ns,
            "bound_ns": None if fit is None else fit.bound_ns,
            "path_m": seen.path_m,
            "swept": self._packed(seen.swept),
        }

    def _packed(self, swept: Swept) -> dict[str, Any]:
        revision, packed = swept.revision, self._swept
        if packed is None or packed[0] != revision:
            grid = swept.to_occupancy()
            bits = np.packbits(grid.cells == SWEPT).tobytes()
            packed = self._swept = (
                revision,
                {
                    "shape": list(grid.cells.shape),
                    "origin_m": [grid.origin_x_m, grid.origin_y_m],
                    "resolution_m": grid.resolution_m,
                    "cells": base64.b64encode(zlib.compress(bits, 1)).decode(),
                },
            )
        return packed[1]


def read_model(about: Mapping[str, Any]) -> RobotModel:
    """Return the robot of an owner's run.

    Raises:
        NoOwnerError: the owner's description has another form.

    """
    try:
        return parse_robot(about["robot"])
    except (BridgeError, KeyError, TypeError) as error:
        raise _other_version(error) from None


def read_snapshot(data: Mapping[str, Any], model: RobotModel, now_s: float) -> Snapshot:
    """Return the snapshot that an owner has sent; ``now_s`` is host time, s.

    Raises:
        NoOwnerError: the owner's description has another form.

    """
    try:
        return _snapshot(data, model, now_s)
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        TypeError,
        ValueError,
        zlib.error,
    ) as error:
        raise _other_version(error) from None


def _other_version(error: Exception) -> NoOwnerError:
    text = "the owner of the port is another version of sweepctl"
    return NoOwnerError(f"{text} ({type(error).__name__}: {error})")


def _snapshot(data: Mapping[str, Any], model: RobotModel, now_s: float) -> Snapshot:
    messages = {
        spec.cls: cast("Any", spec.cls)(*map(_value, values))
        for name, values in data["messages"].items()
        if (spec := CATALOGUE.by_name.get(name)) is not None
    }
    own = {Imu, Encoders, Range, Power, Status, PlannerState, LinkCounters, Hello}
    arrived_s = {
        CATALOGUE.by_name[name].cls: now_s - age_s
        for name, age_s in data["age_s"].items()
        if name in CATALOGUE.by_name
    }
    runner, ends_in_s, bound_ns = data["runner"], data["ends_in_s"], data["bound_ns"]
    return Snapshot(
        model,
        StateSnapshot(
            messages.get(Imu),
            messages.get(Encoders),
            messages.get(Range),
            messages.get(Power),
            messages.get(Status),
            messages.get(PlannerState),
            arrived_s,
            {kind: message for kind, message in messages.items() if kind not in own},
            messages.get(LinkCounters),
        ),
        MissionSnapshot(
            Phase(data["run"]),
            None,
            None if runner is None else _runner(runner),
            data["asking"],
            None,
            None if ends_in_s is None else now_s + ends_in_s,
        ),
        SessionSnapshot(State(data["session"]), data["node"], _link(data, now_s), data["signs"]),
        EstimatorSnapshot(Pose2(*data["pose"]), data["v_m_s"], data["yaw_rate_rad_s"]),
        SyncSnapshot(
            data["round_trip_ns"], None if bound_ns is None else Fit(0, 0.0, 0.0, bound_ns, 0.0)
        ),
        messages.get(Hello),
        data["path_m"],
        data["holding"],
        SweptPicture(data["swept"]),
    )


def _runner(data: Mapping[str, Any]) -> RunnerSnapshot:
    state, target = data["state"], data["state"]["target"]
    where = None if target is None else (float(target[0]), float(target[1]))
    return RunnerSnapshot(
        RunnerState(**{**state, "target": where}), data["turns"], data["lane_length_m"]
    )


def _link(data: Mapping[str, Any], now_s: float) -> LinkSnapshot:
    counts = data["link"]
    by_type = {int(type_id): count for type_id, count in counts["by_type"].items()}
    counted_ns = round((now_s - data["link_age_s"]) * 1e9)
    return LinkSnapshot(LinkStatistics(**{**counts, "by_type": by_type}), counted_ns)


class SweptPicture:
    """The swept floor of another process."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        """Unpack the cells."""
        rows, columns = data["shape"]
        if not 0 <= rows * columns <= _MAX_CELLS:
            raise ValueError(data["shape"])
        bits = zlib.decompressobj().decompress(base64.b64decode(data["cells"]), _MAX_CELLS // 8 + 1)
        cells = np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=rows * columns)
        grid = np.where(cells > 0, SWEPT, UNKNOWN).astype(np.int8).reshape(rows, columns)
        x_m, y_m = data["origin_m"]
        self._grid = OccupancyArray(grid, x_m, y_m, data["resolution_m"])
        self.revision = 0

    @property
    def swept_m2(self) -> float:
        """Area of the covered cells, m²."""
        swept = np.count_nonzero(self._grid.cells == SWEPT)
        return float(swept) * self._grid.resolution_m**2

    def to_occupancy(self) -> OccupancyArray:
        """Return the map: 0 swept, -1 unknown."""
        return self._grid


def _runner_state(state: RunnerState) -> dict[str, Any]:
    """Return a planner's state in Python numbers, because a plug-in may use numpy numbers."""
    target = state.target
    return {
        "state": str(state.state),
        "turn_count": int(state.turn_count),
        "lane_distance_m": float(state.lane_distance_m),
        "previous_lane_distance_m": float(state.previous_lane_distance_m),
        "length_m": float(state.length_m),
        "case": int(state.case),
        "target": None if target is None else [float(target[0]), float(target[1])],
    }


def _plain(message: Message) -> list[Any]:
    return [{"hex": v.hex()} if isinstance(v, bytes) else v for v in message]


def _value(value: Any) -> Any:  # noqa: ANN401 - the type is number, text, bytes or None
    return bytes.fromhex(value["hex"]) if isinstance(value, dict) else value

"""Simulated runs with the data that pictures need."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.coverage.planner import ScriptedPlanner
from bridge.coverage.recovery.evidence_kernels import SURE
from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.coverage.runner import PlanRunner
from bridge.motion.robot_model import RobotModel
from bridge.session.records import DeviceMessage, EventRecord, TruthRecord
from tools.cli.rooms import load_room
from tools.virtual.loop import HOST_BOOT_NS
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from bridge.coverage.planner import Planner, Script
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.legs import Leg
    from bridge.motion.observation import Observation, VelocityCommand
    from bridge.session.records import Record

MODEL = RobotModel()


class Sample(NamedTuple):
    """One control step."""

    t_s: float
    obs: Observation
    command: VelocityCommand
    target: VelocityCommand
    leg: Leg | None
    state: str


class MapView(NamedTuple):
    """The planner's map at one time."""

    t_s: float
    forbidden: NDArray[np.uint8]
    """Nonzero: bumps or a cliff forbid the cell to the axle."""
    occupied: NDArray[np.bool_]
    extent: tuple[float, float, float, float]
    """Left, right, bottom, top, metres."""


@dataclass(slots=True)
class PicturedRun:
    """A simulated run with the data that pictures need; times in seconds since the robot booted."""

    plan: FloorPlan
    planner: Planner
    samples: list[Sample] = field(default_factory=list)
    truth: list[tuple[float, Pose2]] = field(default_factory=list)
    events: list[tuple[float, EventRecord]] = field(default_factory=list)
    messages: list[DeviceMessage] = field(default_factory=list)
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

    def store_map(self, t_s: float) -> None:
        """Store the planner's map, if it has one."""
        if isinstance(self.planner, RecoveryPlanner):
            evidence_map = self.planner.context.evidence_map
            (left, bottom), (rows, columns) = evidence_map.to_metres(0, 0), evidence_map.shape
            right, top = evidence_map.to_metres(columns, rows)
            forbidden, _ = evidence_map.places()
            occupied = evidence_map.wall >= SURE
            view = MapView(t_s, forbidden.copy(), occupied, (left, right, bottom, top))
            self.maps.append(view)

    def between(self, begin_s: float, end_s: float) -> list[Sample]:
        """Return the control steps of a time span."""
        return [sample for sample in self.samples if begin_s <= sample.t_s <= end_s]

    def first(self, kind: str, after_s: float = 0.0) -> tuple[float, EventRecord]:
        """Return the first event of a kind."""
        return next((t, e) for t, e in self.events if e.kind == kind and t >= after_s)


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
            self._run.store_map(t_s)
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


def simulate(plan: FloorPlan, planner: Planner, noise: str, seed: int) -> PicturedRun:
    """Run a planner in virtual time, and store the data to draw."""
    run = PicturedRun(plan, planner)
    run_virtual(plan, MODEL, None, run, seed=seed, noise=noise, runner=_Recorder(run))
    return run


@cache
def recovery_run(room: str, noise: str = "typical", seed: int = 1) -> PicturedRun:
    """Return a complete run of ``recovery`` in a shipped room."""
    return simulate(load_room(room, MODEL.radius_m), RecoveryPlanner(MODEL), noise, seed)


def legs_run(legs: Sequence[Leg], start: Pose2 | None = None) -> PicturedRun:
    """Return a run of these legs in the room ``empty``, from its start pose or another pose."""
    plan = load_room("empty", MODEL.radius_m)
    plan = plan if start is None else replace(plan, start=start)
    return simulate(plan, _Legs(legs), "typical", 1)

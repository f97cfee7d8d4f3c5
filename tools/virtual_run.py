"""Host and virtual sweeper in one process and in virtual time, every byte through the codec."""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.host import Host, HostOptions
from bridge.mission import Ending, Mission
from bridge.telemetry import RoomRecord, TruthRecord
from protocol.clock import HostNs
from sim_device.device import VirtualSweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.floorplan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink

EPOCH_NS = 1_767_225_600_000_000_000
"""2026-01-01T00:00:00Z: simulated runs start here, so that equal seeds give equal logs."""
HOST_BOOT_NS = 5_000_000_000
"""The host's clock at the device's boot: the two must not agree by accident."""
LATENCY_US = 1_000
"""One way, as over an adapter at 1 ms."""
_TRUTH_PERIOD_MS = 20
_TICKS_KEPT = 32
"""A third of a second: longer than any message is under way."""


@dataclass(slots=True)
class VirtualRun:
    """A finished run: both ends and the truth over time."""

    device: VirtualSweeper
    host: Host
    truth: list[tuple[float, Pose2]] = field(default_factory=list)
    """Time (s since boot) and true pose, every 20 ms of the drive."""
    energy: list[tuple[float, float]] = field(default_factory=list)
    """Time (s since boot) and energy drawn since (Wh), about once a second of the drive."""
    errors_m: list[float] = field(default_factory=list)
    """Distance of estimate and truth at the encoder samples of the drive."""


def run_virtual(  # noqa: PLR0913 - what a run can be asked for
    plan: FloorPlan,
    model: RobotModel,
    planner: str,
    sink: Sink,
    *,
    seed: int = 0,
    noise: str = "typical",
    max_time_s: float = 3600.0,
    progress: Callable[[float, Host], None] | None = None,
    ended: Callable[[], Ending | None] = lambda: None,
    prepare: Callable[[VirtualRun], None] = lambda _: None,
) -> VirtualRun:
    """Run one plan from start to end.

    ``progress`` is called about once a simulated second; ``ended`` is asked as often whether
    the run should end early. ``prepare`` may change both ends before the first byte.

    Raises:
        FloorPlanError: the robot does not fit at the room's start.
        UnknownPlannerError: no such planner.
        UnknownNoiseLevelError: no such noise level.

    """
    device = VirtualSweeper(plan, model, seed=seed, noise=noise)
    runner = PlanRunner(make_planner(planner, model, random.Random(seed)), model)
    ids = itertools.count(0x5EED_0001)
    host = Host(
        model,
        sink,
        HostOptions(EPOCH_NS - HOST_BOOT_NS, planner, plan.start),
        Mission(runner, max_time_s=max_time_s),
        lambda: next(ids),
    )
    run = VirtualRun(device, host)
    prepare(run)
    sink.write(RoomRecord(EPOCH_NS, plan))
    _loop(run, sink, progress, ended)
    host.record_map(HostNs(device.next_deadline_us() * 1000 + HOST_BOOT_NS))
    return run


def _loop(  # noqa: C901 - two ends and the wire between them
    run: VirtualRun,
    sink: Sink,
    progress: Callable[[float, Host], None] | None,
    ended: Callable[[], Ending | None],
) -> None:
    device, host = run.device, run.host
    to_device: list[tuple[int, bytes]] = []
    to_host: list[tuple[int, bytes]] = []
    poses: dict[int, Pose2] = {}
    host.open(HostNs(HOST_BOOT_NS))
    progress_us = 0
    while not host.mission.done:
        now_us = min(
            device.next_deadline_us(),
            -((HOST_BOOT_NS - host.next_deadline()) // 1000),
            to_device[0][0] if to_device else 1 << 62,
            to_host[0][0] if to_host else 1 << 62,
        )
        arrived = b""
        while to_device and to_device[0][0] <= now_us:
            arrived += to_device.pop(0)[1]
        out = device.step(arrived, now_us)
        if out:
            to_host.append((now_us + LATENCY_US, out))
        if device.plant.tick_ms not in poses:
            _remember(run, poses, device.plant.tick_ms, device.plant.pose, sink)
        now_ns = HostNs(now_us * 1000 + HOST_BOOT_NS)
        while to_host and to_host[0][0] <= now_us:
            _receive(run, poses, to_host.pop(0)[1], now_ns)
        host.poll(now_ns)
        data = host.data_to_send(now_ns)
        if data:
            to_device.append((now_us + LATENCY_US, data))
        if now_us >= progress_us:
            progress_us = now_us + 1_000_000
            if _driving(run):
                run.energy.append((now_us / 1e6, run.device.truth.energy_wh))
            if progress is not None:
                progress(now_us / 1e6, host)
            ending = ended()
            if ending is not None:
                host.end(ending, now_ns)


def _remember(
    run: VirtualRun, poses: dict[int, Pose2], tick_ms: int, pose: Pose2, sink: Sink
) -> None:
    poses[tick_ms] = pose
    if len(poses) > _TICKS_KEPT:
        del poses[next(iter(poses))]
    if tick_ms % _TRUTH_PERIOD_MS == 0:
        sink.write(TruthRecord(EPOCH_NS + tick_ms * 1_000_000, pose))
        if _driving(run):
            run.truth.append((tick_ms / 1000.0, pose))


def _receive(run: VirtualRun, poses: dict[int, Pose2], data: bytes, now_ns: HostNs) -> None:
    """Hand bytes to the host; hold the estimate against the truth of the encoders' moment."""
    host = run.host
    before_us = host.encoders_us
    host.receive(data, now_ns)
    if host.encoders_us != before_us and _driving(run):
        truth = poses.get(host.encoders_us // 1000)
        if truth is not None:
            run.errors_m.append(truth.distance_m(host.estimator.pose))


def _driving(run: VirtualRun) -> bool:
    mission = run.host.mission
    return mission.drive_started_s is not None and mission.drive_ended_s is None

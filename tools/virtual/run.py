"""Host and virtual sweeper in one process and in virtual time, every byte through the codec."""

from __future__ import annotations

import contextlib
import itertools
import random
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError
from bridge.evaluation.metrics import CoverageMeter, CoverageTrack
from bridge.run.ending import CRASH_CAUSE, Ending, crash_ending, traced
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import RoomRecord, Severity, TruthRecord
from bridge.session.stop_request import StopRequest
from bridge.supervise import Supervisor
from protocol.clock import HostNs
from protocol.link import Link
from protocol.values import StopCause
from sim_device.line.line import STRAIGHT
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from tools.cli.fault_help import fault_record

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.supervise import SuperviseSettings
    from protocol.link import LinkBase
    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from sim_device.noise import NoiseLevel

EPOCH_NS = 1_767_225_600_000_000_000
"""2026-01-01T00:00:00Z: simulated runs start here, so that equal seeds give equal logs."""
HOST_BOOT_NS = 5_000_000_000
"""The host's clock at the device's boot: the two must not agree by accident."""
LATENCY_US = 1_000
"""One way, as over an adapter at 1 ms."""
CONFIRM_S = 1.0
"""Time that the device has to confirm the stop of a run whose loop has failed, s."""
_CRASH_STOP_ID = 0xC0DE
"""Id of that stop: far from the first ones, which the host counts up from its session's."""
_TRUTH_PERIOD_MS = 40
_TICKS_KEPT = 32
"""A third of a second: longer than any message is under way."""


@dataclass(slots=True)
class VirtualRun:
    """A finished run: both ends and what the truth came to. It does not grow with the run."""

    device: VirtualSweeper
    host: Host
    track: CoverageTrack
    """Measures the true pose of every 40 ms of the drive."""
    rig: Rig | None = None
    """The device with its line and faults, where either was asked for."""
    end_error_m: float | None = None
    """Distance of estimate and truth at the newest encoder sample of the drive."""
    max_error_m: float | None = None
    """The greatest of them."""
    crash: Exception | None = None
    """What has ended the run's loop; None: it ended in order."""


def run_virtual(  # noqa: PLR0913 - what a run can be asked for
    plan: FloorPlan,
    model: RobotModel,
    planner: str,
    sink: Sink,
    *,
    seed: int = 0,
    noise: str | NoiseLevel = "typical",
    max_time_s: float = 3600.0,
    progress: Callable[[float, Host], None] | None = None,
    ended: Callable[[], Ending | None] = lambda: None,
    faults: Sequence[FaultSpec] = (),
    line: LineSettings | None = None,
    prepare: Callable[[VirtualRun], None] = lambda _: None,
    mission: Mission | None = None,
    supervise: SuperviseSettings | None = None,
    link: type[LinkBase] = Link,
    crash_ends: bool = False,
) -> VirtualRun:
    """Run one plan from start to end.

    A ``mission`` takes the place of the planner's own on the host; ``supervise`` are the rules
    that the run is watched by.

    ``progress`` is called about once a simulated second; ``ended`` is asked as often whether
    the run should end early. A ``line`` takes the place of the plain delay of 1 ms each way;
    ``prepare`` may change both ends before the first byte. ``link`` is the link of both ends:
    UART, or CAN. With ``crash_ends`` an exception of the loop ends the run as a fault, the robot
    stopped, as in a live run; else it is the caller's.

    Raises:
        FaultSpecError: a fault cannot be on this device.
        FloorPlanError: the robot does not fit at the room's start.
        UnknownPlannerError: no such planner.
        UnknownNoiseLevelError: no such noise level.

    """
    device = VirtualSweeper(plan, model, seed=seed, noise=noise, link=link)
    if mission is None:
        runner = PlanRunner(make_planner(planner, model, random.Random(seed)), model)
        mission = Mission(runner, max_time_s=max_time_s)
    ids = itertools.count(0x5EED_0001)
    host = Host(
        model,
        sink,
        HostOptions(EPOCH_NS - HOST_BOOT_NS, planner, plan.start, None, link),
        mission,
        lambda: next(ids),
    )
    if supervise is not None:
        host.supervise(Supervisor(model, supervise))
    rig = Rig(device, line or STRAIGHT, faults, seed=seed) if faults or line else None
    run = VirtualRun(device, host, CoverageMeter(plan, model).track(), rig)
    prepare(run)
    sink.write(RoomRecord(EPOCH_NS, plan))
    try:
        _loop(run, sink, progress, ended, LATENCY_US if line is None else 0)
        host.record_map(_host_ns(device.next_deadline_us()))
    except BridgeError:
        raise
    except Exception as error:
        if not crash_ends:
            raise
        run.crash = error
        stop_crashed(host, run.rig or device, error)
    return run


def _host_ns(now_us: int) -> HostNs:
    return HostNs(now_us * 1000 + HOST_BOOT_NS)


def stop_crashed(host: Host, device: Rig | VirtualSweeper, error: Exception) -> None:
    """Stop the virtual robot without the host, whose code has failed; put it on record."""
    stop = StopRequest(type(host.session.link), CRASH_CAUSE, _CRASH_STOP_ID, host.session.node)
    begun_ns = _host_ns(device.next_deadline_us())
    with contextlib.suppress(Exception):  # the virtual device may be what has failed
        end_us = device.next_deadline_us() + round(CONFIRM_S * 1e6)
        while stop.confirmed_by is None and (now_us := device.next_deadline_us()) < end_us:
            now_ns = _host_ns(now_us)
            stop.receive(device.step(stop.data_to_send(now_ns), now_us), now_ns)
    confirmed = StopCause.NONE if stop.confirmed_by is None else CRASH_CAUSE
    ending = crash_ending(error, CRASH_CAUSE, confirmed)
    host.mission.crashed(ending, confirmed, begun_ns / 1e9)
    with contextlib.suppress(Exception):  # what fails may be the record itself
        now_ns = _host_ns(device.next_deadline_us())
        host.event(
            now_ns, Severity.ERROR, "session", "crash", ending.reason, traceback=traced(error)
        )


def _loop(  # noqa: C901, PLR0912 - two ends and the wire between them
    run: VirtualRun,
    sink: Sink,
    progress: Callable[[float, Host], None] | None,
    ended: Callable[[], Ending | None],
    latency_us: int,
) -> None:
    rig, host = run.rig, run.host
    device = rig or run.device
    plant, mission = run.device.plant, host.mission
    to_device: deque[tuple[int, bytes]] = deque()
    to_host: deque[tuple[int, bytes]] = deque()
    poses: dict[int, Pose2] = {}
    host.open(HostNs(HOST_BOOT_NS))
    # Neither end is asked, nor its next moment, before there is something for it to do.
    device_us, host_us = device.next_deadline_us(), 0
    tick_ms = progress_us = 0
    while not mission.done:
        now_us = min(device_us, host_us)
        if to_device and to_device[0][0] < now_us:
            now_us = to_device[0][0]
        if to_host and to_host[0][0] < now_us:
            now_us = to_host[0][0]
        arrived = b""
        while to_device and to_device[0][0] <= now_us:
            arrived += to_device.popleft()[1]
        if arrived or now_us >= device_us:
            out = device.step(arrived, now_us)
            device_us = device.next_deadline_us()
            if out:
                to_host.append((now_us + latency_us, out))
            if rig is not None:
                _record_faults(rig, sink)
            if plant.tick_ms != tick_ms:
                _remember(run, poses, tick_ms, sink)
                tick_ms = plant.tick_ms
        now_ns = HostNs(now_us * 1000 + HOST_BOOT_NS)
        heard = False
        while to_host and to_host[0][0] <= now_us:
            heard = True
            _receive(run, poses, to_host.popleft()[1], now_ns)
        if heard or now_us >= host_us:
            if now_us >= host_us or host.mission.pending:
                host.poll(now_ns)
            data = host.data_to_send(now_ns)
            if data:
                to_device.append((now_us + latency_us, data))
            host_us = -((HOST_BOOT_NS - host.next_deadline()) // 1000)
        if now_us >= progress_us:
            progress_us = now_us + 1_000_000
            if progress is not None:
                progress(now_us / 1e6, host)
            ending = ended()
            if ending is not None:
                host.end(ending, now_ns)
                host_us = now_us


def _record_faults(rig: Rig, sink: Sink) -> None:
    for event in rig.faults.take_events():
        sink.write(fault_record(event, EPOCH_NS + event.t_us * 1000))


def _remember(run: VirtualRun, poses: dict[int, Pose2], last_ms: int, sink: Sink) -> None:
    """Keep the true pose by the stamp that the device puts on it; log it every 40 ms.

    A device whose clock drifts or jumps has control periods at other milliseconds than ours.
    """
    plant = run.device.plant
    tick_ms, pose = plant.tick_ms, plant.pose
    poses[own_ms(run.device)] = pose
    if len(poses) > _TICKS_KEPT:
        del poses[next(iter(poses))]
    if tick_ms // _TRUTH_PERIOD_MS != last_ms // _TRUTH_PERIOD_MS:
        sink.write(TruthRecord(EPOCH_NS + tick_ms * 1_000_000, pose))
        if _driving(run):
            run.track.add(tick_ms / 1000.0, *pose)


def own_ms(device: VirtualSweeper) -> int:
    """What the device's clock will stamp on the samples of its next control period, in ms."""
    return device.clock.stamp_us(device.next_deadline_us()) // 1000


def _receive(run: VirtualRun, poses: dict[int, Pose2], data: bytes, now_ns: HostNs) -> None:
    """Hand bytes to the host; hold the estimate against the truth of the encoders' moment."""
    host = run.host
    before_us = host.encoders_us
    host.receive(data, now_ns)
    if host.encoders_us != before_us and _driving(run):
        truth = poses.get(host.encoders_us // 1000)
        if truth is not None:
            run.end_error_m = error_m = truth.distance_m(host.estimator.pose)
            if run.max_error_m is None or error_m > run.max_error_m:
                run.max_error_m = error_m


def _driving(run: VirtualRun) -> bool:
    mission = run.host.mission
    return mission.drive_started_s is not None and mission.drive_ended_s is None

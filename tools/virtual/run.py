"""A run of host and virtual sweeper in virtual time, every byte through the codec."""

from __future__ import annotations

import contextlib
import itertools
import random
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError
from bridge.evaluation.metrics import CoverageMeter, CoverageTrack
from bridge.run.build import build_run
from bridge.run.ending import CRASH_CAUSE, Ending, crash_ending, traced
from bridge.run.mission import Resume
from bridge.run.options import HostOptions
from bridge.session.event_kinds import EventKind
from bridge.session.records import RoomRecord, Severity, TruthRecord
from bridge.session.stop_request import stop_request
from protocol.messages.values import StopCause
from protocol.uart.link import Link
from sim_device.core.chip import FirmwareCrashError
from sim_device.line.line import STRAIGHT
from sim_device.rig import Rig
from sim_device.sweeper import Sweeper, VirtualSweeper
from tools.cli.fault_help import fault_record
from tools.virtual.loop import HOST_BOOT_NS, LATENCY_US, VirtualLoop, host_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.estimation.tuning import EstimationTuning
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.run.host import Host
    from bridge.run.runner import Runner
    from bridge.supervise import SuperviseSettings
    from protocol.link import LinkBase
    from protocol.messages.values import OnboardPlanner
    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from sim_device.noise import NoiseLevel

EPOCH_NS = 1_767_225_600_000_000_000
"""Unix time at which simulated runs start, ns: 2026-01-01T00:00:00Z. It is constant, so that equal
seeds give equal logs."""
CONFIRM_S = 1.0
"""Time in which the device must confirm the stop after a crash of the loop, s."""
_CRASH_STOP_ID = 0xC0DE
"""Command id of the stop after a crash of the loop, far from the ids that the host has used."""
_TRUTH_PERIOD_MS = 40
"""Period of the true poses in the log, ms: 25 Hz, above the 20 Hz that the log format promises."""


@dataclass(slots=True)
class VirtualRun:
    """A run: both ends and the measurements of the truth. Its memory does not grow."""

    device: Sweeper[Any]
    host: Host
    loop: VirtualLoop
    """Joins both ends and measures the error of the estimate."""
    track: CoverageTrack
    """Coverage of the true path, from a pose every 40 ms."""
    rig: Rig | None = None
    """The device with its line and faults; None: no line and no faults."""
    crash: Exception | None = None
    """Exception that ended the loop; None: the run ended normally."""


def run_virtual(  # noqa: PLR0913 - one parameter for each property of a run
    plan: FloorPlan,
    model: RobotModel,
    planner: str | None,
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
    runner: Runner | None = None,
    onboard: OnboardPlanner | None = None,
    resume: Resume = Resume.NEVER,
    supervise: SuperviseSettings | None = None,
    link: type[LinkBase] = Link,
    crash_ends: bool = False,
    device: Sweeper[Any] | None = None,
    estimation: EstimationTuning | None = None,
) -> VirtualRun:
    """Run one plan from start to end.

    Args:
        plan: the room.
        model: the robot.
        planner: name of the planner on the host; None: nothing moves.
        sink: gets every record of the run.
        seed: seed of everything random.
        noise: noise level, by name or as an object.
        max_time_s: time limit of the run, simulated seconds.
        progress: called about once a simulated second with the time, s, and the host.
        ended: called as often as ``progress``; returns how to end the run early, or None.
        faults: faults to inject.
        line: properties of the link; None: a plain delay of 1 ms in each direction.
        prepare: called before the first byte; may change both ends.
        runner: replaces the planner.
        onboard: planner of the device, which replaces ``planner`` and ``runner``.
        resume: reaction to the return of a lost device.
        supervise: settings of the supervision; None: the run is not supervised.
        link: link of both ends: UART or CAN.
        crash_ends: an exception of the loop stops the robot and ends the run as a fault, as in a
            live run; otherwise the exception is raised.
        device: the virtual sweeper, made with the same room, robot, seed, noise and link; None: a
            sweeper with the firmware's model in Python.
        estimation: tuned constants of the estimation; None: the defaults.

    Raises:
        FaultSpecError: the device does not support a fault.
        FloorPlanError: the robot does not fit at the room's start.
        UnknownPlannerError: no such planner.
        UnknownNoiseLevelError: no such noise level.

    """
    if device is None:
        device = VirtualSweeper(plan, model, seed=seed, noise=noise, link=link)
    if runner is None and onboard is None and planner is not None:
        runner = PlanRunner(make_planner(planner, model, random.Random(seed)), model)
    ids = itertools.count(0x5EED_0001)
    host = build_run(
        model,
        sink,
        HostOptions(
            EPOCH_NS - HOST_BOOT_NS,
            planner or "",
            plan.start,
            None,
            link,
            estimation=estimation,
            plan=plan,
        ),
        lambda: next(ids),
        runner=runner,
        onboard=onboard,
        supervise=supervise,
        max_time_s=max_time_s,
        resume=resume,
    )
    rig = Rig(device, line or STRAIGHT, faults, seed=seed) if faults or line else None
    track = CoverageMeter(plan, model).track()

    def log_truth(last_ms: int, now_ms: int, pose: Pose2) -> None:
        if now_ms // _TRUTH_PERIOD_MS != last_ms // _TRUTH_PERIOD_MS:
            sink.write(TruthRecord(EPOCH_NS + now_ms * 1_000_000, pose))
            mission = host.mission
            if mission.drive_started_s is not None and mission.drive_ended_s is None:
                track.add(now_ms / 1000.0, *pose)

    latency_us = LATENCY_US if line is None else 0
    loop = VirtualLoop(device, rig, latency_us, log_truth, partial(_log_faults, rig, sink))
    run = VirtualRun(device, host, loop, track, rig)
    prepare(run)
    sink.write(RoomRecord(EPOCH_NS, plan))
    try:
        _loop(run, progress, ended)
        host.record_map(host_ns(device.next_deadline_us()))
    except BridgeError:
        raise
    except Exception as error:
        if not crash_ends:
            raise
        run.crash = error
        stop_crashed(host, run.rig or device, error)
    return run


def _log_faults(rig: Rig | None, sink: Sink) -> None:
    for event in [] if rig is None else rig.faults.take_events():
        sink.write(fault_record(event, EPOCH_NS + event.t_us * 1000))


def stop_crashed(host: Host, device: Rig | Sweeper[Any], error: Exception) -> None:
    """Stop the virtual robot without the host, whose code has failed, and record the crash."""
    stop = stop_request(type(host.session.link), CRASH_CAUSE, _CRASH_STOP_ID, host.session.node)
    begun_ns = host_ns(device.next_deadline_us())
    with contextlib.suppress(Exception):  # the virtual device itself may have failed
        end_us = device.next_deadline_us() + round(CONFIRM_S * 1e6)
        while stop.confirmed_by is None and (now_us := device.next_deadline_us()) < end_us:
            now_ns = host_ns(now_us)
            stop.receive(device.step(stop.data_to_send(now_ns), now_us), now_ns)
    confirmed = StopCause.NONE if stop.confirmed_by is None else CRASH_CAUSE
    ending, trace = crash_ending(error, CRASH_CAUSE, confirmed), traced(error)
    if isinstance(error, FirmwareCrashError):
        ending, trace = replace(ending, reason=str(error)), error.details
    host.mission.crashed(ending, confirmed, begun_ns / 1e9)
    with contextlib.suppress(Exception):  # the recording itself may have failed
        now_ns = host_ns(device.next_deadline_us())
        host.event(
            now_ns,
            Severity.ERROR,
            "session",
            EventKind.CRASH,
            ending.reason,
            traceback=trace,
        )


def _loop(
    run: VirtualRun,
    progress: Callable[[float, Host], None] | None,
    ended: Callable[[], Ending | None],
) -> None:
    loop, host = run.loop, run.host
    mission = host.mission
    loop.connect(host)
    progress_us = 0
    while not mission.done:
        loop.step()
        if loop.now_us >= progress_us:
            progress_us = loop.now_us + 1_000_000
            if progress is not None:
                progress(loop.now_us / 1e6, host)
            ending = ended()
            if ending is not None:
                host.end(ending, loop.host_ns)
                loop.wake()

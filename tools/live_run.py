"""A live run on a port: opened, recorded, shown, ended in order, summed up."""

from __future__ import annotations

import contextlib
import secrets
import signal
import sys
from array import array
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.host import Host
from bridge.host_options import HostOptions
from bridge.io import clock
from bridge.io.ports import link_of, open_port
from bridge.io.pump import Pump
from bridge.mission import Ending, Mission
from bridge.motion.geometry import Pose2
from bridge.record.recorder import ThreadedRecorder
from bridge.record.writer import RunWriter
from bridge.summary import run_summary
from bridge.telemetry import RoomRecord, RunInfo
from protocol.values import StopCause
from tools.console import err
from tools.keys import on_key
from tools.live import LivePicture, Teller
from tools.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bridge.coverage.floorplan import FloorPlan
    from bridge.io.ports import BytePort
    from bridge.motion.robot_model import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """What a live run is asked for."""

    port: str
    log: Path
    model: RobotModel
    robot_toml: str
    plan: FloorPlan | None
    planner: str | None
    duration_s: float | None
    node: int | None
    baud: int
    bitrate: int | None
    lan: bool
    dtr: bool
    rts: bool
    clear_stop: bool
    force: bool


@dataclass(frozen=True, slots=True)
class LiveResult:
    """How a live run ended."""

    summary: dict[str, Any]
    exit_status: int
    complaints: list[str]
    """Lines for people about what went wrong."""


def run_live(asked: LiveOptions) -> LiveResult:
    """Run until the plan, the time, the device or a person ends it.

    Raises:
        PortError: the port cannot be opened; nothing was recorded.
        LogError: the log cannot be made; the robot was not spoken to.

    """

    def reopen() -> BytePort:
        return open_port(
            asked.port,
            baud=asked.baud,
            dtr=asked.dtr,
            rts=asked.rts,
            bitrate=asked.bitrate,
            lan=asked.lan,
        )

    runner = None
    if asked.planner is not None:
        planner = make_planner(asked.planner, asked.model, np.random.default_rng())
        runner = PlanRunner(planner, asked.model)
    opened = reopen()
    try:
        recorder, offset_ns = _recorder(asked)
    except BaseException:
        opened.close()
        raise
    teller = Teller(recorder, plain=not err().is_terminal)
    host = Host(
        asked.model,
        teller,
        HostOptions(
            offset_ns,
            asked.planner or "",
            asked.plan.start if asked.plan else Pose2(0.0, 0.0, 0.0),
            asked.node,
            link_of(asked.port),
        ),
        Mission(runner, clear_stop=asked.clear_stop),
        lambda: secrets.randbelow(0xFFFF_FFFE) + 1,
    )
    way = array("d")
    if asked.plan is not None:
        host.on_drive_pose = lambda time_s, pose: way.extend((time_s, *pose))
    pump = Pump(host, opened, reopen)
    pump.watch = lambda: _log_failed(recorder)
    if asked.duration_s is not None:
        pump.end_after(asked.duration_s)
    try:
        with _endings(pump):  # the summary too is written whole
            with _picture(host, teller):
                pump.run()
            if host.drive_pose is not None:
                host.record_map(clock.now())
            summary = _summarise(host, asked, way)
            recorder.close(summary)
    finally:
        recorder.close()
    return _result(host, asked, recorder, summary)


def _recorder(asked: LiveOptions) -> tuple[ThreadedRecorder, int]:
    """The log, opened, and the Unix offset that it was opened with."""
    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    info = RunInfo(
        asked.port,
        asked.planner or "",
        None,
        VERSION,
        opened_ns,
        offset_ns,
        asked.robot_toml,
        asked.plan,
    )
    recorder = ThreadedRecorder(RunWriter(asked.log, info, force=asked.force))
    if asked.plan is not None:
        recorder.write(RoomRecord(opened_ns, asked.plan))
    return recorder, offset_ns


def _result(
    host: Host, asked: LiveOptions, recorder: ThreadedRecorder, summary: dict[str, Any]
) -> LiveResult:
    ending = host.mission.ending
    complaints = []
    if ending is not None and ending.exit_status:
        complaints.append(f"{asked.port}: {ending.reason}")
    if recorder.error is not None:
        complaints.append(str(recorder.error))
    if recorder.dropped:
        complaints.append(f"{recorder.dropped} records did not reach the log")
    return LiveResult(summary, ending.exit_status if ending else 1, complaints)


def _log_failed(recorder: ThreadedRecorder) -> Ending | None:
    """An end to the run where its log can no longer be written."""
    if recorder.error is None:
        return None
    return Ending("fault", f"the log failed: {recorder.error}", 1, StopCause.SUPERVISE)


@contextlib.contextmanager
def _endings(pump: Pump) -> Iterator[None]:
    """Turn signals and the stop key into an orderly end: the robot stops first."""

    def request(ending: Ending) -> None:
        if not pump.host.mission.done:  # else its port is closed, and there is nothing to wake
            pump.request_end(ending)

    def interrupted(number: int, _frame: object) -> None:
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        request(Ending("stopped", f"ended by {name}", 0))

    def stop_key() -> None:
        request(Ending("stopped", "stopped by the operator's key", 5, StopCause.OPERATOR))

    numbers = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32":
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupted) for number in numbers}
    try:
        with on_key(" s", stop_key):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _picture(host: Host, teller: Teller) -> Iterator[None]:
    if not err().is_terminal:
        yield
        return
    picture = LivePicture(host, teller)
    picture.start()
    try:
        yield
    finally:
        picture.stop()


def _summarise(host: Host, asked: LiveOptions, way: array[float]) -> dict[str, Any]:
    report, plan = None, asked.plan
    if plan is not None and way:
        from bridge.coverage.metrics import CoverageMeter

        runner = host.mission.runner
        lanes_m = runner.lane_length_m if runner else 0.0
        meter = CoverageMeter(plan, asked.model)
        rows = iter(way)
        report = meter.measure(zip(rows, rows, rows, rows, strict=True), lanes_m)
    return run_summary(
        host,
        room=plan.name if plan else None,
        planner=asked.planner,
        seed=None,
        log=str(asked.log),
        report=report,
    )

"""A live run on a port: opened, recorded, shown, ended in order, summed up."""

from __future__ import annotations

import contextlib
import gc
import signal
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.api.owner_service import OwnerService
from bridge.api.pump import Pump
from bridge.coverage.registry import make_planner
from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError
from bridge.io import clock
from bridge.io.gamepad import Gamepad, Sticks
from bridge.io.identifiers import new_session_id
from bridge.io.owner_socket import OwnerSocket
from bridge.io.ports import latency_note, link_of
from bridge.io.reopening import Opener
from bridge.motion.geometry import Pose2
from bridge.record.errors import LogGoneError, LogReadError
from bridge.record.family import parts_of
from bridge.record.policy import RecordOptions, open_log
from bridge.record.recorder import ThreadedRecorder
from bridge.run.build import build_run
from bridge.run.dead_man import DeadMan
from bridge.run.ending import Ending, described
from bridge.run.manual import Operator
from bridge.run.options import HostOptions
from bridge.run.recording import LogFailureRule
from bridge.run.summary import crash_summary, run_summary
from bridge.session.event_kinds import EventKind
from bridge.session.records import RoomRecord, RunInfo, Severity
from bridge.supervise import Supervisor
from tools.cli.cautions import cautions
from tools.cli.console import inform, is_drawable
from tools.cli.lan_risk import bus_risk
from tools.cli.options import DEFAULT_PLANNER
from tools.cli.recording import check_view, live_view
from tools.cli.remedies import with_remedy
from tools.cli.replaced_log import ReplacedLog
from tools.cli.signals import ending_signals
from tools.live.comparing import compared, start_checked
from tools.live.heading import LiveCoverage, RunFacts
from tools.live.live import LivePicture, Teller
from tools.live.operating import Operating
from tools.live.tables import status_line
from tools.live.terminal_keys import Keyboard
from tools.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.io.ports import BytePort
    from bridge.io.reopening import PortOptions
    from bridge.motion.robot_model import RobotModel
    from bridge.run.host import Host
    from bridge.run.mission import Resume
    from bridge.supervise import SuperviseSettings
    from protocol.values import OnboardPlanner
    from tools.live.terminal_keys import Key


_ANY_WIDTH = 10_000
"""Columns of a line that is not laid out: more than any."""
HAND_M_S = 0.15
"""Speed of a drive by hand, unless told otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """What a live run is asked for."""

    port: str
    log: Path
    model: RobotModel
    robot_toml: str
    plan: FloorPlan | None
    planner: str | None
    """Runs on the host."""
    onboard: OnboardPlanner | None
    """Runs on the device, and is supervised."""
    supervise: SuperviseSettings | None
    """Rules for a run that moves; None: nothing but the device's own watches it."""
    resume: Resume
    duration_s: float | None
    node: int | None
    opening: PortOptions
    clear_stop: bool
    force: bool
    drive: bool = False
    """By hand, from the beginning."""
    speed_m_s: float = HAND_M_S
    """Of the drive by hand."""
    gamepad: str | None = None
    key: bytes | None = None
    """Signs what moves the robot, where the device asks for it."""
    adapter_delay_ns: tuple[int, int] = (0, 0)
    """Declared of the way to the device and of the way back (:class:`HostOptions`)."""
    robot_file: bool = False
    """A robot file gave the model; else it is the default."""
    recording: RecordOptions = field(default_factory=RecordOptions)
    view: bool = False
    """Show the run live in Rerun."""
    serve: bool = False
    """... in a browser on this machine."""

    @property
    def planner_name(self) -> str | None:
        """Of whichever planner moves the robot."""
        if self.onboard is not None:
            return self.onboard.name.lower().replace("_", "-")
        return self.planner


@dataclass(frozen=True, slots=True)
class LiveResult:
    """How a live run ended."""

    summary: dict[str, Any]
    exit_status: int
    complaints: list[str]
    """Lines for people about what went wrong."""
    agreed: bool = True
    """A device was there; without one there is no log, and nothing to sum up."""


def run_live(asked: LiveOptions) -> LiveResult:
    """Run until the plan, the time, the device or a person ends it.

    Raises:
        PortError: the port cannot be opened; nothing was recorded.
        LogError: the log cannot be made; the robot was not spoken to.

    """
    check_view(view=asked.view, serve=asked.serve)
    operator = _operator(asked)
    opener = Opener(asked.port, asked.opening)
    opened = opener()
    replaced = ReplacedLog(asked.log, force=asked.force)
    try:
        recorder, offset_ns = _recorder(asked)
    except BaseException:
        opened.close()
        replaced.put_back()
        raise
    teller = Teller(recorder, plain=not is_drawable())
    teller.on_agreed = replaced.drop
    options = HostOptions(
        offset_ns,
        asked.planner_name or "",
        asked.plan.start if asked.plan else Pose2(0.0, 0.0, 0.0),
        asked.node,
        link_of(asked.port),
        asked.key,
        asked.adapter_delay_ns,
    )
    host = build_run(
        asked.model,
        teller,
        options,
        new_session_id,
        runner=operator if asked.drive or asked.planner is not None else None,
        onboard=asked.onboard,
        supervise=asked.supervise,
        clear_stop=asked.clear_stop,
        resume=asked.resume,
    )
    way = array("d")
    if asked.plan is not None:
        host.on_drive_pose = lambda time_s, pose: way.extend((time_s, *pose))
    pump = Pump(host, opened, opener)
    pump.watch = LogFailureRule(
        recorder,
        lambda severity, source, kind, text: host.event(clock.now(), severity, source, kind, text),
        stop_on_error=asked.recording.stop_on_error,
    )
    for source, text in cautions(asked.model, asked.plan):
        host.event(clock.now(), Severity.WARNING, source, EventKind.CAUTION, text)
    operating = _operating(asked, pump, operator)
    if asked.duration_s is not None:
        pump.end_after(asked.duration_s)
    try:
        with _endings(pump, operating, asked.gamepad):  # the summary too is written whole
            with (
                live_view(asked.log, view=asked.view, serve=asked.serve) as page,
                _owner(asked, pump, opened),
                compared(pump, asked.model, from_file=asked.robot_file),
                start_checked(pump, asked.model, asked.plan),
                _picture(pump, teller, operating, _facts(asked, page, way)),
            ):
                gc.freeze()  # what start-up left is not walked through again while driving
                pump.run()
            summary = _conclude(pump, asked, way)
            recorder.close(summary)
    finally:
        recorder.close()
        is_ours = not isinstance(recorder.error, LogGoneError)
        if host.hello is None and pump.crash is None and is_ours:
            _discard(asked.log)
            replaced.put_back()
        replaced.drop()
    return _result(host, asked, recorder, summary)


def _operator(asked: LiveOptions) -> Operator:
    """The person's hand in the run; it holds the plan, where there is one."""

    def make_plan() -> PlanRunner:
        name = asked.planner or DEFAULT_PLANNER
        return PlanRunner(make_planner(name, asked.model, np.random.default_rng()), asked.model)

    max_m_s = asked.model.max_speed_m_s
    return Operator(
        asked.model,
        DeadMan(max_m_s, min(asked.speed_m_s, max_m_s)),
        plan=make_plan() if asked.planner is not None else None,
        make_plan=None if asked.drive else make_plan,
        manual=asked.drive,
    )


def _operating(asked: LiveOptions, pump: Pump, operator: Operator) -> Operating:
    """The keys of this run."""
    host = pump.host

    def looked() -> None:
        host.go_on(clock.now())

    def begun() -> None:
        if asked.supervise is not None and host.supervision is None and not asked.drive:
            host.supervise(Supervisor(asked.model, asked.supervise))

    return Operating(
        pump,
        operator,
        go_on=lambda: pump.call(looked),
        on_start=lambda: pump.call(begun),
        clear_stop=asked.clear_stop,
    )


@contextlib.contextmanager
def _owner(asked: LiveOptions, pump: Pump, opened: BytePort) -> Iterator[None]:
    """Let other shells reach the robot through this run; say what is amiss with the port."""

    def warn(kind: EventKind, text: str) -> None:
        pump.host.event(clock.now(), Severity.WARNING, "link", kind, text)

    note = latency_note(opened)
    if note is not None:
        warn(EventKind.LATENCY, note)
    risk = bus_risk(asked.port, lan=asked.opening.lan, keyed=asked.key is not None)
    if risk is not None:
        warn(EventKind.LAN, risk)
    try:
        owner = OwnerSocket(asked.port, OwnerService(pump.host, pump))
    except BridgeError as error:
        warn(EventKind.NO_SOCKET, f"other shells cannot reach this run: {error}")
        yield
        return

    def reopened(name: str) -> None:
        try:
            owner.also(name)
        except OSError as error:
            warn(
                EventKind.NO_SOCKET,
                f"other shells cannot find this run under {name}: {error.strerror}",
            )

    pump.on_reopened = reopened
    with owner:
        yield


def _recorder(asked: LiveOptions) -> tuple[ThreadedRecorder, int]:
    """The log, opened, and the Unix offset that it was opened with."""
    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    info = RunInfo(
        asked.port,
        asked.planner_name or "",
        None,
        VERSION,
        opened_ns,
        offset_ns,
        asked.model,
        asked.robot_toml,
        asked.plan,
    )
    recorder = ThreadedRecorder(open_log(asked.log, info, asked.recording, force=asked.force))
    if asked.plan is not None:
        recorder.write(RoomRecord(opened_ns, asked.plan))
    return recorder, offset_ns


def _discard(log: Path) -> None:
    """Remove the log of a run that found no device to agree with; it holds nothing of a robot."""
    with contextlib.suppress(LogReadError, OSError):
        for part in parts_of(log):
            if part.is_file():  # a device file is not ours to remove
                part.unlink()


def _result(
    host: Host, asked: LiveOptions, recorder: ThreadedRecorder, summary: dict[str, Any]
) -> LiveResult:
    ending = host.mission.ending
    complaints = []
    if ending is not None and ending.exit_status:
        complaints.append(f"{asked.port}: {with_remedy(ending.reason, ending.remedy)}")
    if isinstance(recorder.error, LogGoneError):
        summary = {**summary, "log": None}
    if recorder.error is not None:
        complaints.append(str(recorder.error))
    if recorder.dropped:
        complaints.append(f"{recorder.dropped} records did not reach the log")
    status = ending.exit_status if ending else 1
    if recorder.error is not None and status == 0:
        status = 1  # the run did what it was to do, its log did not
    return LiveResult(summary, status, complaints, host.hello is not None)


@contextlib.contextmanager
def _endings(pump: Pump, operating: Operating, gamepad: str | None) -> Iterator[None]:
    """Turn signals into an orderly end, the robot stopped first; let keys and gamepad act.

    Afterwards they are ignored: nothing is left to end but the writing of log and summary.
    """

    def interrupted(number: int, _frame: object) -> None:
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        pump.request_end(Ending("stopped", f"ended by {name}", 0))

    numbers = ending_signals()
    for number in numbers:
        signal.signal(number, interrupted)
    try:
        with contextlib.ExitStack() as stack:
            if gamepad is not None:
                stack.enter_context(_gamepad(gamepad, operating))
            on_key = operating.on_key if is_drawable() else _answered(operating)
            # A terminal that is not drawn on is not asked about its keyboard either.
            keyboard = stack.enter_context(Keyboard(on_key, releases=is_drawable()))
            operating.dead_man.releases = keyboard.releases
            yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)


def _answered(operating: Operating) -> Callable[[Key], None]:
    """Handle keys and print what each came to: there is no picture to show it."""

    def on_key(key: Key) -> None:
        before = operating.message
        operating.on_key(key)
        if operating.message != before:
            inform(operating.message)

    return on_key


def _gamepad(path: str, operating: Operating) -> Gamepad:
    def sticks(now: Sticks) -> None:
        operating.dead_man.stick(now.ahead, now.turn, clock.now() / 1e9, held=now.held)

    return Gamepad(
        path,
        sticks,
        lambda: operating.stop("stopped by the gamepad's button"),
        on_gone=lambda: operating.pad_gone(path),
    )


def _facts(asked: LiveOptions, page: str, way: array[float]) -> RunFacts:
    """What the picture shows beside the robot."""
    coverage = None if asked.plan is None else LiveCoverage(asked.plan, asked.model, way)
    return RunFacts(
        asked.port, str(asked.log), page, asked.planner_name or "", asked.plan, coverage
    )


@contextlib.contextmanager
def _picture(pump: Pump, teller: Teller, operating: Operating, facts: RunFacts) -> Iterator[None]:
    host = pump.host
    if not is_drawable():
        # In the loop's thread, which makes the records.
        teller.status = lambda: status_line(host.snapshot())
        if Keyboard.possible():
            inform(operating.help(_ANY_WIDTH))
        yield
        return
    picture = LivePicture(
        lambda: pump.snapshot, teller, operating if Keyboard.possible() else None, facts
    )
    picture.start()
    try:
        yield
    finally:
        picture.stop()


def _conclude(pump: Pump, asked: LiveOptions, way: array[float]) -> dict[str, Any]:
    """The last map and the run's summary; after a crash as much as the failed parts still give."""
    host = pump.host
    try:
        if host.drive_pose is not None:
            host.record_map(clock.now())
        return _summarise(host, asked, way)
    except Exception as error:
        if pump.crash is None:
            raise
        text = f"no summary after the crash: {described(error)}"
        with contextlib.suppress(Exception):  # the record may be what has failed
            host.event(clock.now(), Severity.WARNING, "session", EventKind.NO_SUMMARY, text)
        return crash_summary(
            host,
            room=asked.plan.name if asked.plan else None,
            planner=asked.planner_name,
            seed=None,
            log=str(asked.log),
        )


def _summarise(host: Host, asked: LiveOptions, way: array[float]) -> dict[str, Any]:
    report, plan = None, asked.plan
    if plan is not None and way:
        from bridge.evaluation.metrics import CoverageMeter

        runner = host.mission.runner
        lanes_m = runner.lane_length_m if runner and asked.onboard is None else None
        meter = CoverageMeter(plan, asked.model)
        rows = iter(way)
        report = meter.measure(zip(rows, rows, rows, rows, strict=True), lanes_m)
    return run_summary(
        host,
        room=plan.name if plan else None,
        planner=asked.planner_name,
        seed=None,
        log=None if host.hello is None else str(asked.log),
        report=report,
    )

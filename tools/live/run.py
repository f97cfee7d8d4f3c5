"""A live run on a port: open the port, record, show, end and summarise the run."""

from __future__ import annotations

import contextlib
import gc
import signal
from array import array
from dataclasses import dataclass, field, replace
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
from bridge.record.sink import NullSink
from bridge.run.build import build_run
from bridge.run.dead_man_switch import DeadManSwitch
from bridge.run.ending import Ending, described
from bridge.run.log_failure import LogFailureRule
from bridge.run.manual import Operator
from bridge.run.notices import NoticeSink
from bridge.run.options import HostOptions
from bridge.run.summary import crash_summary, run_summary
from bridge.session.event_kinds import EventKind
from bridge.session.records import RoomRecord, RunInfo, Severity
from bridge.supervise import Supervisor
from bridge.supervise.settings import BatteryRule
from tools.cli.cautions import cautions
from tools.cli.console import inform, is_drawable
from tools.cli.foxglove import live_foxglove, run_parameters
from tools.cli.lan_risk import bus_risk
from tools.cli.on_event import EventCommands
from tools.cli.planners import DEFAULT_PLANNER
from tools.cli.recording import check_view, live_view
from tools.cli.remedies import with_remedy
from tools.cli.replaced_log import ReplacedLog
from tools.cli.signals import ending_signals
from tools.live.comparing import compared, start_checked
from tools.live.heading import LiveCoverage, RunFacts
from tools.live.live import Dashboard, EventLines
from tools.live.operating import Operating
from tools.live.shared import SharedPage
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
    from bridge.view.foxglove.publisher import FoxglovePublisher
    from protocol.messages.values import OnboardPlanner
    from tools.cli.on_event import Commands
    from tools.live.terminal_keys import Key


_REPORT_S = 1.0
"""Maximum time for the loop to record that a command failed, s."""
_ANY_WIDTH = 10_000
"""Width of a line that is not shortened, columns. Every line is shorter."""
HAND_M_S = 0.15
"""Default speed of manual driving, m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions:
    """Options of a live run."""

    port: str
    log: Path | None
    """Log file; None: the run is not recorded."""
    model: RobotModel
    robot_toml: str
    """Text of the robot file, for the log."""
    plan: FloorPlan | None
    """The room, if it is known."""
    planner: str | None
    """Planner on the host; None: no planner."""
    onboard: OnboardPlanner | None
    """Planner on the device, which the host supervises; None: no planner."""
    supervise: SuperviseSettings | None
    """Rules for a run that moves; None: the host does not supervise it."""
    resume: Resume
    """Reaction to the return of a lost device."""
    duration_s: float | None
    """Time after which the run ends, s; None: no limit."""
    node: int | None
    """Node number of the device; None: the only one."""
    opening: PortOptions
    clear_stop: bool
    """A start may clear a latched safety stop."""
    force: bool
    """Replace an existing log."""
    drive: bool = False
    """Begin with manual driving."""
    speed_m_s: float = HAND_M_S
    """Speed of manual driving, m/s."""
    gamepad: str | None = None
    """Joystick device; None: no gamepad."""
    key: bytes | None = None
    """Key that signs motion commands, if the device requires it."""
    adapter_delay_ns: tuple[int, int] = (0, 0)
    """Declared minimum delay to the device and from it, ns (:class:`HostOptions`)."""
    robot_file: bool = False
    """The model is from a robot file; else it is the default."""
    recording: RecordOptions = field(default_factory=RecordOptions)
    view: bool = False
    """Show the run live in Rerun."""
    serve: bool = False
    """Show the run live in a browser on this machine."""
    quiet: bool = False
    """Print no line with the state every 5 s if there is no terminal."""
    foxglove: tuple[str, int] | None = None
    """Address on which the run is served to Foxglove; None: the run is not served."""
    on_events: Commands = ()
    """Commands that the run starts at its events."""
    battery: BatteryRule = field(default_factory=BatteryRule)
    """Limits of a low battery, for ``on_events``."""

    @property
    def planner_name(self) -> str | None:
        """Name of the planner that moves the robot, on the host or the device."""
        if self.onboard is not None:
            return self.onboard.name.lower().replace("_", "-")
        return self.planner


@dataclass(frozen=True, slots=True)
class LiveResult:
    """How a live run ended."""

    summary: dict[str, Any]
    exit_status: int
    complaints: list[str]
    """Lines about failures."""
    negotiated: bool = True
    """The handshake succeeded; otherwise there is no log and nothing to sum up."""


def run_live(asked: LiveOptions) -> LiveResult:
    """Run until the plan, the duration, the device or a person ends the run.

    Raises:
        PortError: the port cannot be opened; nothing was recorded.
        LogError: the log cannot be made; nothing was sent to the robot.
        FoxgloveServerError: Foxglove cannot be served; nothing was sent to the robot.

    """
    check_view(view=asked.view, serve=asked.serve)
    parameters = run_parameters(asked.robot_toml, port=asked.port, planner=asked.planner_name)
    with live_foxglove(asked.foxglove, parameters) as publisher:
        return _run(asked, publisher)


def _run(asked: LiveOptions, publisher: FoxglovePublisher | None) -> LiveResult:
    """Run; ``publisher`` gets the chunks of the log."""
    opener = Opener(asked.port, asked.opening)
    opened = opener()
    with _ending_signals() as signals:  # a signal must not interrupt log and summary
        return _run_on(asked, publisher, opener, opened, signals)


def _run_on(
    asked: LiveOptions,
    publisher: FoxglovePublisher | None,
    opener: Opener,
    opened: BytePort,
    signals: _EndingSignals,
) -> LiveResult:
    """Run on an open port until a signal or another event ends the run."""
    operator = _operator(asked)
    replaced = ReplacedLog(asked.log, force=asked.force)
    try:
        recorder, offset_ns = _recorder(asked, publisher)
    except BaseException:
        opened.close()
        replaced.put_back()
        raise
    events = EventLines(recorder, plain=not is_drawable())
    events.on_ready = replaced.drop
    late: list[str] = []

    def report(text: str) -> None:
        try:
            pump.call(
                lambda: host.event(
                    clock.now(), Severity.WARNING, "on", EventKind.COMMAND_FAILED, text
                )
            ).result(_REPORT_S)
        except (BridgeError, TimeoutError):  # the loop has ended
            late.append(text)

    commands = EventCommands(asked.on_events, _on_facts(asked), report)
    notices = NoticeSink(events, asked.model, asked.battery, commands.notify)
    options = HostOptions(
        offset_ns,
        asked.planner_name or "",
        asked.plan.start if asked.plan else Pose2(0.0, 0.0, 0.0),
        asked.node,
        link_of(asked.port),
        asked.key,
        asked.adapter_delay_ns,
        plan=asked.plan,
    )
    host = build_run(
        asked.model,
        notices,
        options,
        new_session_id,
        runner=operator if asked.drive or asked.planner is not None else None,
        onboard=asked.onboard,
        supervise=asked.supervise,
        clear_stop=asked.clear_stop,
        resume=asked.resume,
    )
    path = array("d")
    facts = _facts(asked, path)

    host.on_drive_pose = _keep_path(asked, facts, path)
    pump = Pump(host, opened, opener)
    pump.watch = LogFailureRule(
        recorder,
        lambda severity, source, kind, text: host.event(clock.now(), severity, source, kind, text),
        stop_on_error=asked.recording.stop_on_error,
    )
    for source, text in cautions(asked.model, asked.plan):
        host.event(clock.now(), Severity.WARNING, source, EventKind.CAUTION, text)
    signals.end_by(pump.request_end)
    operating = _operating(asked, pump, operator)
    facts.foxglove = "" if publisher is None else publisher.address
    if asked.duration_s is not None:
        pump.end_after(asked.duration_s)
    with commands:
        try:
            with _inputs(operating, asked.gamepad):
                with (
                    live_view(asked.log, view=asked.view, serve=asked.serve) as facts.page,
                    _owner(asked, pump, opened, SharedPage(events, facts)),
                    compared(pump, asked.model, from_file=asked.robot_file),
                    start_checked(pump, asked.model, asked.plan),
                    _dashboard(pump, events, operating, facts, quiet=asked.quiet),
                ):
                    gc.freeze()  # the collector skips the objects of the start-up during the run
                    pump.run()
                summary = _conclude(pump, asked, path)
                recorder.close(summary)
        finally:
            _close_log(asked, recorder, pump, replaced)
        result = _result(host, asked, recorder, summary)
        if host.mission.ending is not None:
            notices.finish(host.mission.ending, result.exit_status, result.summary)
    return replace(result, complaints=[*result.complaints, *late])


def _on_facts(asked: LiveOptions) -> dict[str, Any]:
    """Return the data about the run that every event of ``--on`` contains."""
    return {"port": asked.port, "log": _text(asked.log)}


def _text(log: Path | None) -> str | None:
    return None if log is None else str(log)


def _operator(asked: LiveOptions) -> Operator:
    """Make the runner that switches between a plan and manual driving."""

    def make_plan() -> PlanRunner:
        name = asked.planner or DEFAULT_PLANNER
        return PlanRunner(make_planner(name, asked.model, np.random.default_rng()), asked.model)

    max_m_s = asked.model.max_speed_m_s
    return Operator(
        asked.model,
        DeadManSwitch(max_m_s, min(asked.speed_m_s, max_m_s)),
        plan=make_plan() if asked.planner is not None else None,
        make_plan=None if asked.drive else make_plan,
        manual=asked.drive,
    )


def _operating(asked: LiveOptions, pump: Pump, operator: Operator) -> Operating:
    """Make the handler of the keys."""
    host = pump.host

    def resume() -> None:
        host.resume_run(clock.now())

    def begun() -> None:
        if asked.supervise is not None and host.supervision is None and not asked.drive:
            host.supervise(Supervisor(asked.model, asked.supervise))

    return Operating(
        pump,
        operator,
        on_resume=lambda: pump.call(resume),
        on_start=lambda: pump.call(begun),
        clear_stop=asked.clear_stop,
    )


@contextlib.contextmanager
def _owner(asked: LiveOptions, pump: Pump, opened: BytePort, page: SharedPage) -> Iterator[None]:
    """Let other shells reach the robot through this run, and warn about the port."""

    def warn(kind: EventKind, text: str) -> None:
        pump.host.event(clock.now(), Severity.WARNING, "link", kind, text)

    note = latency_note(opened)
    if note is not None:
        warn(EventKind.LATENCY, note)
    risk = bus_risk(asked.port, lan=asked.opening.lan, keyed=asked.key is not None)
    if risk is not None:
        warn(EventKind.LAN, risk)
    try:
        owner = OwnerSocket(asked.port, OwnerService(pump.host, pump, page))
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
                f"other shells cannot reach this run by the name {name}: {error.strerror}",
            )

    pump.on_reopened = reopened
    with owner:
        yield


def _recorder(
    asked: LiveOptions, publisher: FoxglovePublisher | None
) -> tuple[ThreadedRecorder, int]:
    """Open the log; return its recorder and the offset from host time to Unix time, ns."""
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
    if asked.log is None:
        return ThreadedRecorder(NullSink()), offset_ns
    writer = open_log(asked.log, info, asked.recording, force=asked.force, tap=publisher)
    recorder = ThreadedRecorder(writer)
    if asked.plan is not None:
        recorder.write(RoomRecord(opened_ns, asked.plan))
    return recorder, offset_ns


def _close_log(
    asked: LiveOptions, recorder: ThreadedRecorder, pump: Pump, replaced: ReplacedLog
) -> None:
    """Close the log; if no robot was recorded, restore the log that it replaced."""
    recorder.close()
    is_ours = not isinstance(recorder.error, LogGoneError)
    if pump.host.hello is None and pump.crash is None and is_ours and asked.log is not None:
        _discard(asked.log)
        replaced.put_back()
    replaced.drop()


def _discard(log: Path) -> None:
    """Remove the log of a run without a handshake, because it contains no data of a robot."""
    with contextlib.suppress(LogReadError, OSError):
        for part in parts_of(log):
            if part.is_file():  # never remove a device file such as /dev/null
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
        lost = f"{recorder.dropped} records were lost"
        if recorder.error is None:
            complaints.append(f"{lost}: the disk is too slow")
        else:  # those of the chunk that could not be written are not counted
            complaints.append(f"more than {lost}")
    status = ending.exit_status if ending else 1
    if recorder.error is not None and status == 0:
        status = 1  # the run succeeded, but its log is incomplete
    return LiveResult(summary, status, complaints, host.hello is not None)


class _EndingSignals:
    """The signals that end a run; a signal before the start ends the run as it starts."""

    def __init__(self) -> None:
        self._first: Ending | None = None
        self._end: Callable[[Ending], object] = lambda _ending: None

    def received(self, number: int, _frame: object) -> None:
        """Handle a signal."""
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        self._first = self._first or Ending("stopped", f"ended by {name}", 0)
        self._end(self._first)

    def end_by(self, end: Callable[[Ending], object]) -> None:
        """Call ``end`` at a signal, also if the signal was received before this call."""
        self._end = end
        if self._first is not None:
            end(self._first)


@contextlib.contextmanager
def _ending_signals() -> Iterator[_EndingSignals]:
    """Make signals end the run instead of the process; afterwards the signals are ignored."""
    signals, numbers = _EndingSignals(), ending_signals()
    for number in numbers:
        signal.signal(number, signals.received)
    try:
        yield signals
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)


@contextlib.contextmanager
def _inputs(operating: Operating, gamepad: str | None) -> Iterator[None]:
    """Handle keys and gamepad during a run."""
    with contextlib.ExitStack() as stack:
        if gamepad is not None:
            stack.enter_context(_gamepad(gamepad, operating))
        on_key = operating.on_key if is_drawable() else _answered(operating)
        # Without a dashboard the terminal gets no control sequences, so also no query.
        keyboard = stack.enter_context(Keyboard(on_key, releases=is_drawable()))
        operating.dead_man_switch.releases = keyboard.releases
        yield


def _answered(operating: Operating) -> Callable[[Key], None]:
    """Return a key handler that prints the effect of each key, for a run without a dashboard."""

    def on_key(key: Key) -> None:
        before = operating.message
        operating.on_key(key)
        if operating.message != before:
            inform(operating.message)

    return on_key


def _gamepad(path: str, operating: Operating) -> Gamepad:
    def sticks(now: Sticks) -> None:
        operating.dead_man_switch.stick(now.ahead, now.turn, clock.now() / 1e9, held=now.held)

    return Gamepad(
        path,
        sticks,
        lambda: operating.stop("stopped by the gamepad's button"),
        on_gone=lambda: operating.pad_gone(path),
    )


def _keep_path(
    asked: LiveOptions, facts: RunFacts, path: array[float]
) -> Callable[[float, Pose2], None]:
    """Return a function that appends a pose to the drawn path and to the path of the report."""

    def keep(time_s: float, pose: Pose2) -> None:
        facts.follow(pose.x_m, pose.y_m)
        if asked.plan is not None:
            path.extend((time_s, *pose))

    return keep


def _facts(asked: LiveOptions, path: array[float]) -> RunFacts:
    """Return the facts of the run for the heading of the dashboard."""
    coverage = None if asked.plan is None else LiveCoverage(asked.plan, asked.model, path)
    return RunFacts(
        asked.port,
        _text(asked.log) or "",
        planner=asked.planner_name or "",
        plan=asked.plan,
        coverage=coverage,
        began_ns=clock.now(),
    )


@contextlib.contextmanager
def _dashboard(
    pump: Pump, events: EventLines, operating: Operating, facts: RunFacts, *, quiet: bool
) -> Iterator[None]:
    host = pump.host
    if not is_drawable():
        # Called in the loop's thread, which writes the records.
        if not quiet:
            events.status = lambda: status_line(host.snapshot())
        if Keyboard.possible():
            inform(operating.help(_ANY_WIDTH))
        yield
        return
    dashboard = Dashboard(
        lambda: pump.snapshot, events, operating if Keyboard.possible() else None, facts
    )
    dashboard.start()
    try:
        yield
    finally:
        dashboard.stop()


def _conclude(pump: Pump, asked: LiveOptions, path: array[float]) -> dict[str, Any]:
    """Record the last map and return the summary; after a crash, the available part of it."""
    host = pump.host
    try:
        if host.drive_pose is not None:
            host.record_map(clock.now())
        return _summarise(host, asked, path)
    except Exception as error:
        if pump.crash is None:
            raise
        text = f"no summary after the crash: {described(error)}"
        with contextlib.suppress(Exception):  # the recording itself may have failed
            host.event(clock.now(), Severity.WARNING, "session", EventKind.NO_SUMMARY, text)
        return crash_summary(
            host,
            room=asked.plan.name if asked.plan else None,
            planner=asked.planner_name,
            seed=None,
            log=_text(asked.log),
        )


def _summarise(host: Host, asked: LiveOptions, path: array[float]) -> dict[str, Any]:
    report, plan = None, asked.plan
    if plan is not None and path and host.plausibility.placed:
        from bridge.evaluation.metrics import CoverageMeter

        runner = host.mission.runner
        lanes_m = runner.lane_length_m if runner and asked.onboard is None else None
        meter = CoverageMeter(plan, asked.model)
        rows = iter(path)
        report = meter.measure(zip(rows, rows, rows, rows, strict=True), lanes_m)
    return run_summary(
        host,
        room=plan.name if plan else None,
        planner=asked.planner_name,
        seed=None,
        log=None if host.hello is None else _text(asked.log),
        report=report,
    )

"""The host's core: session, time, estimate, run and records joined; sans-I/O.

Bytes and host time go in, bytes and records come out. The same object runs in virtual time
against the emulated device, over a pseudo-terminal, and on a robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bridge.coverage.swept_map import SweptMap
from bridge.errors import Remedy
from bridge.motion.observation import HALT
from bridge.run.commands import Dialogue, carry_out
from bridge.run.ending import Ending
from bridge.run.localisation import Localisation
from bridge.run.mission import Mission, Phase, Request
from bridge.run.onboard_mission import OnboardMission
from bridge.run.pings import Pings
from bridge.run.recording import HostRecords
from bridge.run.robot_state import STALE_S, missing_needs, understood
from bridge.run.runner import hold, release
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
from bridge.run.supervision import End, Note, Plan, Supervision
from bridge.session.event_kinds import EventKind
from bridge.session.ingest import Ingest
from bridge.session.link_stats import WireStatistics
from bridge.session.records import Severity
from bridge.session.session import Session
from bridge.session.states import (
    Agreed,
    CommandEnded,
    Data,
    Failed,
    Ping,
    Restless,
    SessionEvent,
    State,
    StateChanged,
)
from bridge.session.timesync import TimeSync
from bridge.supervise import RuleInputs
from protocol.clock import DeviceUs, HostNs
from protocol.link import Medium, Rejected
from protocol.messages import (
    Encoders,
    Imu,
    LogText,
    ParameterValue,
    PlannerState,
    Power,
    Range,
    Status,
    TimeReply,
)
from protocol.uart.framing import DamagedFrame
from protocol.values import Mode, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.estimation.estimator import PoseEstimator
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import VelocityCommand
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.run.options import HostOptions
    from bridge.run.robot_state import RobotState
    from bridge.supervise import Supervisor
    from protocol.commands import Outcome
    from protocol.messages import Hello
    from protocol.schema.message import Message

CONTROL_PERIOD_NS = 20_000_000
SETPOINT_TTL_MS = 200
"""Ten control periods, below the device's limit of 250."""
LATE_NS = 50_000_000
"""A control step later than this drives nothing: a blocked host must not jump."""
SILENT_NS = 100_000_000
"""Ten frames of the quickest stream: the wire is silent, not one of the sensors."""
MAP_PERIOD_NS = 2_000_000_000
CLOCK_PERIOD_NS = 1_000_000_000
COUNT_PERIOD_NS = 100_000_000
"""Time between two copies of the link's counts for other threads, ns: a person reads no more."""
_AFTER_SILENCE_NS = round(STALE_S * 1e9)
_EXIT = {EventKind.DISAGREEMENT: 4, EventKind.VERSION: 4, EventKind.SEVERAL: 2}


class Host:
    """One robot's host end, from opening the session to the end of the run."""

    def __init__(
        self,
        model: RobotModel,
        sink: Sink,
        options: HostOptions,
        mission: Mission,
        new_session_id: Callable[[], int],
    ) -> None:
        """Make everything, closed; :meth:`open` begins."""
        self.model = model
        self.localisation = Localisation(model, options.start)
        self.mission = mission
        self.session = Session(
            new_session_id, node=options.node, link=options.link, key=options.key
        )
        self.commands = Dialogue(self.session)
        self.ingest = Ingest(TimeSync(*options.min_delay_ns), options.unix_offset_ns)
        self.swept = SweptMap(model)
        self.hello: Hello | None = None
        self.path_m = 0.0
        self.drive_pose: Pose2 | None = None
        """Estimate at the newest control step of the drive; None: it has not begun."""
        self.supervision: Supervision | None = None
        """Of the run, where it is supervised."""
        self.on_drive_pose: Callable[[float, Pose2], None] = lambda _time_s, _pose: None
        """Told time (s, host) and estimate of every control step of the drive."""
        self.wire = WireStatistics()
        self._pings = Pings(self.wire, sum(options.min_delay_ns), self.event)
        self._sink = sink
        bus = self.session.link.medium is Medium.CAN
        self._records = HostRecords(sink, options.unix_offset_ns, options.planner, bus=bus)
        self._tap = self._records.can if bus else self._records.uart
        """Puts on record exactly what the port gave or takes."""
        self._control_ns = HostNs(0)
        self._map_ns = 0
        self._clock_ns = 0
        self._silent_ns = 0
        """When the wire was last found silent."""
        self._counts: LinkSnapshot | None = None
        self._counted_ns = 0
        """When the link's counts were last copied."""
        self._slow = False
        """The link was last found too slow to drive over."""
        self.mission.link = self.session.round_trip.trouble(HostNs(0))
        self._jumps = 0
        """Jumps of the device's clock that the estimate knows of."""
        self._missing: list[str] = []
        """What driving needs and the device does not share."""
        self._partial = True
        """Messages may come without some of the fields that we know."""
        self._listeners: dict[type[Message], Callable[[Any, DeviceUs, HostNs], None]] = {
            Imu: self.localisation.imu,
            Encoders: self.localisation.encoders,
            Range: self._range,
            Power: self.localisation.keep,
            PlannerState: self.localisation.keep,
            Status: self._status,
            LogText: self._log_text,
            ParameterValue: self.commands.parameter,
            TimeReply: self.localisation.time_reply,
        }

    @property
    def sync(self) -> TimeSync:
        """Maps the device's clock to ours."""
        return self.ingest.sync

    @property
    def state(self) -> RobotState:
        """The newest of everything that the device has sent."""
        return self.localisation.state

    @property
    def estimator(self) -> PoseEstimator:
        """The estimate of pose; another object after the device booted anew."""
        return self.localisation.estimator

    # ---- in and out -----------------------------------------------------------------------

    def open(self, now_ns: HostNs) -> None:
        """Start to look for the device."""
        self._control_ns = now_ns
        self.session.open(now_ns)
        # On record at this moment, not at that of the first bytes: the session's times begin here.
        self._digest(self.session.receive(b"", now_ns), now_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Take bytes from the port."""
        if not data:
            return
        try:
            events = self.session.receive(data, now_ns)
            self._digest(events, now_ns)
        finally:  # somebody may wait for an answer among them, and nobody for the log
            self._tap(data, now_ns, outgoing=False)
        self.wire.hear((events, now_ns))

    def poll(self, now_ns: HostNs) -> None:
        """Do what time asks for, the control step included."""
        events = self.session.poll(now_ns)
        if events:
            self._digest(events, now_ns)
        elif self.mission.pending:
            self._serve(now_ns)
        if now_ns >= self._control_ns:
            late_ns = now_ns - self._control_ns
            self._control_ns = HostNs(self._control_ns + CONTROL_PERIOD_NS)
            if late_ns > LATE_NS:
                self._control_ns = HostNs(now_ns + CONTROL_PERIOD_NS)
                self._silent_ns = now_ns  # what came meanwhile may be lost, or still unread
                text = f"the host was held up for {late_ns / 1e6:.0f} ms; this step drives nothing"
                self.event(now_ns, Severity.WARNING, "session", EventKind.LATE, text)
            else:
                self._control(now_ns)
        self._records.flush(now_ns, at_once=self.mission.done)
        if now_ns >= self._clock_ns:
            self._clock_ns = now_ns + CLOCK_PERIOD_NS
            self.wire.count(self.sync)
            if self.hello is not None:
                self._records.clock(self.sync, self.hello, now_ns)
                self._records.link(self.wire, now_ns)

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Bytes for the port; the caller writes them at once."""
        data = self.session.link.data_to_send()
        self.sent(data, now_ns)
        return data

    def sent(self, data: bytes, now_ns: HostNs) -> None:
        """Take what :attr:`session` gave for the port as written, which puts it on record."""
        if data:
            self._tap(data, now_ns, outgoing=True)

    def discard_output(self) -> None:
        """Forget what waits to be written: there is no port, and it must not come late."""
        self.session.data_to_send()

    def next_deadline(self) -> HostNs:
        """When :meth:`poll` has work next."""
        deadline = self.session.next_deadline()
        if deadline is None or self._control_ns < deadline:
            return self._control_ns
        return deadline

    def snapshot(self, now_ns: int | None = None) -> Snapshot:
        """What is known now, for other threads; asked in the loop's thread.

        The link's counts are copied every 0.1 s, or at every call without a time.
        """
        state, mission, session, estimator = self.state, self.mission, self.session, self.estimator
        if now_ns is None or now_ns >= self._counted_ns + COUNT_PERIOD_NS or self._counts is None:
            self._counted_ns = now_ns or 0
            counts = session.link.statistics
            self._counts = LinkSnapshot(replace(counts, by_type=dict(counts.by_type)))
        runner, supervision = mission.runner, self.supervision
        return Snapshot(
            self.model,
            StateSnapshot(
                state.imu,
                state.encoders,
                state.range,
                state.power,
                state.status,
                state.planner,
                dict(state.arrived_s),
            ),
            MissionSnapshot(
                mission.phase,
                mission.ending,
                None
                if runner is None
                else RunnerSnapshot(runner.state, runner.turns, runner.lane_length_m),
                mission.asking,
                mission.link,
                mission.ends_s,
            ),
            SessionSnapshot(session.state, session.node, self._counts, session.signs),
            EstimatorSnapshot(estimator.pose, estimator.v_m_s, estimator.yaw_rate_rad_s),
            SyncSnapshot(self.sync.round_trip_ns, self.sync.fit),
            self.hello,
            self.path_m,
            supervision is not None and supervision.supervisor.holding,
            self.swept,
        )

    def supervise(self, supervisor: Supervisor) -> None:
        """Have the run supervised from its next control step on."""
        mission = self.mission
        onboard = mission.planner if isinstance(mission, OnboardMission) else None
        self.supervision = Supervision(supervisor, self.model, self.commands, onboard)

    def go_on(self, now_ns: HostNs) -> bool:
        """Let a run go on that lost its device, or that was paused: a person has looked.

        False where nothing waits for that.
        """
        paused = self.supervision is not None and self.supervision.resume(now_ns)
        self._obey_supervision(now_ns)
        return self.mission.resume(now_ns / 1e9) or paused

    def end(self, ending: Ending, now_ns: HostNs) -> None:
        """Ask for an orderly end: the robot stops first."""
        if self.session.state is State.READY:
            self.mission.request_end(ending, now_ns / 1e9)
        elif ending.outranks(self.mission.ending):
            if self.hello is not None:  # not heard is not the same as not hearing
                self.session.stop(ending.cause, now_ns)
            self.mission.end_unheard(ending, now_ns / 1e9)
        self._serve(now_ns)

    # ---- events of the session ------------------------------------------------------------

    def _digest(self, events: list[SessionEvent], now_ns: HostNs) -> None:
        ingest, listeners = self.ingest, self._listeners
        take, write = ingest.take, self._sink.write
        damaged: list[DamagedFrame] = []
        for event in events:
            if event.__class__ is Data:  # nearly all of them
                received = event[0]
                write(take(received, now_ns))
                message = received[0]
                listener = listeners.get(message.__class__)
                if listener is not None and (not self._partial or understood(message)):
                    listener(message, ingest.device_us, now_ns)
            elif event.__class__ is DamagedFrame:  # of noise there may be ten times as many
                damaged.append(event)
            else:
                self._happened(event, now_ns)
        if damaged:
            self._records.damaged(damaged, now_ns)
        if self.mission.pending:
            self._serve(now_ns)

    def _happened(self, event: SessionEvent, now_ns: HostNs) -> None:
        match event:
            case CommandEnded():  # first, for somebody waits for it
                if not self.commands.ended(event.outcome):
                    self._answered(event.outcome, now_ns)
                self._obey_supervision(now_ns)
            case Ping():
                self._pings.take(event, self.ingest, now_ns)
            case StateChanged():
                self._changed(event, now_ns)
            case Agreed():
                self._agreed(event, now_ns)
            case Failed():
                self.event(now_ns, Severity.ERROR, "session", event.kind, event.text)
                status = _EXIT.get(event.kind, 3)
                remedy = Remedy.NODE if event.kind is EventKind.SEVERAL else None
                if self.mission.under_way:  # whoever is there now, and whatever it understands
                    self.session.stop(StopCause.LINK, now_ns)
                self.mission.on_failed(event.text, status, now_ns / 1e9, remedy)
            case Restless():
                self.event(now_ns, Severity.WARNING, "session", EventKind.RESTLESS, event.text)
            case Rejected():
                self._records.rejected(event, now_ns)

    def _serve(self, now_ns: HostNs) -> None:
        for request in self.mission.requests():
            self._request(request, now_ns)

    def _request(self, request: Request, now_ns: HostNs) -> None:
        if self.supervision is not None and request.kind == "stop":
            self.supervision.stopping(now_ns)
        carry_out(request, self.session, now_ns)
        ending = self.mission.ending
        if request.kind == "stop" and ending is not None:
            severity = Severity.INFO if ending.exit_status == 0 else Severity.ERROR
            cause = label(StopCause, request.value)
            self.event(now_ns, severity, "safety", EventKind.STOP, ending.reason, cause=cause)

    def _answered(self, outcome: Outcome, now_ns: HostNs) -> None:
        mission, supervision = self.mission, self.supervision
        if (
            supervision is None
            or mission.phase is not Phase.ENDING
            or not supervision.keeps(outcome, mission.stop_cause, now_ns)
        ):
            mission.on_command(outcome, now_ns / 1e9)

    def _changed(self, event: StateChanged, now_ns: HostNs) -> None:
        bad = event.new in {State.LOST, State.FAILED}
        self.event(
            now_ns,
            Severity.WARNING if bad else Severity.INFO,
            "session",
            EventKind(event.new.value),
            event.why,
        )
        if event.old is State.READY:
            self.state.forget()
            self.commands.lost()
            self.mission.on_lost(now_ns / 1e9)

    def _agreed(self, event: Agreed, now_ns: HostNs) -> None:
        self.hello = event.hello
        self._records.identity(event, now_ns)
        self._partial = bool(event.differences)
        if event.again:
            self._records.again(event, now_ns)
        if event.rebooted:
            self.ingest.reset()
            self.commands.forget()
            self.localisation.begin_again()
        for difference in event.differences:
            self.event(now_ns, Severity.WARNING, "session", EventKind.SCHEMA, difference.report())
        self._missing = missing_needs(event.differences)
        self.mission.link = self.session.round_trip.trouble(now_ns)
        self.mission.on_ready(now_ns / 1e9)
        if self.mission.asking:
            self._records.asking(now_ns)
        self._check_needs(now_ns)

    def _check_needs(self, now_ns: HostNs) -> None:
        if self._missing and self.mission.runner is not None and self.mission.ending is None:
            text = f"the device cannot be driven: it lacks {', '.join(self._missing)}"
            self.mission.request_end(Ending("fault", text, 4), now_ns / 1e9)

    def _range(self, message: Range, device_us: DeviceUs, now_ns: HostNs) -> None:
        fresh = self.state.take(message, device_us, now_ns / 1e9)
        if fresh and self.mission.phase is Phase.DRIVING:
            self.localisation.see_walls(message, device_us)

    def _log_text(self, message: LogText, device_us: DeviceUs, now_ns: HostNs) -> None:  # noqa: ARG002 - of every listener
        self._records.log_text(message, now_ns)

    def _status(self, status: Status, device_us: DeviceUs, now_ns: HostNs) -> None:
        self.state.take(status, device_us, now_ns / 1e9)
        self._records.status(status, now_ns)
        self._check_needs(now_ns)
        self.mission.on_status(status, now_ns / 1e9)

    # ---- control --------------------------------------------------------------------------

    def _control(self, now_ns: HostNs) -> None:
        now_s = now_ns / 1e9
        estimator, mission = self.estimator, self.mission
        pose = estimator.pose
        obs = self.state.observation(
            now_s,
            pose,
            estimator.v_m_s,
            estimator.yaw_rate_rad_s,
            estimator.gyro_bias_sigma_rad_s,
            self.localisation.heading_sigma_rad,
        )
        stale = self._stale(now_ns)
        if self._is_silent(now_ns):
            obs = stale = None
        was = mission.phase
        self._judge_link(now_ns)
        command = mission.step(obs, stale, now_s)
        if self.supervision is not None:
            command = self._supervised(self.supervision, command, now_ns)
        if command is not None and self.session.state is State.READY:
            self.session.setpoint(command.v_m_s, command.yaw_rate_rad_s, SETPOINT_TTL_MS, now_ns)
            target = HALT if mission.runner is None else mission.runner.target
            self._records.command(command, target, now_ns)
        if obs is not None:
            self._records.pose(pose, estimator, now_ns)
            self._records.disturbances(estimator.disturbances, now_ns)
        if was is Phase.DRIVING:
            self._driven(pose, now_ns)
        if mission.runner is not None:
            self._records.plan(mission.runner, now_ns)
        if mission.phase is not was:
            phase = mission.phase.value
            text = f"run is {phase}"
            self.event(now_ns, Severity.INFO, "session", EventKind.PHASE, text, phase=phase)
        if mission.pending:
            self._serve(now_ns)

    def _supervised(
        self, supervision: Supervision, command: VelocityCommand | None, now_ns: HostNs
    ) -> VelocityCommand | None:
        """Let supervision judge a control step; the velocity to send."""
        mission, state, estimator = self.mission, self.state, self.estimator
        if isinstance(mission, OnboardMission) and state.planner is not None:
            mission.on_planner(state.planner)
        onboard = supervision.onboard
        if mission.phase is not Phase.DRIVING:
            supervision.rest(now_ns)
        else:
            inputs = RuleInputs(
                now_ns / 1e9,
                estimator.pose,
                estimator.v_m_s,
                estimator.yaw_rate_rad_s,
                estimator.wheel_scale,
                self.session.heard_ns / 1e9,
                None if self.hello is None else self.hello.boot_id,
                state.imu,
                state.encoders,
                state.range,
                state.power,
                state.status,
                state.planner,
                state.arrived_s,
                supervision.command if onboard is None else None,
                "" if onboard is None else onboard.name.lower().replace("_", "-"),
            )
            ended = mission.ending is not None
            command = supervision.step(inputs, command, now_ns, ended=ended)
        self._obey_supervision(now_ns)
        return command

    def _obey_supervision(self, now_ns: HostNs) -> None:
        """Carry out what supervision has decided."""
        if self.supervision is None:
            return
        mission = self.mission
        for decision in self.supervision.decisions():
            match decision:
                case Note(severity, kind, text, data):
                    self._records.named(now_ns, severity, "supervise", kind, text, data)
                case End(ending, first):
                    if not (first and mission.ending is not None):
                        mission.request_end(ending, now_ns / 1e9)
                case Plan.HOLD:
                    hold(mission.runner)
                case Plan.RELEASE:
                    release(mission.runner)
                case _:
                    mission.on_command(decision, now_ns / 1e9)

    def _stale(self, now_ns: HostNs) -> str | None:
        """Name what the run depends on and lacks, if anything."""
        if self.state.times.jumps != self._jumps:
            self._jumps = self.state.times.jumps
            text = "the device's clock was set anew; the estimate begins again where it stood"
            self.event(now_ns, Severity.WARNING, "clock", EventKind.SET, text)
            self.localisation.begin_again()
        stale = self.state.stale(now_ns / 1e9, self.mission.needs)
        return "odometry" if stale is None and not self.estimator.known else stale

    def _judge_link(self, now_ns: HostNs) -> None:
        """Let the run know whether the link is quick enough to move; report each change."""
        session = self.session
        if session.state is not State.READY or now_ns - session.heard_ns > SILENT_NS:
            return  # nothing is driven on a silence, and the session judges it
        mission = self.mission
        trouble = mission.link = session.round_trip.trouble(now_ns)
        slow = trouble is not None and trouble.known
        if slow is not self._slow:
            self._slow = slow
            if trouble is not None:
                self.event(now_ns, Severity.WARNING, "link", EventKind.SLOW, trouble.text)
            else:
                text = "the link is quick enough to drive over again"
                self.event(now_ns, Severity.INFO, "link", EventKind.QUICK, text)
        if trouble is None or mission.runner is not None:
            return
        status = self.state.status
        if status and status.mode == Mode.ONBOARD and status.stop_cause == StopCause.NONE:
            # The device plans for itself, and no run of ours supervises it.
            ending = Ending("stopped", trouble.text, 5, StopCause.LINK)
            mission.request_end(ending, now_ns / 1e9)

    def _driven(self, pose: Pose2, now_ns: HostNs) -> None:
        if self.drive_pose is not None:
            self.path_m += self.drive_pose.distance_m(pose)
        self.drive_pose = pose
        self.on_drive_pose(now_ns / 1e9, pose)
        self.swept.update(pose)
        if now_ns >= self._map_ns:
            self._map_ns = now_ns + MAP_PERIOD_NS
            self.record_map(now_ns)

    def _is_silent(self, now_ns: HostNs) -> bool:
        """Whether the wire is silent, or was until now, so that old data accuse no sensor.

        Nothing is driven meanwhile; the session judges a silence, within a second.
        """
        if now_ns - self.session.heard_ns > SILENT_NS:
            self._silent_ns = now_ns
        return now_ns - self._silent_ns <= _AFTER_SILENCE_NS

    # ---- records --------------------------------------------------------------------------

    def event(
        self,
        now_ns: HostNs,
        severity: Severity,
        source: str,
        kind: EventKind,
        text: str,
        **data: float | str | bool,
    ) -> None:
        """Put an event on record."""
        self._records.event(now_ns, severity, source, kind, text, **data)

    def use_unix_offset(self, unix_offset_ns: int) -> None:
        """Give records another Unix time from now on: a log begins, and no other is under way."""
        self.ingest.unix_offset_ns = self._records.unix_offset_ns = unix_offset_ns

    def record_map(self, now_ns: HostNs) -> None:
        """Put the swept map on record, and what was gathered until now."""
        self._records.flush(now_ns, at_once=True)
        self._records.swept(self.swept, now_ns)

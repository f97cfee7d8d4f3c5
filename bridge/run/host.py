"""The host's core, sans-I/O: session, time synchronisation, estimator, run and records.

Its inputs are bytes and host time; its outputs are bytes and records. The same class runs in
virtual time with the emulated device, over a pseudo-terminal and on a robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bridge.coverage.swept_map import SweptMap
from bridge.errors import ExitStatus, Remedy
from bridge.motion.observation import HALT
from bridge.run.commands import Dialogue, carry_out
from bridge.run.ending import Ending
from bridge.run.localisation import Localisation
from bridge.run.mission import Mission, Phase, Request
from bridge.run.onboard_mission import OnboardMission
from bridge.run.ping_replies import Pings
from bridge.run.plausibility import Plausibility
from bridge.run.recording import HostRecords
from bridge.run.robot_state import PLUGGED, STALE_S, missing_needs, understood
from bridge.run.runner import follows_plan, hold, release
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
    CommandEnded,
    Data,
    Failed,
    Ping,
    Restless,
    SessionEvent,
    SessionReady,
    State,
    StateChanged,
)
from bridge.session.timesync import TimeSync
from bridge.supervise import RuleInputs, limited_command
from protocol.clock import DeviceUs, HostNs
from protocol.imu import ImuReader
from protocol.link import Medium, Rejected
from protocol.messages.device import (
    Encoders,
    Imu,
    LinkCounters,
    LogText,
    ParameterValue,
    PlannerState,
    Power,
    Range,
    Status,
    TimeReply,
)
from protocol.messages.values import Mode, StopCause, label
from protocol.uart.framing import DamagedFrame

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
    from protocol.messages.device import Hello
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

CONTROL_PERIOD_NS = 20_000_000
"""Control period, ns."""
SETPOINT_TTL_MS = 200
"""Time to live of a setpoint, ms: ten control periods, below the device's limit of 250 ms."""
LATE_NS = 50_000_000
"""Maximum delay of a control step that sends a setpoint, ns. After a longer delay the setpoint may
be based on old data."""
SILENT_NS = 100_000_000
"""Time without any frame after which the link counts as silent, ns. It is ten periods of the
fastest stream."""
MAP_PERIOD_NS = 2_000_000_000
"""Interval of recorded maps, ns."""
CLOCK_PERIOD_NS = 1_000_000_000
"""Interval of clock records, ns."""
COUNT_PERIOD_NS = 100_000_000
"""Interval at which the link's counts are copied for other threads, ns. Faster changes are not
readable on a display."""
_AFTER_SILENCE_NS = round(STALE_S * 1e9)
"""Time after a silence in which old data are not a sensor fault, ns."""
_EXIT = {
    EventKind.INCOMPATIBLE: ExitStatus.REJECTED,
    EventKind.VERSION: ExitStatus.REJECTED,
    EventKind.SEVERAL: ExitStatus.USAGE,
}
"""Exit status of a failed session by the kind of its failure; all others: no device."""


class Host:
    """The host's side of one robot, from the opening of the session to the end of the run."""

    def __init__(
        self,
        model: RobotModel,
        sink: Sink,
        options: HostOptions,
        mission: Mission,
        new_session_id: Callable[[], int],
    ) -> None:
        """Create a host with a closed session; :meth:`open` starts it."""
        self.model = model
        self.localisation = Localisation(model, options.start, options.estimation)
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
        """Estimate at the newest control step of the drive; None before the drive."""
        self.supervision: Supervision | None = None
        """Supervision of the run; None: not supervised."""
        self.on_drive_pose: Callable[[float, Pose2], None] = lambda _time_s, _pose: None
        """Called with host time (s) and pose estimate at every control step of the drive."""
        self.plausibility = Plausibility(model, options.plan)
        self.wire = WireStatistics()
        self._pings = Pings(self.wire, sum(options.min_delay_ns), self.event)
        self.sink = sink
        bus = self.session.link.medium is Medium.CAN
        self._records = HostRecords(sink, options.unix_offset_ns, options.planner, bus=bus)
        self._tap = self._records.can if bus else self._records.uart
        """Records the bytes that the port received or sent."""
        self._control_ns = HostNs(0)
        self._map_ns = 0
        self._clock_ns = 0
        self._silent_ns = 0
        """Time of the last silence on the link."""
        self._counts: LinkSnapshot | None = None
        self._counted_ns = 0
        """Time of the last copy of the link's counts."""
        self._slow = False
        """True if the link was too slow for motion at the last check."""
        self.mission.link = self.session.round_trip.trouble(HostNs(0))
        self._jumps = 0
        """Number of jumps of the device's clock that the estimator has handled."""
        self._missing: list[str] = []
        """Names of the messages that driving requires but the device lacks."""
        self._imu = ImuReader()
        self._partial = True
        """True if messages may lack fields that the host expects."""
        self._listeners: dict[type[Message], Callable[[Any, DeviceUs, HostNs], None]] = {
            Imu: self.localisation.imu,
            Encoders: self.localisation.encoders,
            Range: self._range,
            Power: self.localisation.keep,
            PlannerState: self.localisation.keep,
            LinkCounters: self.localisation.keep,
            Status: self._status,
            LogText: self._log_text,
            ParameterValue: self.commands.parameter,
            TimeReply: self.localisation.time_reply,
            **dict.fromkeys(PLUGGED, self._plugged),
        }

    @property
    def sync(self) -> TimeSync:
        """Time synchronisation of the device's clock with the host's clock."""
        return self.ingest.sync

    @property
    def state(self) -> RobotState:
        """Newest data from the device."""
        return self.localisation.state

    @property
    def estimator(self) -> PoseEstimator:
        """The pose estimator; replaced after a reboot of the device."""
        return self.localisation.estimator

    # ---- input and output ------------------------------------------------------------------

    def open(self, now_ns: HostNs) -> None:
        """Start to search for the device."""
        self._control_ns = now_ns
        self.session.open(now_ns)
        # Record the state now, not with the first bytes, because the session's times start here.
        self._digest(self.session.receive(b"", now_ns), now_ns)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes that the port has received."""
        if not data:
            return
        try:
            events = self.session.receive(data, now_ns)
            self._digest(events, now_ns)
        finally:  # after the events, because a caller may wait for an answer
            self._tap(data, now_ns, outgoing=False)
        self.wire.queue((events, now_ns))

    def poll(self, now_ns: HostNs) -> None:
        """Handle all due tasks at ``now_ns``, including the control step."""
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
                self._silent_ns = now_ns  # data of this time may be lost or unread
                text = f"the host was late by {late_ns / 1e6:.0f} ms; no setpoint in this step"
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
        """Return the bytes for the port; the caller writes them at once."""
        data = self.session.link.data_to_send()
        self.sent(data, now_ns)
        return data

    def sent(self, data: bytes, now_ns: HostNs) -> None:
        """Record bytes of :attr:`session` that the caller has written to the port."""
        if data:
            self._tap(data, now_ns, outgoing=True)

    def discard_output(self) -> None:
        """Discard unsent bytes: the port is gone, and they must not be sent late."""
        self.session.data_to_send()

    def next_deadline(self) -> HostNs:
        """Return the next time at which :meth:`poll` is due."""
        deadline = self.session.next_deadline()
        if deadline is None or self._control_ns < deadline:
            return self._control_ns
        return deadline

    def snapshot(self, now_ns: int | None = None) -> Snapshot:
        """Return the current state for other threads; call it in the loop's thread.

        The link's counts are copied every 0.1 s, or at every call without a time.
        """
        state, mission, session, estimator = self.state, self.mission, self.session, self.estimator
        if now_ns is None or now_ns >= self._counted_ns + COUNT_PERIOD_NS or self._counts is None:
            self._counted_ns = now_ns or 0
            counts = session.link.statistics
            self._counts = LinkSnapshot(replace(counts, by_type=dict(counts.by_type)), now_ns)
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
                dict(state.plugged),
                state.counters,
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
        """Start to supervise the run at its next control step."""
        mission = self.mission
        onboard = mission.planner if isinstance(mission, OnboardMission) else None
        self.supervision = Supervision(supervisor, self.model, self.commands, onboard)

    def resume_run(self, now_ns: HostNs) -> bool:
        """Continue a run that waits after a loss or a pause; the operator has checked the robot.

        Returns False if the run does not wait.
        """
        paused = self.supervision is not None and self.supervision.resume(now_ns)
        self._obey_supervision(now_ns)
        return self.mission.resume(now_ns / 1e9) or paused

    def end(self, ending: Ending, now_ns: HostNs) -> None:
        """Request a clean end of the run: the robot stops first."""
        if self.session.state is State.READY:
            self.mission.request_end(ending, now_ns / 1e9)
        elif ending.outranks(self.mission.ending):
            if self.hello is not None:  # a silent device may still receive
                self.session.stop(ending.cause, now_ns)
            self.mission.end_unconfirmed(ending, now_ns / 1e9)
        self._serve(now_ns)

    # ---- session events ---------------------------------------------------------------------

    def _digest(self, events: list[SessionEvent], now_ns: HostNs) -> None:
        ingest, listeners = self.ingest, self._listeners
        take, write, imu = ingest.take, self.sink.write, self._imu
        damaged: list[DamagedFrame] = []
        for event in events:
            if event.__class__ is Data:  # the usual case
                received = event[0]
                write(take(received, now_ns))
                message = imu.take(received[0])
                if message is None:
                    continue  # an IMU sample before its scale
                listener = listeners.get(message.__class__)
                if listener is not None and (not self._partial or understood(message)):
                    listener(message, ingest.device_us, now_ns)
            elif event.__class__ is DamagedFrame:  # with noise, ten times as many as messages
                damaged.append(event)
            else:
                self._happened(event, now_ns)
        if damaged:
            self._records.damaged(damaged, now_ns)
        if self.mission.pending:
            self._serve(now_ns)

    def _happened(self, event: SessionEvent, now_ns: HostNs) -> None:
        match event:
            case CommandEnded():  # first: a caller may wait for it
                if not self.commands.ended(event.outcome):
                    self._answered(event.outcome, now_ns)
                self._obey_supervision(now_ns)
            case Ping():
                self._pings.take(event, self.ingest, now_ns)
            case StateChanged():
                self._changed(event, now_ns)
            case SessionReady():
                self._session_ready(event, now_ns)
            case Failed():
                self.event(now_ns, Severity.ERROR, "session", event.kind, event.text)
                status = _EXIT.get(event.kind, ExitStatus.NO_DEVICE)
                remedy = Remedy.NODE if event.kind is EventKind.SEVERAL else None
                if self.mission.under_way:  # sent even if no device is connected
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

    def _session_ready(self, event: SessionReady, now_ns: HostNs) -> None:
        self.hello = event.hello
        self._records.identity(event, now_ns)
        self._partial = bool(event.differences)
        if event.again:
            self._records.again(event, now_ns)
        if event.rebooted:
            self.ingest.reset()
            self._imu = ImuReader()  # another firmware may configure the IMU differently
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
            text = f"the device cannot be driven: missing {', '.join(self._missing)}"
            self.mission.request_end(Ending("fault", text, ExitStatus.REJECTED), now_ns / 1e9)

    def _range(self, message: Range, device_us: DeviceUs, now_ns: HostNs) -> None:
        fresh = self.state.take(message, device_us, now_ns / 1e9)
        driving = fresh and self.mission.phase is Phase.DRIVING
        if driving and self.localisation.see_walls(message, device_us):
            self.swept.confirm()

    def _plugged(self, message: Message, device_us: DeviceUs, now_ns: HostNs) -> None:  # noqa: ARG002 - the signature of every listener
        self.state.keep_plugged(message, now_ns / 1e9)

    def _log_text(self, message: LogText, device_us: DeviceUs, now_ns: HostNs) -> None:  # noqa: ARG002 - the signature of every listener
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
            estimator.lateral_sigma_m,
            stands=estimator.stands,
        )
        stale = self._stale(now_ns)
        if self._is_silent(now_ns):
            obs = stale = None
        was = mission.phase
        self._judge_link(now_ns)
        command = mission.step(obs, stale, now_s)
        if self.supervision is not None:
            command = self._supervised(self.supervision, command, now_ns)
        if mission.phase is Phase.DRIVING and self.plausibility.due(now_ns):
            current = obs is not None and stale is None
            command = self._plausible(command, now_ns, current=current)
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
        """Supervise a control step; return the velocity to send."""
        mission, planner = self.mission, self.state.planner
        if isinstance(mission, OnboardMission) and planner is not None:
            mission.on_planner(planner)
        onboard = supervision.onboard
        if mission.phase is not Phase.DRIVING:
            supervision.rest(now_ns)
        else:
            state = self.state
            inputs = self._inputs(
                now_ns,
                limited_command(supervision.command, state.status, state.range)
                if onboard is None
                else None,
                "" if onboard is None else onboard.name.lower().replace("_", "-"),
            )
            ended = mission.ending is not None
            command = supervision.step(inputs, command, now_ns, ended=ended)
        self._obey_supervision(now_ns)
        return command

    def _inputs(self, now_ns: HostNs, command: VelocityCommand | None, onboard: str) -> RuleInputs:
        """Return the state of the robot for supervision."""
        state, estimator = self.state, self.estimator
        return RuleInputs(
            now_ns / 1e9,
            estimator.pose,
            estimator.v_m_s,
            estimator.yaw_rate_rad_s,
            estimator.wheel_scale,
            self.session.last_frame_ns / 1e9,
            None if self.hello is None else self.hello.boot_id,
            state.imu,
            state.encoders,
            state.range,
            state.power,
            state.status,
            state.planner,
            state.arrived_s,
            command,
            onboard,
            state.plugged,
        )

    def _plausible(
        self, command: VelocityCommand | None, now_ns: HostNs, *, current: bool
    ) -> VelocityCommand | None:
        """Check that the estimate fits the real robot; return the velocity to send.

        There is no check if the samples are not ``current``, because the last gyro rate is then
        old.
        """
        mission, supervision = self.mission, self.supervision
        planned = follows_plan(mission.runner) or isinstance(mission, OnboardMission)
        if (
            not current
            or not planned
            or (supervision is not None and supervision.supervisor.holding)
        ):
            self.plausibility.restart()
            return command
        inputs = self._inputs(now_ns, None, "")
        found = self.plausibility.step(inputs, self.localisation, now_ns)
        if found is None:
            return command
        if not found.ends:
            self.event(now_ns, Severity.WARNING, "room", EventKind.START, found.text)
            return command
        if found.displaced:
            removed_m2 = self.swept.revert()
            text = f"{removed_m2:.2f} m² of the swept floor are uncertain and no longer count"
            self.event(
                now_ns, Severity.WARNING, "room", EventKind.DISPLACED, text, removed_m2=removed_m2
            )
        mission.request_end(found.ending, now_ns / 1e9)
        return HALT

    def _obey_supervision(self, now_ns: HostNs) -> None:
        """Execute the decisions of the supervision."""
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
        """Return the name of required data that is stale; None if all are fresh."""
        if self.state.times.jumps != self._jumps:
            self._jumps = self.state.times.jumps
            text = "the device's clock was reset; the estimator restarts at the current pose"
            self.event(now_ns, Severity.WARNING, "clock", EventKind.SET, text)
            self.localisation.begin_again()
        stale = self.state.stale(now_ns / 1e9, self.mission.needs)
        return "odometry" if stale is None and not self.estimator.known else stale

    def _judge_link(self, now_ns: HostNs) -> None:
        """Pass the state of the link to the run; record each change."""
        session = self.session
        if session.state is not State.READY or now_ns - session.last_frame_ns > SILENT_NS:
            return  # silence: no motion; the session handles it
        mission = self.mission
        trouble = mission.link = session.round_trip.trouble(now_ns)
        slow = trouble is not None and trouble.known
        if slow is not self._slow:
            self._slow = slow
            if trouble is not None:
                self.event(now_ns, Severity.WARNING, "link", EventKind.SLOW, trouble.text)
            else:
                text = "the link is fast enough for motion again"
                self.event(now_ns, Severity.INFO, "link", EventKind.QUICK, text)
        if trouble is None or mission.runner is not None:
            return
        status = self.state.status
        if status and status.mode == Mode.ONBOARD and status.stop_cause == StopCause.NONE:
            # The device uses its own planner, and no run of this host supervises it.
            ending = Ending("stopped", trouble.text, ExitStatus.STOPPED, StopCause.LINK)
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
        """Return True if the link is or was just silent; old data are then not a sensor fault.

        The robot does not move in this time, and the session detects a lost device within 1 s.
        """
        if now_ns - self.session.last_frame_ns > SILENT_NS:
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
        """Record an event."""
        self._records.event(now_ns, severity, source, kind, text, **data)

    @property
    def event_counts(self) -> dict[tuple[str, str], int]:
        """Number of recorded events by source and kind."""
        return self._records.counts

    def use_unix_offset(self, unix_offset_ns: int) -> None:
        """Set the Unix time offset of later records, for a new log; no other log may be open."""
        self.ingest.unix_offset_ns = self._records.unix_offset_ns = unix_offset_ns

    def record_map(self, now_ns: HostNs) -> None:
        """Record the map of the swept floor and the collected link errors."""
        self._records.flush(now_ns, at_once=True)
        self._records.swept(self.swept, now_ns)

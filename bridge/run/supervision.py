"""Supervision of a run: converts the supervisor's reactions to decisions for the host.

There is one :class:`Supervision` per run. The host calls it in each control step and executes the
decisions. If the host plans, supervision scales the velocity or blocks it. If the device plans,
supervision sets the device's maximum speed and pauses the device's planner with acknowledged
commands.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from bridge.errors import ExitStatus
from bridge.motion.observation import HALT, VelocityCommand
from bridge.run.ending import Ending
from bridge.session.records import Severity
from bridge.supervise import Level
from protocol.messages.host import GetParameter, PlannerCommand, SetParameter, Stop
from protocol.messages.values import NackReason, ParameterKind, PlannerAction, StopCause, label
from protocol.retransmission import Outcome

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.run.commands import Dialogue
    from bridge.session.parameters import Parameter
    from bridge.supervise import Reaction, RuleInputs, Supervisor
    from protocol.clock import HostNs
    from protocol.messages.values import OnboardPlanner

_SPEED = "max_speed"
"""Name of the device's parameter for its maximum speed."""
RESTORE_NS = 900_000_000
"""Maximum time to restore the device's maximum speed after a stop request, ns. It is shorter than
the time after which the run counts the stop as unconfirmed."""
_SEVERITY = {
    Level.REPORT: Severity.WARNING,
    Level.SLOW: Severity.WARNING,
    Level.PAUSE: Severity.WARNING,
    Level.STOP: Severity.ERROR,
}


@dataclass(frozen=True, slots=True)
class Note:
    """An event for the log."""

    severity: Severity
    kind: str
    text: str
    data: dict[str, float | str | bool] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class End:
    """End of the run."""

    ending: Ending
    first: bool = False
    """True: the decision applies only if the run has no end yet."""


class Plan(Enum):
    """Action on the host's plan."""

    HOLD = "hold"
    RELEASE = "release"


Decision = Note | End | Plan | Outcome
"""Decision for the host. An outcome is the device's confirmation of the run's stop."""


class Supervision:
    """Supervision of one run."""

    def __init__(
        self,
        supervisor: Supervisor,
        model: RobotModel,
        commands: Dialogue,
        onboard: OnboardPlanner | None = None,
    ) -> None:
        """Create the supervision; it starts with the first step of the drive.

        Args:
            supervisor: Checks each control step.
            model: The robot.
            commands: Sends commands to the device.
            onboard: The device's planner, if the device plans.

        """
        self.supervisor = supervisor
        self.command = HALT
        """Velocity sent last."""
        self.onboard = onboard
        self._model = model
        self._commands = commands
        self._decisions: list[Decision] = []
        self._driving = False
        self._paused = False
        self._speed: Parameter | None = None
        """The device's maximum speed before the run."""
        self._asked = False
        self._lacks = False
        """True: the device has no parameter for its maximum speed."""
        self._factor = 1.0
        self._setting = False
        """True while the device sets a new maximum speed. The next change waits, so that an old
        value cannot arrive last."""
        self._is_rejected = False
        self._stop_ns = 0
        self._confirmed: Outcome | None = None
        """Confirmation of the run's stop. The run receives it only after the maximum speed is
        restored."""

    def decisions(self) -> list[Decision]:
        """Return and remove the decisions, in the order of execution."""
        decisions = self._decisions
        if decisions:
            self._decisions = []
        return decisions

    # ---- each control step ----------------------------------------------------------------

    def rest(self, now_ns: HostNs) -> None:
        """Handle a control step without driving."""
        self._driving = False
        self.command = HALT
        if self._confirmed is not None:
            self._restore_speed(self._confirmed, now_ns)

    def step(
        self, inputs: RuleInputs, command: VelocityCommand | None, now_ns: HostNs, *, ended: bool
    ) -> VelocityCommand | None:
        """Check a control step of the drive; return the velocity to send, or None to send none.

        Args:
            inputs: State of the robot.
            command: Velocity of the plan; None: no velocity may be sent.
            now_ns: Host time.
            ended: The end of the run is decided.

        """
        if not self._driving:  # the first step, or after a loss
            self._driving = True
            self.supervisor.restart()
        for reaction in self.supervisor.step(inputs):
            self._react(reaction, now_ns)
        if self.onboard is not None:
            self._limit(now_ns)
            return command
        if command is None:
            return None
        if ended or any(isinstance(each, End) for each in self._decisions):  # stopped in this step
            return HALT
        factor = 0.0 if self.supervisor.holding else self.supervisor.factor
        if factor != 1.0:
            command = VelocityCommand(command.v_m_s * factor, command.yaw_rate_rad_s * factor)
        self.command = command
        return command

    # ---- reactions ------------------------------------------------------------------------

    def _react(self, reaction: Reaction, now_ns: HostNs) -> None:
        level = reaction.level
        data = {**reaction.data, "level": level.name.lower()}
        severity = _SEVERITY.get(level, Severity.WARNING)
        self._decisions.append(Note(severity, reaction.kind, reaction.text, data))
        if level is Level.PAUSE:
            self._pause(now_ns)
        elif level is Level.STOP:
            self._end(reaction.text)

    def _end(self, text: str, *, first: bool = False) -> None:
        ending = Ending("stopped", f"supervise: {text}", ExitStatus.STOPPED, StopCause.SUPERVISE)
        self._decisions.append(End(ending, first))

    def _pause(self, now_ns: HostNs) -> None:
        if self._paused:
            return
        self._paused = True
        text = "the run is paused; check the robot, then resume (key r) or stop the run"
        self._decisions.append(Note(Severity.WARNING, "paused", text))
        self._plan(PlannerAction.PAUSE, Plan.HOLD, now_ns)

    def resume(self, now_ns: HostNs) -> bool:
        """Continue after a pause and a check by the operator. Return False if not paused."""
        if not self._paused:
            return False
        self._paused = False
        self.supervisor.resume(now_ns / 1e9)
        self._decisions.append(Note(Severity.INFO, "resumed", "the run is resumed"))
        self._plan(PlannerAction.RESUME, Plan.RELEASE, now_ns)
        return True

    def _plan(self, onboard: PlannerAction, own: Plan, now_ns: HostNs) -> None:
        """Pause or resume the plan of the device or the host."""
        if self.onboard is None:
            self._decisions.append(own)
            return
        what = f"planner {onboard.name.lower()}"
        self._commands.ask(
            PlannerCommand,
            (int(onboard), int(self.onboard)),
            now_ns,
            lambda outcome: self._ended(what, outcome),
        )

    def _ended(self, what: str, outcome: Outcome | None) -> None:
        """End the run if the device rejected a command that slows or pauses the device."""
        if outcome is not None and outcome.accepted:
            return
        reason = None if outcome is None else outcome.reason
        why = "no answer" if reason is None else label(NackReason, reason)
        self._end(f"the device rejected {what}: {why}", first=True)

    # ---- the device's maximum speed ---------------------------------------------------------

    def _limit(self, now_ns: HostNs) -> None:
        """Set the device's maximum speed to the supervisor's factor."""
        commands = self._commands
        if self._speed is None:
            known = {p.name: p for p in commands.parameters.values()}
            self._speed = known.get(_SPEED)
            if self._speed is None and not self._asked:
                self._asked = True
                self._find(0, now_ns)
            if self._lacks and self.supervisor.factor != 1.0:
                self._end(f"the device cannot be slowed down: it has no parameter {_SPEED}")
            return
        self._set(self.supervisor.factor, now_ns)

    def stopping(self, now_ns: HostNs) -> None:
        """Record that a stop is sent. From now on, only the confirmation of this stop counts."""
        self._stop_ns = now_ns
        self._confirmed = None

    def keeps(self, outcome: Outcome, stop_cause: StopCause, now_ns: HostNs) -> bool:
        """Delay the device's confirmation of the stop that ends the run.

        First, the device's maximum speed must be restored. Then, or after a timeout,
        :meth:`decisions` returns the confirmation. Returns True if the confirmation is delayed.
        """
        message = outcome.message
        if self._speed is None or not isinstance(message, Stop) or not outcome.accepted:
            return False
        if message.cause < stop_cause:
            return False  # a stop of a higher cause was sent
        self._confirmed = outcome
        self._restore_speed(outcome, now_ns)
        return True

    def _restore_speed(self, confirmed: Outcome, now_ns: HostNs) -> None:
        if not self._is_rejected and now_ns - self._stop_ns < RESTORE_NS:
            self._set(1.0, now_ns)
            if self._setting:
                return  # checked again at the next control step
        self._confirmed = None
        if self._setting or self._factor != 1.0:
            text = (
                f"the device's own {_SPEED} could not be restored; it drives slowly until a reboot"
            )
            self._decisions.append(Note(Severity.WARNING, "slow_left", text))
        self._decisions.append(confirmed)

    def _set(self, factor: float, now_ns: HostNs) -> None:
        speed = self._speed
        if factor == self._factor or speed is None or self._setting:
            return
        before, self._factor, self._setting = self._factor, factor, True
        wanted = speed.value if factor == 1.0 else factor * self._model.cruise_speed_m_s
        raw = speed.raw(max(speed.low, min(wanted, speed.high)))

        def ended(outcome: Outcome | None) -> None:
            self._setting = False
            self._is_rejected = outcome is None or not outcome.accepted
            if self._is_rejected:
                self._factor = before
            if self._confirmed is None:
                self._ended(f"set {_SPEED}", outcome)

        self._commands.ask(SetParameter, (speed.number, ParameterKind.F32, raw), now_ns, ended)

    def _find(self, number: int, now_ns: HostNs) -> None:
        """Read the parameters one by one until the maximum speed is found or none is left."""

        def next_one(outcome: Outcome | None) -> None:
            known = self._commands.parameters.get(number)
            more = number + 1 < (self._commands.parameter_count or 0)
            if known is not None and known.name == _SPEED:
                return
            if outcome is not None and outcome.accepted and more:
                self._find(number + 1, now_ns)
            else:
                self._lacks = True

        self._commands.ask(GetParameter, (number,), now_ns, next_one)

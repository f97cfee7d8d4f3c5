"""State machine of one run with motion: enable motion, drive the plan, end cleanly.

No I/O: its inputs are time, session events and observations, and its outputs are requests. Each
step starts after the device has confirmed the previous step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from bridge.errors import ExitStatus, Remedy
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.run.ending import Ending
from bridge.run.rejections import rejection_remedy, rejection_text
from bridge.run.robot_state import NEEDS
from bridge.run.runner import hold, release
from protocol.messages.host import ClearStop, SetMode, Stop
from protocol.messages.values import Mode, NackReason, StopCause, fault_labels, label, latched_cause

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.run.runner import Runner
    from bridge.session.round_trip import LinkTrouble
    from protocol.messages.device import Status
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

AT_REST_S = 2.5
"""Duration of the standstill before the first move, s. The gyro bias is averaged over 250
samples."""
DATA_TIMEOUT_S = 3.0
"""Maximum wait for the first status, and for sensor data after the standstill, s. It is thirty
periods of the status."""
END_TIMEOUT_S = 1.0
"""Maximum wait for the confirmation of the final stop, s."""
SLOW_LIMIT_S = 4.0
"""Maximum time for which the link may be too slow before a run's first move, s. On a busy machine,
host and simulator may be slow for seconds while they start. The robot does not move in this
time."""
LOST_TIMEOUT_S = 30.0
"""Maximum time that a run waits for a lost device, s."""


class Resume(Enum):
    """Behaviour of a run with motion after its device was lost and has returned."""

    NEVER = "never"
    """The run ends."""
    ASK = "ask"
    """The run waits until the operator continues it, and ends after a timeout."""
    AUTO = "auto"
    """The run continues by itself. Only for simulated runs."""


class Phase(Enum):
    """Phase of a run."""

    WAITING = "waiting"
    """The run waits for the session and the first status."""
    CLEARING = "clearing"
    """The run waits for the confirmation of a cleared stop."""
    ENABLING = "enabling"
    """The run waits for the confirmation of its mode."""
    SETTLING = "settling"
    """The robot stands still before the first move, or before it continues."""
    DRIVING = "driving"
    HOLDING = "holding"
    """The device is lost."""
    ENDING = "ending"
    """A stop is sent but not confirmed."""
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Request:
    """A request to the session: ``clear``, ``mode``, ``planner`` or ``stop``."""

    kind: str
    """Action: clear a stop, set a mode, command the device's planner, or stop."""
    value: int
    """Stop cause, mode, or action of the device's planner."""
    planner: int = 0
    """Number of the device's planner."""


_BEFORE_MOTION = {Phase.WAITING, Phase.CLEARING, Phase.ENABLING, Phase.SETTLING}


def _too_slow(link: LinkTrouble) -> Ending:
    """Return the end of a run because its link does not allow motion."""
    return Ending("stopped", link.text, ExitStatus.STOPPED, StopCause.LINK)


class Mission:
    """State machine of a run; without a runner it only monitors."""

    def __init__(
        self,
        runner: Runner | None,
        *,
        clear_stop: bool = False,
        max_time_s: float | None = None,
        at_rest_s: float = AT_REST_S,
        resume: Resume = Resume.NEVER,
    ) -> None:
        """Create a waiting run.

        Args:
            runner: Decides the velocity; None: monitor only.
            clear_stop: Clear a latched stop of any cause. If False, clear only the stop of a clean
                end of a session or of power-on.
            max_time_s: Maximum time of the drive, s; None: unlimited.
            at_rest_s: Standstill before the first move, s.
            resume: Continuation of the run after a loss of the device.

        """
        self.runner = runner
        self.phase = Phase.WAITING
        self.ending: Ending | None = None
        self.drive_started_s: float | None = None
        self.drive_ended_s: float | None = None
        self.stop_cause = StopCause.NONE
        """Most severe cause of the stops that this run has requested at its end."""
        self.confirmed = StopCause.NONE
        """Most severe cause of the stops that the device has confirmed at the run's end."""
        self.signed = False
        """True if commands are signed with a key. The key may differ from the device's key."""
        self.link: LinkTrouble | None = None
        """Reason why the link allows no motion; the host updates it at each control step."""
        self.asking = False
        """True if the device has returned and the operator must decide whether the run
        continues."""
        self._resume = resume
        self._resumed = False
        """True if the operator has continued the run. Then the stop that the device latched at the
        loss may be cleared."""
        self._clear_any = clear_stop
        self._clear_cause: int = StopCause.NONE
        """Cause of the stop that may be cleared; NONE: no additional cause."""
        self._max_time_s = max_time_s
        self._at_rest_s = at_rest_s
        self._since_s = 0.0
        self._asked_s: float | None = None
        """Start time of a runner's wait for the device's status."""
        self._slow_s: float | None = None
        """Start of the time for which the link is too slow for the first move."""
        self._ready = False
        self._was_ready = False
        self._latched = False
        """True if the device's newest status has a latched stop."""
        self._faults = 0
        """Fault bits of the device's newest status."""
        self.pending: list[Request] = []
        """Requests that are not fetched yet. Public because the loop checks it in every pass."""

    @property
    def _drives_in(self) -> Mode | None:
        """Mode that the device must have while the run drives; None: any."""
        return Mode.VELOCITY

    @property
    def needs(self) -> Mapping[type[Message], float]:
        """Streams that the run depends on, with the age (s) at which a sample is stale."""
        return NEEDS

    @property
    def done(self) -> bool:
        """True if the run has ended."""
        return self.phase is Phase.DONE

    @property
    def under_way(self) -> bool:
        """True from the first move to the end of the run."""
        return self.drive_started_s is not None and not self.done

    @property
    def ends_s(self) -> float | None:
        """Time at which a run with a lost device ends (s); None: the device is not lost."""
        return self._since_s + LOST_TIMEOUT_S if self.phase is Phase.HOLDING else None

    def start(
        self, runner: Runner, *, clear_stop: bool = False, clear_cause: int = StopCause.NONE
    ) -> None:
        """Add a runner to a run that only monitors; the runner starts with the next status.

        It has no effect if the run has a runner already, or cannot start now.

        Args:
            runner: decides the velocity.
            clear_stop: clear a latched stop of any cause.
            clear_cause: clear a latched stop of this cause too.

        """
        if self.runner is None and self.phase is Phase.WAITING:
            self.runner = runner
            self._clear_any = clear_stop
            self._clear_cause = clear_cause

    def requests(self) -> list[Request]:
        """Return and remove the requests for the session."""
        requests = self.pending
        if requests:
            self.pending = []
            return requests
        return []

    # ---- events -----------------------------------------------------------------------------

    def on_ready(self, now_s: float) -> None:
        """Handle the start of a session."""
        self._ready, self._latched = True, False
        self._slow_s = None
        if self._was_ready and self.runner is not None and self.ending is None:
            self._back(now_s)
            return
        self._was_ready = True
        if self.phase in {Phase.HOLDING, Phase.WAITING}:
            self._go(Phase.WAITING, now_s)

    def _back(self, now_s: float) -> None:
        """Handle the return of the device that the run depends on."""
        if self._resume is Resume.NEVER:
            ending = Ending(
                "stopped",
                "the device was lost and is back; check it, then restart",
                ExitStatus.STOPPED,
            )
            self._end(now_s, ending)
        elif self._resume is Resume.ASK:
            self._go(Phase.HOLDING, now_s)
            self.asking = True
        else:
            self._resumed = True
            self._go(Phase.WAITING, now_s)

    def resume(self, now_s: float) -> bool:
        """Continue after a loss and a check by the operator.

        Return False if the run does not wait.
        """
        if not (self.asking and self._ready and self.phase is Phase.HOLDING):
            return False
        self.asking, self._resumed = False, True
        self._go(Phase.WAITING, now_s)
        return True

    def on_lost(self, now_s: float) -> None:
        """Handle the loss of the device or of its session."""
        self._ready = self.asking = False
        if self.phase is Phase.ENDING:
            self._unconfirmed()
            self._finish(now_s)
        elif self.phase is Phase.DONE:
            return
        elif self._was_ready:
            self._clear_any, self._clear_cause = False, StopCause.NONE  # for the first start only
            if self.phase is Phase.DRIVING:
                hold(self.runner)
            self._go(Phase.HOLDING, now_s)

    def on_failed(
        self, text: str, exit_status: int, now_s: float, remedy: Remedy | None = None
    ) -> None:
        """Handle the failure of the session."""
        if self.ending is None:
            self.ending = Ending("fault", text, exit_status, remedy=remedy)
            if self.under_way:
                self._unconfirmed()
        self._finish(now_s)

    def on_status(self, status: Status, now_s: float) -> None:
        """Handle the device's status."""
        self._latched = status.stop_cause != StopCause.NONE
        before, self._faults = self._faults, status.faults
        if self.runner is None or not self._ready:
            return
        cause = status.stop_cause
        if self.phase is Phase.WAITING:
            if self._may_start:
                self._start(cause, now_s)
        elif self.phase in {Phase.SETTLING, Phase.DRIVING} and cause != StopCause.NONE:
            name = label(StopCause, cause)
            held = status.faults
            if cause == StopCause.HARDWARE:  # the stop may have ended the fault that caused it
                held |= before
            faults = "".join(f", {fault}" for fault in fault_labels(held))
            text = f"the device latched a stop (cause: {name}{faults})"
            self._end(
                now_s,
                Ending(
                    "stopped",
                    text,
                    ExitStatus.STOPPED,
                    latched=latched_cause(StopCause.NONE, cause),
                ),
            )
        elif self.phase is Phase.DRIVING and self._drives_in is not None:
            self._check_mode(status.mode, self._drives_in, now_s)

    def _check_mode(self, mode: int, wanted: Mode, now_s: float) -> None:
        """End the drive if the device is no longer in the confirmed mode."""
        if mode != wanted:
            found, needed = label(Mode, mode), label(Mode, wanted)
            text = f"the device is in mode {found}, but the run needs {needed}"
            self._end(now_s, Ending("stopped", text, ExitStatus.STOPPED, StopCause.SUPERVISE))

    def on_command(self, outcome: Outcome, now_s: float) -> None:
        """Handle the outcome of a command."""
        message = outcome.message
        if isinstance(message, Stop):
            self._stopped(message.cause, now_s, accepted=outcome.accepted)
            return
        if self.phase not in {Phase.CLEARING, Phase.ENABLING}:
            return
        if not outcome.accepted:
            what = "clear stop"
            if isinstance(message, SetMode):
                what = f"{label(Mode, message.mode)} mode"
            if outcome.reason is None:
                hint = "; check that the key is the device's key" if self.signed else ""
                ending = Ending(
                    "fault", f"the device did not answer {what}{hint}", ExitStatus.REJECTED
                )
            else:
                text = f"the device rejected {what}: {rejection_text(outcome.reason)}"
                stopped = outcome.reason in {NackReason.STOP_LATCHED, NackReason.OTHER_CAUSE}
                ending = Ending("fault", text, ExitStatus.REJECTED)
                if stopped:
                    ending = Ending("stopped", text, ExitStatus.STOPPED)
                ending = replace(ending, remedy=rejection_remedy(outcome.reason))
            self._end(now_s, ending)
        elif isinstance(message, ClearStop):
            self._enable(now_s)
        elif isinstance(message, SetMode):
            self._go(Phase.SETTLING, now_s)

    def _stopped(self, cause: int, now_s: float, *, accepted: bool) -> None:
        """Handle the answer to a stop.

        A stop with a lower cause than the end's cause does not end the run.
        """
        if accepted:
            self.confirmed = latched_cause(self.confirmed, cause)
        if self.phase is Phase.ENDING and cause >= self.stop_cause:
            if not accepted:
                self._unconfirmed()
            self._finish(now_s)

    def request_end(self, ending: Ending, now_s: float) -> None:
        """Request a clean end: the robot stops first.

        A higher cause replaces the current cause, even if a stop with the current cause was sent.
        Then another stop with the higher cause is sent, and it needs its own confirmation.
        """
        if self.phase is Phase.DONE and not self._ready:
            return
        present = self.ending
        if present is None or ending.outranks(present):
            self._end(now_s, ending)
        elif ending.cause > present.cause:  # the device itself latched a higher cause
            self._stop(now_s, ending.cause)

    def end_unconfirmed(self, ending: Ending, now_s: float) -> None:
        """End the run without a confirmation, because the device cannot confirm a stop."""
        if self.phase is not Phase.DONE:
            self.on_lost(now_s)
        self.ending = ending
        if self._was_ready and self.runner is not None:
            self._unconfirmed()
        self._finish(now_s)

    def crashed(self, ending: Ending, confirmed: StopCause, now_s: float) -> None:
        """Record that the loop failed and ended the run itself."""
        self.ending = ending
        if self.drive_started_s is not None and self.drive_ended_s is None:
            self.drive_ended_s = now_s
        self.confirmed = max(self.confirmed, confirmed)
        self.phase = Phase.DONE

    # ---- control ----------------------------------------------------------------------------

    def step(
        self, obs: Observation | None, stale: str | None, now_s: float
    ) -> VelocityCommand | None:
        """Execute one control step; return a velocity to send, or None to send none."""
        link = self.link
        if self.phase is Phase.DRIVING:  # the usual case
            if link is None:
                return self._drive(obs, stale, now_s)
            self._end(now_s, _too_slow(link))
            return HALT
        if link is not None and link.known:
            self._await_quicker(link, now_s)
        else:
            self._slow_s = None
        elapsed_s = now_s - self._since_s
        match self.phase:
            case Phase.WAITING:
                self._wait(now_s)
            case Phase.SETTLING:
                return self._rest_before_start(elapsed_s, obs, stale, now_s)
            case Phase.HOLDING:
                self._hold(elapsed_s, now_s)
            case Phase.ENDING:
                if elapsed_s > END_TIMEOUT_S:
                    self._unconfirmed()
                    self._finish(now_s)
            case _:
                pass
        return None

    def _hold(self, elapsed_s: float, now_s: float) -> None:
        if elapsed_s <= LOST_TIMEOUT_S:
            return
        if self.asking:
            text = "the device was lost and is back, but the operator did not continue the run"
            self._end(now_s, Ending("stopped", text, ExitStatus.STOPPED))
            return
        self.ending = Ending(
            "fault", f"the device was lost for {LOST_TIMEOUT_S:g} s", ExitStatus.NO_DEVICE
        )
        self._finish(now_s)

    def _await_quicker(self, link: LinkTrouble, now_s: float) -> None:
        """End the run if the link stays too slow before the first move."""
        if self.runner is None or not self._ready or self.phase not in _BEFORE_MOTION:
            return
        if self._slow_s is None:
            self._slow_s = now_s
        elif now_s - self._slow_s > SLOW_LIMIT_S:
            self._end(now_s, _too_slow(link))

    @property
    def _may_start(self) -> bool:
        """True if the link allows enabling motion; it is checked again before the first move."""
        return self.link is None or not self.link.known

    def _wait(self, now_s: float) -> None:
        if self.runner is None or not self._ready:
            return
        if self._asked_s is None:
            self._asked_s = now_s
        elif now_s - self._asked_s > DATA_TIMEOUT_S:
            if self.link is not None:
                self._end(now_s, _too_slow(self.link))
            else:
                self._end(now_s, Ending("fault", "no status from the device", ExitStatus.NO_DEVICE))

    def _rest_before_start(
        self, elapsed_s: float, obs: Observation | None, stale: str | None, now_s: float
    ) -> VelocityCommand | None:
        if elapsed_s >= self._at_rest_s:
            if obs is not None and stale is None and self.link is None:
                if self.drive_started_s is None:
                    self.drive_started_s = now_s
                if self._resumed:
                    release(self.runner)
                self._resumed = False
                self._go(Phase.DRIVING, now_s)
            elif elapsed_s > self._at_rest_s + DATA_TIMEOUT_S:
                text = f"no {stale or 'range'} data from the device"
                ending = Ending("stopped", text, ExitStatus.STOPPED)
                if self.link is not None and obs is not None and stale is None:
                    ending = _too_slow(self.link)
                self._end(now_s, ending)
        return HALT

    def _drive(
        self, obs: Observation | None, stale: str | None, now_s: float
    ) -> VelocityCommand | None:
        runner = self.runner
        if runner is None or obs is None:
            return HALT
        if stale is not None:
            self._end(
                now_s,
                Ending(
                    "stopped",
                    f"no {stale} data from the device",
                    ExitStatus.STOPPED,
                    StopCause.SUPERVISE,
                ),
            )
            return HALT
        command = runner.step(obs)
        if runner.finished:
            self._end(
                now_s, Ending("complete", runner.finish_reason or "finished", ExitStatus.SUCCESS)
            )
        elif (
            self._max_time_s is not None
            and self.drive_started_s is not None
            and now_s - self.drive_started_s > self._max_time_s
        ):
            self._end(
                now_s,
                Ending("timeout", f"not finished after {self._max_time_s:g} s", ExitStatus.FAILURE),
            )
            return HALT
        return command

    # ---- transitions ------------------------------------------------------------------------

    def _go(self, phase: Phase, now_s: float) -> None:
        self.phase = phase
        self._since_s = now_s
        self._asked_s = None

    def _start(self, cause: int, now_s: float) -> None:
        if cause == StopCause.NONE:
            self._enable(now_s)
        elif (
            cause == StopCause.SESSION_END
            or self._clear_any
            or cause == self._clear_cause
            or (self._resumed and cause == StopCause.LINK)
        ):
            self.pending.append(Request("clear", cause))
            self._go(Phase.CLEARING, now_s)
        else:
            name = label(StopCause, cause)
            self._end(
                now_s,
                Ending(
                    "stopped",
                    f"the robot has a latched stop (cause: {name}); check that it is safe to move",
                    ExitStatus.STOPPED,
                    latched=latched_cause(StopCause.NONE, cause),
                    remedy=Remedy.CLEAR_STOP,
                ),
            )

    def _enable(self, now_s: float) -> None:
        self.pending.append(Request("mode", Mode.VELOCITY))
        self._go(Phase.ENABLING, now_s)

    def _end(self, now_s: float, ending: Ending) -> None:
        self.ending = ending
        if self.drive_started_s is not None and self.drive_ended_s is None:
            self.drive_ended_s = now_s
        if self._ready:
            self._stop(now_s, ending.cause)
        else:
            self._finish(now_s)

    def _stop(self, now_s: float, cause: StopCause) -> None:
        if cause > self.stop_cause:
            self.stop_cause = cause
            self.pending.append(Request("stop", cause))
            self._go(Phase.ENDING, now_s)

    def _unconfirmed(self) -> None:
        """End the run without a confirmed stop; the device's watchdog stops the robot."""
        ending = self.ending
        if ending is None:
            return
        reason = f"{ending.reason}; the device did not confirm the stop"
        self.ending = replace(ending, reason=reason)
        if self._latched:
            return  # the status shows that the device has stopped
        # This includes a clean end before the first move, because motion may be enabled.
        if self.drive_started_s is not None or not (self.runner is None or ending.exit_status):
            self.ending = replace(self.ending, outcome="fault", exit_status=ExitStatus.NO_DEVICE)

    def _finish(self, now_s: float) -> None:
        if self.drive_started_s is not None and self.drive_ended_s is None:
            self.drive_ended_s = now_s
        self._go(Phase.DONE, now_s)

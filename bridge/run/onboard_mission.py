"""Run in which the device's own planner drives; the host starts, monitors and ends it.

The host sends no velocity. It keeps the session open and estimates the pose from telemetry, as in
any run. It ends the run on request, or when the device's planner has ended.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from bridge.coverage.planner import PlannerEvent
from bridge.coverage.planner import PlannerState as RunnerState
from bridge.errors import ExitStatus
from bridge.motion.observation import HALT
from bridge.run.ending import Ending
from bridge.run.mission import DATA_TIMEOUT_S, Mission, Phase, Request
from bridge.run.rejections import rejection_remedy, rejection_text
from bridge.run.robot_state import STATUS_STALE_S
from protocol.messages.device import PlannerState, Status
from protocol.messages.host import PlannerCommand, SetMode
from protocol.messages.values import Mode, PlannerAction, PlannerPhase, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.observation import Observation, VelocityCommand
    from protocol.messages.values import OnboardPlanner
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

_HALF_COUNT = 128
"""Half the range of the 8-bit turn count. A larger increase means that the count has restarted."""
PLAN_STALE_S = 2.0
"""Maximum age of the device's planner state, s: ten periods. A few frames may be lost, but without
any planner state the run ends."""
_REPORTS: Mapping[type[Message], float] = MappingProxyType(
    {Status: STATUS_STALE_S, PlannerState: PLAN_STALE_S}
)
LEFT_S = 1.0
"""Maximum time that the device is outside onboard mode without reporting the planner's end, s. It
is ten periods of the status and five of the planner state."""


class OnboardRun:
    """Runner that represents the device's planner by its reported states."""

    target = HALT
    lane_length_m = 0.0

    def __init__(self) -> None:
        self.state = RunnerState("onboard")
        self.turns = 0
        self.finished = False
        self.finish_reason: str | None = None
        self._last_state: PlannerState | None = None
        self._events: list[PlannerEvent] = []

    def take(self, message: PlannerState) -> None:
        """Handle a planner state. Repeated calls with the same state have no effect."""
        before, self._last_state = self._last_state, message
        if message is before:
            return
        phase = label(PlannerPhase, message.phase)
        if before is not None:
            turned = (message.turn_count - before.turn_count) & 0xFF
            self.turns += turned if turned < _HALF_COUNT else 0  # it restarts with a new pass
        if before is None or before.phase != message.phase:
            self._events.append(PlannerEvent("phase", f"the device's planner is {phase}"))
        self.state = RunnerState(
            phase,
            turn_count=message.turn_count,
            lane_distance_m=message.lane_distance_m,
            previous_lane_distance_m=message.previous_lane_distance_m,
            length_m=message.length_m,
            case=message.lane_case,
            target=(message.target_x_m, message.target_y_m),
        )

    def step(self, obs: Observation) -> VelocityCommand:  # noqa: ARG002 - the signature of every runner
        """Return a halt: the device moves by itself."""
        return HALT

    def drain_events(self) -> list[PlannerEvent]:
        """Return the phase changes since the last call."""
        events, self._events = self._events, []
        return events


class OnboardMission(Mission):
    """Clears a stop if allowed, starts the device's planner and monitors it."""

    def __init__(
        self,
        planner: OnboardPlanner,
        *,
        clear_stop: bool = False,
        max_time_s: float | None = None,
    ) -> None:
        """Create a waiting run; :class:`Mission` explains the arguments."""
        self.onboard = OnboardRun()
        super().__init__(self.onboard, clear_stop=clear_stop, max_time_s=max_time_s)
        self.planner = planner
        self._left_s: float | None = None

    def on_planner(self, message: PlannerState) -> None:
        """Handle the newest planner state if this run has started the planner."""
        if self.phase in {Phase.SETTLING, Phase.DRIVING}:
            self.onboard.take(message)

    def on_command(self, outcome: Outcome, now_s: float) -> None:
        """Handle the outcome of a command."""
        message, enabling = outcome.message, self.phase is Phase.ENABLING
        if enabling and isinstance(message, SetMode) and outcome.accepted:
            self.pending.append(Request("planner", PlannerAction.START, self.planner))
        elif enabling and isinstance(message, PlannerCommand):
            if outcome.accepted:
                self._go(Phase.SETTLING, now_s)
            else:
                reason = outcome.reason
                why = "no answer" if reason is None else rejection_text(reason)
                text = f"the device rejected the start of its planner: {why}"
                self._end(
                    now_s,
                    Ending("fault", text, ExitStatus.REJECTED, remedy=rejection_remedy(reason)),
                )
        else:
            super().on_command(outcome, now_s)

    def on_status(self, status: Status, now_s: float) -> None:
        """Handle the device's status."""
        super().on_status(status, now_s)
        if self.phase is not Phase.DRIVING or status.mode == Mode.ONBOARD:
            self._left_s = None
        elif self._left_s is None:
            self._left_s = now_s

    @property
    def needs(self) -> Mapping[type[Message], float]:
        """Streams that the run depends on. While driving, supervision checks the sensors."""
        return _REPORTS if self.phase is Phase.DRIVING else super().needs

    @property
    def _drives_in(self) -> None:
        """None: the device leaves its mode by itself at the planner's end."""
        return

    @property
    def _may_start(self) -> bool:
        """True if the link allows motion.

        Checked before the start, because the device then moves alone.
        """
        return self.link is None

    def _enable(self, now_s: float) -> None:
        self.pending.append(Request("mode", Mode.ONBOARD))
        self._go(Phase.ENABLING, now_s)

    def _rest_before_start(
        self, elapsed_s: float, obs: Observation | None, stale: str | None, now_s: float
    ) -> None:
        if elapsed_s >= self._at_rest_s and obs is not None and stale is None:
            self.drive_started_s = now_s
            self._go(Phase.DRIVING, now_s)
        elif elapsed_s > self._at_rest_s + DATA_TIMEOUT_S:
            text = f"no {stale or 'range'} data from the device"
            self._end(now_s, Ending("stopped", text, ExitStatus.STOPPED, StopCause.SUPERVISE))

    def _drive(self, obs: Observation | None, stale: str | None, now_s: float) -> None:
        phase = self.onboard.state.state
        started_s, left_s = self.drive_started_s, self._left_s
        if phase == "finished":
            self.onboard.finished = True
            self.onboard.finish_reason = "the device's planner finished"
            self._end(
                now_s, Ending("complete", "the device's planner finished", ExitStatus.SUCCESS)
            )
        elif phase == "aborted":
            self._end(
                now_s, Ending("stopped", "the device's planner was aborted", ExitStatus.STOPPED)
            )
        elif left_s is not None and now_s - left_s > LEFT_S:
            text = "the device left onboard mode without a reported end"
            self._end(now_s, Ending("stopped", text, ExitStatus.STOPPED, StopCause.SUPERVISE))
        elif stale is not None and obs is not None:
            text = f"no {stale} data from the device"
            self._end(now_s, Ending("stopped", text, ExitStatus.STOPPED, StopCause.SUPERVISE))
        elif (
            self._max_time_s is not None
            and started_s is not None
            and now_s - started_s > self._max_time_s
        ):
            self._end(
                now_s,
                Ending("timeout", f"not finished after {self._max_time_s:g} s", ExitStatus.FAILURE),
            )

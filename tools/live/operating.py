"""Keys of a live run: start, pause, stop, manual driving, marks."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.run.dead_man_switch import DIRECTIONS, PRESS_S, DeadManSwitch
from bridge.run.ending import Ending, described
from bridge.run.manual import DriveMode, Operator
from bridge.run.mission import Phase
from bridge.run.onboard_mission import OnboardMission
from bridge.run.rejections import rejection_text
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from protocol.messages.host import PlannerCommand
from protocol.messages.values import PlannerAction, PlannerPhase, StopCause, label

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.api.pump import Pump
    from bridge.run.host import Host
    from protocol.retransmission import Outcome
    from tools.live.terminal_keys import Key

TWICE_NS = 4_000_000_000
"""Maximum time between the two presses of a key that starts motion, ns."""
_STOP = {"space", "s"}
_KEYS = (
    "space s: STOP   g: start plan   p: pause   d: drive manually   m: mark   "
    "c: clear stop   r: resume   Ctrl-C: end"
)
_DRIVE_KEYS = "space s: STOP   m: mark   d: end manual driving   Ctrl-C: end"
_ORDERLY = {StopCause.NONE, StopCause.SESSION_END}
"""Stop causes that do not prevent a start."""


_MODE_TEXT = {
    DriveMode.NOTHING: "the robot stands still",
    DriveMode.PLAN: "the plan is running",
    DriveMode.HELD: "the plan is paused; p resumes it",
    DriveMode.MANUAL: "manual driving: use the arrow keys",
}


class Operating:
    """The effect of each key on a run; called from the keyboard's thread."""

    def __init__(
        self,
        pump: Pump,
        operator: Operator,
        *,
        on_resume: Callable[[], object],
        on_start: Callable[[], object] = lambda: None,
        clear_stop: bool = False,
    ) -> None:
        """Act on a run.

        Args:
            pump: the run.
            operator: its runner, which switches between plan and manual driving.
            on_resume: called to resume a run that waits after a loss.
            on_start: called when a key starts the run.
            clear_stop: a start may clear a latched safety stop.

        """
        self._pump, self.operator = pump, operator
        self._on_resume, self._on_start = on_resume, on_start
        self._clear_stop = clear_stop
        self._clear_cause: int = StopCause.NONE
        """Cause of the stop that the operator has looked at and cleared; NONE: none."""
        self._armed = ("", 0)
        """Key that was pressed once, and the time of the press, ns."""
        self.marks = 0
        """Number of marks so far."""
        self.message = ""
        """Effect of the newest key, for the dashboard."""

    @property
    def _host(self) -> Host:
        return self._pump.host

    @property
    def dead_man_switch(self) -> DeadManSwitch:
        """Dead-man switch of the manual driving."""
        return self.operator.dead_man_switch

    @property
    def note(self) -> str:
        """Line above the keys: what the run waits for, or the effect of the newest key."""
        seen = self._pump.snapshot
        if seen.mission.asking or seen.holding:
            return "the run is waiting: look at the robot, then press r to resume"
        return self.message

    def on_key(self, key: Key) -> None:
        """Handle one event of the keyboard. An exception stops the robot and ends the run."""
        try:
            self._handle(key)
        except Exception as error:  # noqa: BLE001 - a key that does nothing is not safe
            why = f"the key {key.name} failed: {described(error)}"
            self._end(Ending("fault", why, 1, StopCause.OPERATOR))

    def _handle(self, key: Key) -> None:
        time_s = clock.now() / 1e9
        if key.kind == "release":
            self.dead_man_switch.release(key.name, time_s)
            return
        name = key.name
        if name in _STOP:
            self.stop("stopped by the operator's key")
        elif name in DIRECTIONS:
            self._direct(name, time_s)
        elif key.kind == "press":
            self.dead_man_switch.release_all()  # any other key stops
            self._act(name)

    def stop(self, why: str) -> None:
        """Stop the robot, latch the stop and end the run with this reason."""
        self.dead_man_switch.release_all()
        self._end(Ending("stopped", why, 5, StopCause.OPERATOR))

    def pad_gone(self, path: str) -> None:
        """Stop the robot because the gamepad was unplugged; the keys still work."""
        self.dead_man_switch.release_all()
        self.message = f"the gamepad {path} is gone: the robot has stopped; the keys still work"
        self._pump.call(lambda: self._log_gone(path))

    def _log_gone(self, path: str) -> None:
        text = f"the gamepad {path} is gone: the robot was stopped"
        self._host.event(clock.now(), Severity.WARNING, "operator", EventKind.GAMEPAD_GONE, text)

    def _end(self, ending: Ending) -> None:
        self._pump.request_end(ending)

    def _direct(self, name: str, time_s: float) -> None:
        if self.operator.drive_mode is DriveMode.MANUAL:
            self.dead_man_switch.press(name, time_s)
        else:
            self.message = "press d first for manual driving"

    def _act(self, name: str) -> None:
        match name:
            case "ctrl+c":
                os.kill(os.getpid(), signal.SIGINT)
            case "g":
                self._start("g", "the plan", self.operator.start)
            case "d":
                self._start("d", "manual driving", self.operator.take_over)
            case "p":
                self._pause()
            case "r":
                self._on_resume()
            case "c":
                self._clear()
            case "m":
                self.mark()
            case "+" | "=":
                self.dead_man_switch.faster()
            case "-":
                self.dead_man_switch.slower()
            case _:
                pass

    def mark(self) -> None:
        """Record a mark with the present pose."""
        self.marks += 1
        number = self.marks

        def note() -> None:
            host = self._host
            pose = host.estimator.pose
            text = f"mark {number} at {pose.x_m:+.3f} m {pose.y_m:+.3f} m"
            host.event(
                clock.now(),
                Severity.INFO,
                "operator",
                EventKind.MARK,
                text,
                number=number,
                x_m=pose.x_m,
                y_m=pose.y_m,
                theta_rad=pose.theta_rad,
            )

        self._pump.call(note)
        self.message = f"mark {number} recorded"

    def _start(self, key: str, what: str, then: Callable[[], None]) -> None:
        mission = self._host.mission
        if isinstance(mission, OnboardMission):
            self.message = "the device runs its own planner: p pauses it, space stops it"
        elif self._pump.snapshot.mission.runner is not None:
            if key == "g" and not self.operator.has_plan:
                self.message = "drive has no planner; use sweepctl connect"
                return
            if key == "g" and not self._twice(key, "press g again to start the plan"):
                return
            then()
            self.message = _MODE_TEXT[self.operator.drive_mode]
        elif self._pump.snapshot.mission.phase is not Phase.WAITING:
            self.message = "the run cannot start now"
        elif self._reason_against() is None and self._twice(
            key, f"press {key} again to start {what}"
        ):
            then()
            clear, cause = self._clear_stop, self._clear_cause
            self._pump.call(
                lambda: mission.start(self.operator, clear_stop=clear, clear_cause=cause)
            )
            self._on_start()
            self.message = f"{what} starts after the gyro measurement at rest"

    def _reason_against(self) -> str | None:
        """Return the message why a start is impossible; None: a start is possible."""
        status = self._pump.snapshot.state.status
        if status is None:
            self.message = "no status from the device yet"
        elif not (self._clear_stop or status.stop_cause in {*_ORDERLY, self._clear_cause}):
            cause = label(StopCause, status.stop_cause)
            self.message = f"a stop is latched (cause: {cause}): look, then press c to clear it"
        else:
            return None
        return self.message

    def _clear(self) -> None:
        if self._twice("c", "look at the robot, then press c again to clear the stop"):
            status = self._pump.snapshot.state.status
            self._clear_cause = StopCause.NONE if status is None else status.stop_cause
            self.message = "the next start clears the stop"

    def _pause(self) -> None:
        mission = self._host.mission
        if isinstance(mission, OnboardMission):
            self._pause_onboard(mission)
        else:
            self.operator.toggle_pause()
            self.message = _MODE_TEXT[self.operator.drive_mode]

    def _pause_onboard(self, mission: OnboardMission) -> None:
        state = self._pump.snapshot.state.planner
        paused = state is not None and state.phase == PlannerPhase.PAUSED
        action = PlannerAction.RESUME if paused else PlannerAction.PAUSE
        fields = (int(action), int(mission.planner))
        host, what = self._host, action.name.lower()
        failed = EventKind.NOT_RESUMED if paused else EventKind.NOT_PAUSED

        def ended(outcome: Outcome | None) -> None:
            if outcome is not None and outcome.accepted:
                self.message = f"the device's planner has been {what}d"
                return
            reason = None if outcome is None else outcome.reason
            why = "it did not answer" if reason is None else rejection_text(reason)
            self.message = f"the device did not {what} its planner ({why}); space stops it"
            host.event(clock.now(), Severity.ERROR, "operator", failed, self.message)

        self.message = f"asking the device's planner to {what}"
        self._pump.call(lambda: host.commands.ask(PlannerCommand, fields, clock.now(), ended))

    def _twice(self, key: str, text: str) -> bool:
        armed, at_ns = self._armed
        now_ns = clock.now()
        if armed == key and now_ns - at_ns <= TWICE_NS:
            self._armed = ("", 0)
            return True
        self._armed = (key, now_ns)
        self.message = text
        return False

    def help(self, width: int) -> str:
        """Return the keys as a line of at most ``width`` characters, if possible."""
        if self.operator.drive_mode is DriveMode.MANUAL:
            held = "hold" if self.dead_man_switch.releases else "tap"
            each = "" if self.dead_man_switch.releases else f" ({PRESS_S:g} s each)"
            speed = f"{self.dead_man_switch.key_m_s:.2f} m/s"
            lines = [
                f"arrows: {held}{each} to drive, {speed}   +/-: speed   {_DRIVE_KEYS}",
                f"arrows: {held}{each}  {speed} +/-  space STOP  m mark  d leave  ^C end",
                f"space STOP  arrows: {held}  {speed} +/-  d leave  ^C end",
            ]
        else:
            lines = [
                _KEYS,
                "space STOP  g start  p pause  d drive  m mark  c clear  r resume  ^C end",
                "space STOP g start p pause d drive m mark c clear r resume",
            ]
        return next((line for line in lines if len(line) <= width), lines[-1])

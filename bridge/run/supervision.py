"""Carries out what the supervisor wants of a run: tell, slow down, hold, stop.

One :class:`Watch` per run, asked by the host at each control step. Where the host plans, it
scales or withholds the velocities; where the device plans for itself, it sets the device's
top speed and pauses its planner, by acknowledged commands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.observation import HALT, VelocityCommand
from bridge.run.mission import Ending, Phase
from bridge.run.onboard_mission import OnboardMission
from bridge.run.runner import hold, release
from bridge.session.records import Severity
from bridge.supervise import Level, Reaction, Watched
from protocol.messages import GetParameter, PlannerCommand, SetParameter, Stop
from protocol.values import NackReason, ParameterKind, PlannerAction, StopCause, label

if TYPE_CHECKING:
    from bridge.run.host import Host
    from bridge.session.parameters import Parameter
    from bridge.supervise import Supervisor
    from protocol.clock import HostNs
    from protocol.commands import Outcome

_SPEED = "max_speed"
GIVE_BACK_NS = 900_000_000
"""After a stop was asked for: longer, and the run would take it for not confirmed."""
_SEVERITY = {
    Level.TELL: Severity.WARNING,
    Level.SLOW: Severity.WARNING,
    Level.PAUSE: Severity.WARNING,
    Level.STOP: Severity.ERROR,
}


def go_on(host: Host, now_ns: HostNs) -> bool:
    """A person has looked: let a run go on that lost its device, or that supervision paused.

    False where nothing waits for that.
    """
    paused = host.watch is not None and host.watch.resume(now_ns)
    return host.mission.resume(now_ns / 1e9) or paused


class Watch:
    """One supervised run."""

    def __init__(self, host: Host, supervisor: Supervisor) -> None:
        """Begin with the first step of the drive."""
        self.supervisor = supervisor
        self._host = host
        mission = host.mission
        self._onboard = mission if isinstance(mission, OnboardMission) else None
        self._command = HALT
        self._watching = False
        self._paused = False
        self._speed: Parameter | None = None
        """The device's top speed, as it was before the run."""
        self._asked = False
        self._lacks = False
        """The device has no top speed that could be set."""
        self._factor = 1.0
        self._setting = False
        """A new top speed is on its way: one at a time, so that an old one cannot come last."""
        self._refused = False
        self._stop_ns = 0
        self._confirmed: Outcome | None = None
        """Of the run's stop, kept from the run until the top speed is as it was."""

    # ---- each control step ----------------------------------------------------------------

    def judge(self, command: VelocityCommand | None, now_ns: HostNs) -> VelocityCommand | None:
        """Look at this control step; the velocity to send, scaled or withheld."""
        host, onboard = self._host, self._onboard
        planner = host.state.planner
        if onboard is not None and planner is not None:
            onboard.on_planner(planner)
        if host.mission.phase is not Phase.DRIVING:
            self._watching = False
            self._command = HALT
            if self._confirmed is not None:
                self._give_back(self._confirmed, now_ns)
            return command
        if not self._watching:  # the first step, or the link is back
            self._watching = True
            self.supervisor.restart()
        for reaction in self.supervisor.step(self._watched(now_ns)):
            self._react(reaction, now_ns)
        if onboard is not None:
            self._limit(now_ns)
            return command
        if command is None:
            return None
        if host.mission.ending is not None:  # stopped just now
            return HALT
        factor = 0.0 if self.supervisor.holding else self.supervisor.factor
        if factor != 1.0:
            command = VelocityCommand(command.v_m_s * factor, command.yaw_rate_rad_s * factor)
        self._command = command
        return command

    def _watched(self, now_ns: HostNs) -> Watched:
        host, onboard = self._host, self._onboard
        state, estimator, hello = host.state, host.estimator, host.hello
        return Watched(
            now_ns / 1e9,
            estimator.pose,
            estimator.v_m_s,
            estimator.yaw_rate_rad_s,
            estimator.wheel_scale,
            host.session.heard_ns / 1e9,
            None if hello is None else hello.boot_id,
            state.imu,
            state.encoders,
            state.range,
            state.power,
            state.status,
            state.planner,
            state.arrived_s,
            self._command if onboard is None else None,
            "" if onboard is None else onboard.planner.name.lower().replace("_", "-"),
        )

    # ---- reactions ------------------------------------------------------------------------

    def _react(self, reaction: Reaction, now_ns: HostNs) -> None:
        level = reaction.level
        self._host.event(
            now_ns,
            _SEVERITY.get(level, Severity.WARNING),
            "supervise",
            reaction.kind,
            reaction.text,
            **{**reaction.data, "level": level.name.lower()},
        )
        if level is Level.PAUSE:
            self._pause(now_ns)
        elif level is Level.STOP:
            ending = Ending("stopped", f"supervise: {reaction.text}", 5, StopCause.SUPERVISE)
            self._host.mission.request_end(ending, now_ns / 1e9)

    def _pause(self, now_ns: HostNs) -> None:
        if self._paused:
            return
        self._paused = True
        text = "the run is paused; look, then let it go on (key r), or stop it"
        self._host.event(now_ns, Severity.WARNING, "supervise", "paused", text)
        if self._onboard is not None:
            self._plan(PlannerAction.PAUSE, now_ns)
        else:
            hold(self._host.mission.runner)

    def resume(self, now_ns: HostNs) -> bool:
        """Go on after a pause: a person has looked. False where nothing was paused."""
        if not self._paused:
            return False
        self._paused = False
        self.supervisor.resume(now_ns / 1e9)
        self._host.event(now_ns, Severity.INFO, "supervise", "resumed", "the run goes on")
        if self._onboard is not None:
            self._plan(PlannerAction.RESUME, now_ns)
        else:
            release(self._host.mission.runner)
        return True

    def _plan(self, action: PlannerAction, now_ns: HostNs) -> None:
        assert self._onboard is not None  # noqa: S101 - asked by the caller
        fields = (int(action), int(self._onboard.planner))
        what = f"planner {action.name.lower()}"
        self._host.dialogue.ask(
            PlannerCommand, fields, now_ns, lambda outcome: self._ended(what, outcome, now_ns)
        )

    def _ended(self, what: str, outcome: Outcome | None, now_ns: HostNs) -> None:
        """A pause that the device does not obey leaves only the stop."""
        if (outcome is not None and outcome.accepted) or self._host.mission.ending is not None:
            return
        reason = None if outcome is None else outcome.reason
        why = "no answer" if reason is None else label(NackReason, reason)
        text = f"supervise: the device did not obey {what}: {why}"
        ending = Ending("stopped", text, 5, StopCause.SUPERVISE)
        self._host.mission.request_end(ending, now_ns / 1e9)

    # ---- the device's top speed -----------------------------------------------------------

    def _limit(self, now_ns: HostNs) -> None:
        """Have the device keep to the supervisor's factor."""
        dialogue = self._host.dialogue
        if self._speed is None:
            known = {p.name: p for p in dialogue.parameters.values()}
            self._speed = known.get(_SPEED)
            if self._speed is None and not self._asked:
                self._asked = True
                self._find(0, now_ns)
            if self._lacks and self.supervisor.factor != 1.0:
                text = f"supervise: the device cannot be slowed down: it has no {_SPEED}"
                ending = Ending("stopped", text, 5, StopCause.SUPERVISE)
                self._host.mission.request_end(ending, now_ns / 1e9)
            return
        self._set(self.supervisor.factor, now_ns)

    def ending(self, now_ns: HostNs) -> None:
        """A stop of the run is being sent; its own acknowledgement is the one that counts."""
        self._stop_ns = now_ns
        self._confirmed = None

    def keeps(self, outcome: Outcome, now_ns: HostNs) -> bool:
        """Take over the device's word that it stands: only now its top speed goes back.

        True: the run is told of it from here, when that is done or has taken too long.
        """
        message, mission = outcome.message, self._host.mission
        if self._speed is None or mission.phase is not Phase.ENDING:
            return False
        if not isinstance(message, Stop) or not outcome.accepted:
            return False
        if message.cause < mission.stop_cause:
            return False  # a graver stop is on its way
        self._confirmed = outcome
        self._give_back(outcome, now_ns)
        return True

    def _give_back(self, confirmed: Outcome, now_ns: HostNs) -> None:
        if not self._refused and now_ns - self._stop_ns < GIVE_BACK_NS:
            self._set(1.0, now_ns)
            if self._setting:
                return  # asked again at the next control step
        self._confirmed = None
        if self._setting or self._factor != 1.0:
            text = (
                f"the device was not told its own {_SPEED} again: it drives slowly until a reboot"
            )
            self._host.event(now_ns, Severity.WARNING, "supervise", "slow_left", text)
        self._host.mission.on_command(confirmed, now_ns / 1e9)

    def _set(self, factor: float, now_ns: HostNs) -> None:
        model, speed = self._host.model, self._speed
        if factor == self._factor or speed is None or self._setting:
            return
        before, self._factor, self._setting = self._factor, factor, True
        wanted = speed.value if factor == 1.0 else factor * model.cruise_speed_m_s
        raw = speed.raw(max(speed.low, min(wanted, speed.high)))

        def ended(outcome: Outcome | None) -> None:
            self._setting = False
            self._refused = outcome is None or not outcome.accepted
            if self._refused:
                self._factor = before
            if self._confirmed is None:
                self._ended(f"set {_SPEED}", outcome, now_ns)

        self._host.dialogue.ask(SetParameter, (speed.number, ParameterKind.F32, raw), now_ns, ended)

    def _find(self, number: int, now_ns: HostNs) -> None:
        """Ask for one parameter after the other until it is the one, or there are no more."""

        def told(outcome: Outcome | None) -> None:
            dialogue = self._host.dialogue
            known = dialogue.parameters.get(number)
            more = number + 1 < (dialogue.parameter_count or 0)
            found = known is not None and known.name == _SPEED
            if found:
                return
            if outcome is not None and outcome.accepted and more:
                self._find(number + 1, now_ns)
            else:
                self._lacks = True

        self._host.dialogue.ask(GetParameter, (number,), now_ns, told)

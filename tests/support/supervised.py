"""A virtual sweeper that moves, and the supervisor that watches it, in virtual time.

The device runs its own planner, or the host's does; every byte through the codec. Reactions
are kept, and what they ask for is not done unless the test says so: a campaign wants to see
what comes after the first alarm too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.supervise import Reaction, Supervisor, Watched
from protocol.catalogue import CATALOGUE
from protocol.messages import PlannerCommand, PlannerState
from protocol.values import Mode, OnboardPlanner, PlannerAction, PlannerPhase, StopCause
from tools.virtual_settings import Settings
from tools.virtual_sweeper import SimulatedSweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.supervise import SuperviseSettings
    from protocol.message import Message

STEP_US = 20_000
_NUMBERS = {
    "paper": OnboardPlanner.PAPER,
    "recovery": OnboardPlanner.RECOVERY,
    "u-shape": OnboardPlanner.U_SHAPE,
    "random": OnboardPlanner.RANDOM,
}
ENDED = {PlannerPhase.FINISHED, PlannerPhase.ABORTED}


@dataclass
class Alarm:
    """A reaction and when it came."""

    time_s: float
    """Since the device was switched on."""
    reaction: Reaction


@dataclass
class Watch:
    """What came of a watched run."""

    alarms: list[Alarm] = field(default_factory=list)
    watched_s: float = 0.0
    started_s: float = 0.0
    ended: str = ""

    def of(self, *kinds: str) -> list[Alarm]:
        """Alarms of these rules."""
        return [a for a in self.alarms if a.reaction.kind in kinds]


class Supervised(SimulatedSweeper):
    """A sweeper whose own planner is started and watched."""

    def __init__(
        self,
        planner: str,
        settings: Settings | None = None,
        rules: SuperviseSettings | None = None,
    ) -> None:
        self.watch = Watch()
        self.on_step: Callable[[Watched], None] = lambda _: None
        self._planner_name = planner
        self._watching = False
        self._next_us = 0
        super().__init__(settings)
        self.supervisor = Supervisor(self.model, rules)
        self.told: PlannerState | None = None
        self.told_s = 0.0
        self._seen = None
        listeners = self.host._listeners  # noqa: SLF001 - stands in for the host's own wiring
        listeners[PlannerState] = self._hear_planner

    def _hear_planner(self, message: Message, _device_us: int, now_ns: int) -> None:
        assert isinstance(message, PlannerState)
        self.told, self.told_s = message, now_ns / 1e9

    def start(self) -> None:
        """Let the device's planner begin."""
        session = self.host.session
        session.clear_stop(StopCause.SESSION_END, self._host_ns)
        self.run(0.2)
        session.set_mode(Mode.ONBOARD, self._host_ns)
        self.run(0.2)
        number = _NUMBERS[self._planner_name]
        session._outbox.command(  # noqa: SLF001 - as above
            lambda i: PlannerCommand(i, PlannerAction.START, number),
            CATALOGUE.by_class[PlannerCommand].type_id,
            self._host_ns,
            forever=False,
        )
        self.run(0.2)
        self._watching = True
        self._next_us = self._now_us
        self.watch.started_s = self.time_s

    def watch_for(self, duration_s: float) -> Watch:
        """Let time pass until the planner has ended, or the time is up."""
        begun_s = self.time_s
        self.run(duration_s, until=self._over)
        self.watch.watched_s += self.time_s - begun_s
        return self.watch

    def _over(self) -> bool:
        told = self.told
        return (told is not None and told.phase in ENDED) or self.host.mission.done

    def _step(self, end_us: int) -> None:
        super()._step(end_us)
        if self._watching and self._now_us >= self._next_us:
            self._next_us += STEP_US
            if self._next_us <= self._now_us:
                self._next_us = self._now_us + STEP_US
            self._supervise()

    def _supervise(self) -> None:
        host = self.host
        state, estimator = host.state, host.estimator
        if state.range is not self._seen and state.range is not None:
            self._seen = state.range
            host._walls.update(  # noqa: SLF001 - as the host does for a run of its own
                state.range.ultrasonic_m,
                state.range.infrared_left_m,
                state.range.infrared_right_m,
                touching=state.range.contacts & 3 != 0,
                t_s=host.encoders_us * 1e-6,
            )
        arrived = dict(state.arrived_s)
        if self.told is not None:
            arrived[PlannerState] = self.told_s
        watched = Watched(
            self._host_ns / 1e9,
            estimator.pose,
            estimator.v_m_s,
            estimator.yaw_rate_rad_s,
            estimator.wheel_scale,
            host.session.heard_ns / 1e9,
            None if host.hello is None else host.hello.boot_id,
            state.imu,
            state.encoders,
            state.range,
            state.power,
            state.status,
            self.told,
            arrived,
            None,
            self._planner_name,
        )
        self.on_step(watched)
        for reaction in self.supervisor.step(watched):
            self.watch.alarms.append(Alarm(self.time_s, reaction))

"""Runner for an operator, who starts, pauses or takes over a plan, or drives manually.

One runner is used for the whole run, so that motion is enabled only once. It selects the source of
motion: none, the plan, or the operator. :class:`bridge.run.mission.Mission` handles stops, stale
data and the end of the run.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

from bridge.coverage.planner import PlannerEvent, PlannerState
from bridge.motion.control.smoothing import VelocitySmoother
from bridge.motion.control.tuning import MotionTuning
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.run.host import CONTROL_PERIOD_NS

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.runner import PlanRunner
    from bridge.motion.robot_model import RobotModel
    from bridge.run.dead_man_switch import DeadManSwitch

_STEP_S = CONTROL_PERIOD_NS / 1e9
"""Control period, s."""


class DriveMode(Enum):
    """Source of the robot's motion."""

    NOTHING = "nothing"
    PLAN = "plan"
    HELD = "held"
    """The plan is paused."""
    MANUAL = "manual"


_STATES = {drive_mode: PlannerState(drive_mode.value) for drive_mode in DriveMode}


class Operator:
    """Runner that an operator controls.

    The loop's thread calls :meth:`step`. The operator's calls may come from another thread, so a
    lock makes each call atomic.
    """

    def __init__(
        self,
        model: RobotModel,
        dead_man_switch: DeadManSwitch,
        *,
        plan: PlanRunner | None = None,
        make_plan: Callable[[], PlanRunner] | None = None,
        manual: bool = False,
    ) -> None:
        """Begin with ``plan`` if given, else without motion.

        Args:
            model: the robot.
            dead_man_switch: converts the operator's input to velocities.
            plan: plan that drives at once.
            make_plan: creates a plan at :meth:`start`.
            manual: begin with manual driving. A plan is then paused.

        """
        self.dead_man_switch = dead_man_switch
        self._plan, self._make_plan = plan, make_plan
        self._drive_mode = DriveMode.PLAN if plan is not None else DriveMode.NOTHING
        if manual:
            self._drive_mode = DriveMode.MANUAL
        self._target = HALT
        lowpass = MotionTuning().lowpass
        self._smooth_v = VelocitySmoother(model.max_accel_m_s2, lowpass)
        self._smooth_w = VelocitySmoother(model.max_yaw_accel_rad_s2, lowpass)
        self._events: list[PlannerEvent] = []
        self._lock = threading.RLock()
        if self._drive_mode is DriveMode.MANUAL and self._plan is not None:
            self._plan.pause()

    # ---- operator's requests --------------------------------------------------------------

    @property
    def drive_mode(self) -> DriveMode:
        """Present source of the robot's motion."""
        return self._drive_mode

    @property
    def follows_plan(self) -> bool:
        """True if the plan drives, not the operator."""
        return self._drive_mode is DriveMode.PLAN

    @property
    def has_plan(self) -> bool:
        """True if a plan exists or can be created."""
        return self._plan is not None or self._make_plan is not None

    def start(self) -> None:
        """Start the plan, or resume it."""
        made = None
        if self._plan is None and self._make_plan is not None:
            made = self._make_plan()  # no lock: it takes 0.1 s, and the loop must run
        with self._lock:
            if self._plan is None:
                self._plan = made
            if self._plan is None:
                return
            self.dead_man_switch.release_all()
            self._plan.resume()
            self._go(DriveMode.PLAN, "the plan drives")

    def toggle_pause(self) -> None:
        """Pause the plan; if paused, resume it."""
        with self._lock:
            if self._drive_mode is DriveMode.PLAN and self._plan is not None:
                self._plan.pause()
                self._go(DriveMode.HELD, "the plan is paused")
            elif self._drive_mode is DriveMode.HELD:
                self.start()

    def take_over(self) -> None:
        """Switch to manual driving; if already manual, switch back."""
        with self._lock:
            if self._drive_mode is DriveMode.MANUAL:
                self.dead_man_switch.release_all()
                held = self._plan is not None
                self._go(DriveMode.HELD if held else DriveMode.NOTHING, "manual driving ended")
                return
            if self._plan is not None:
                self._plan.pause()
            self._go(DriveMode.MANUAL, "manual driving")

    def _go(self, drive_mode: DriveMode, text: str) -> None:
        self._drive_mode = drive_mode
        self._events.append(PlannerEvent("operator", text))

    # ---- runner -----------------------------------------------------------------------------

    def pause(self) -> None:
        """Pause the plan for supervision or after a loss; the operator's choice stays."""
        with self._lock:
            if self._plan is not None:
                self._plan.pause()

    def resume(self) -> None:
        """Continue the plan, unless the operator has paused it."""
        with self._lock:
            if self._drive_mode is DriveMode.PLAN and self._plan is not None:
                self._plan.resume()

    @property
    def finished(self) -> bool:
        """True if the plan has ended."""
        return self._drive_mode is DriveMode.PLAN and self._plan is not None and self._plan.finished

    @property
    def finish_reason(self) -> str | None:
        """Reason of the plan's end."""
        return None if self._plan is None else self._plan.finish_reason

    @property
    def turns(self) -> int:
        """Number of turns in place of the plan."""
        return 0 if self._plan is None else self._plan.turns

    @property
    def lane_length_m(self) -> float:
        """Total length of the plan's lanes, m (eq. 8)."""
        return 0.0 if self._plan is None else self._plan.lane_length_m

    @property
    def state(self) -> PlannerState:
        """State of the plan, or of the other source of motion."""
        if self._plan is None or self._drive_mode is DriveMode.NOTHING:
            return _STATES[self._drive_mode]
        if self._drive_mode is DriveMode.PLAN:
            return self._plan.state
        return replace(self._plan.state, state=self._drive_mode.value)

    @property
    def target(self) -> VelocityCommand:
        """Target velocity before smoothing."""
        if self._drive_mode is DriveMode.PLAN and self._plan is not None:
            return self._plan.target
        return self._target

    def step(self, obs: Observation) -> VelocityCommand:
        """Return the velocity setpoint of one control step."""
        with self._lock:
            return self._step(obs)

    def _step(self, obs: Observation) -> VelocityCommand:
        drive_mode = self._drive_mode
        if drive_mode is DriveMode.PLAN and self._plan is not None:
            return self._plan.step(obs)
        if drive_mode is not DriveMode.MANUAL:
            return self._halt()
        wanted = self.dead_man_switch.wanted(obs.time_s)
        if wanted.v_m_s > 0.0 and (obs.bumper_left or obs.bumper_right or obs.cliff):
            wanted = VelocityCommand(0.0, wanted.yaw_rate_rad_s)  # allow only reversing
        self._target = wanted
        if wanted == HALT:
            return self._halt()  # the device's own ramp stops fastest
        return VelocityCommand(
            self._smooth_v.update(wanted.v_m_s, _STEP_S),
            self._smooth_w.update(wanted.yaw_rate_rad_s, _STEP_S),
        )

    def _halt(self) -> VelocityCommand:
        self._target = HALT
        self._smooth_v.reset()
        self._smooth_w.reset()
        return HALT

    def drain_events(self) -> list[PlannerEvent]:
        """Return the events since the last call."""
        with self._lock:
            events, self._events = self._events, []
        return events if self._plan is None else [*events, *self._plan.drain_events()]

"""Motion control of the device: modes, stop latch, watchdogs, onboard planner, wheel control."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.values import Fault, LogLevel, NackReason, StopCause, flag_labels, label
from sim_device.device.health import IMU, Health
from sim_device.device.latch import StopLatch
from sim_device.device.modes import MODE_OF, PLANNING, DeviceState, Event, Guard
from sim_device.device.motor_drivers import MotorDrivers
from sim_device.device.onboard import NO_PLAN, Onboard, planner_name
from sim_device.device.reflexes import Reflexes
from sim_device.device.watchdog import DutyWatchdog, SetpointWatchdog
from sim_device.device.wheel_control import WheelControl
from sim_device.sensors.power_monitor import PowerReading

if TYPE_CHECKING:
    from collections.abc import Collection

    from bridge.motion.robot_model import RobotModel
    from protocol.messages.device import PlannerState
    from protocol.messages.values import Mode
    from sim_device.device.log_lines import LogLines
    from sim_device.device.modes import ModeMachine
    from sim_device.device.parameters import ParameterStore
    from sim_device.device.sampling import Around, Sampler
    from sim_device.device.watchdog import Watchdog

_BRINGUP, _VELOCITY, _STOPPED = DeviceState.BRINGUP, DeviceState.VELOCITY, DeviceState.STOPPED
_EXPIRED, _LIMITED, _DRIVERS_OFF = (
    int(Fault.SETPOINT_EXPIRED),
    int(Fault.LIMITED),
    int(Fault.DRIVERS_OFF),
)
_SET_OFF = frozenset({Event.SET_ONBOARD, Event.START, Event.RESUME})
"""Events that start or resume the device's own planner. They require a working IMU, because no host
checks the heading."""


class Control:
    """Computes motor duties from commands; one instance per boot."""

    def __init__(
        self,
        model: RobotModel,
        parameters: ParameterStore,
        modes: ModeMachine,
        log: LogLines,
        seed: int,
    ) -> None:
        """Start at rest. ``seed`` is for planners that use random numbers."""
        self.modes = modes
        self.latch = StopLatch()
        self.setpoints = SetpointWatchdog()
        self.duties = DutyWatchdog()
        self.health = Health(has_ultrasonic=model.ultrasonic.fitted)
        self.reflexes = Reflexes()
        self.drivers = MotorDrivers()
        self.onboard: Onboard | None = None
        """The running plan, or the last one."""
        self._log = log
        self._seed = seed
        self._expired = 0
        self._logged_bits = 0
        self._now_us = 0
        self.power = PowerReading(model.battery_v, 0.0, 0.0, 0.0)
        """Last measurement of the supply."""
        self._supply_v = model.battery_v
        self._base = model
        self._parameters = parameters
        self._model = parameters.applied_to(model)
        self.wheels = WheelControl(self._model, parameters.value("stop_deceleration"))
        self.apply_parameters()

    def apply_parameters(self) -> None:
        """Apply the parameters that take effect at once."""
        parameters = self._parameters
        self._model = parameters.applied_to(self._base)
        self.wheels.limit(self._model, parameters.value("stop_deceleration"))
        self.reflexes.at_cliff = parameters.value("cliff_reflex") != 0.0
        self.reflexes.at_bumper = parameters.value("bumper_reflex") != 0.0
        self._low_v = parameters.value("battery_low")
        self._empty_v = parameters.value("battery_empty")

    # ---- present state -----------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """Mode as in the status message."""
        return MODE_OF[self.modes.state]

    @property
    def fault_bits(self) -> int:
        """Fault bits (``protocol.messages.values.Fault``)."""
        bits = self.health.bits | self._expired
        if self.reflexes.limited:
            bits |= _LIMITED
        return bits if self.drivers.enabled else bits | _DRIVERS_OFF

    @property
    def watchdog(self) -> Watchdog:
        """Watchdog of the host's cyclic message in the present mode."""
        return self.duties if self.modes.state is DeviceState.BRINGUP else self.setpoints

    def planner_state(self) -> PlannerState:
        """State of the running plan, or of the last one."""
        return NO_PLAN if self.onboard is None else self.onboard.message()

    # ---- events ---------------------------------------------------------------------------

    def fire(
        self, event: Event, holding: Collection[Guard] = (), *, planner: str = ""
    ) -> NackReason | None:
        """Apply an event by the mode table; return the reason of a rejection, or None."""
        before = self.modes.state
        held = self._is_prevented(event)
        outcome = self.modes.fire(event, (*holding, Guard.FAULT_HOLDS) if held else holding)
        if not isinstance(outcome, DeviceState):
            return outcome
        if event is Event.START:
            self.onboard = Onboard(self._model, planner, self._seed, self._now_us)
            self._log.add(LogLevel.INFO, f"planner {planner}: at rest first, for the gyro")
        elif event is Event.PAUSE and self.onboard is not None:
            self.onboard.pause()
        elif event is Event.RESUME and self.onboard is not None:
            self.onboard.resume()
        elif before in PLANNING and self.onboard is not None:
            self._end_plan(self.onboard)
        self.setpoints.halt()
        self.duties.halt()
        return None

    def _is_prevented(self, event: Event) -> bool:
        """Return whether a present fault can prevent an event; the mode table decides.

        A fault of the inertial sensor prevents only onboard mode, and start and resumption of a
        plan.
        """
        health = self.health
        return health.stopping is not None or (event in _SET_OFF and bool(health.bits & IMU))

    def _end_plan(self, plan: Onboard) -> None:
        plan.end()
        reason = plan.finish_reason
        how = "aborted" if reason is None else f"finished: {reason}"
        self._log.add(LogLevel.INFO, f"planner {plan.planner} {how}")

    def stop(self, cause: int, event: Event = Event.STOP) -> None:
        """Latch a stop and leave any driving mode.

        For an event other than ``STOP``, the mode table may define no change: a lost link after a
        clean session end does not replace the latched cause.
        """
        self.fire(event)
        if self.modes.state is DeviceState.STOPPED and (
            event is Event.STOP or not self.latch.latched
        ):
            self._latch(cause)

    def _latch(self, cause: int) -> None:
        if self.latch.latch(cause):
            self._log.add(LogLevel.WARNING, f"stop latched: {label(StopCause, self.latch.cause)}")

    def clear(self, cause: int) -> NackReason | None:
        """Release the latch if ``cause`` is the latched cause and its condition has ended."""
        holding = []
        if cause != self.latch.cause:
            holding.append(Guard.OTHER_CAUSE)
        if cause == StopCause.HARDWARE and self.health.stopping is not None:
            holding.append(Guard.CAUSE_HOLDS)
        was = self.modes.state
        reason = self.fire(Event.CLEAR, holding)
        if reason is None and was is DeviceState.STOPPED and self.latch.clear(cause):
            self._log.add(LogLevel.INFO, f"stop cleared: {label(StopCause, cause)}")
        return reason

    def start(self, number: int) -> NackReason | None:
        """Start the planner with this number."""
        name = planner_name(number)
        holding = () if name is not None else (Guard.NO_PLANNER,)
        return self.fire(Event.START, holding, planner=name or "")

    def forget_host(self) -> None:
        """Discard everything that a session has sent."""
        self.setpoints.reset()
        self.duties.reset()

    # ---- time -----------------------------------------------------------------------------

    def tick(
        self, tick: int, now_us: int, sampler: Sampler, around: Around | None
    ) -> tuple[float, float]:
        """Run one control period; return the left and the right duty."""
        self._now_us = now_us
        health, wheels, counts, state = self.health, self.wheels, sampler.counts, self.modes.state
        watchdog: Watchdog = self.duties if state is _BRINGUP else self.setpoints
        if watchdog.until_us <= now_us and watchdog.expired(now_us):
            self._expired = _EXPIRED
        elif self._expired and watchdog.left_us(now_us):
            self._expired = 0
        if state is _VELOCITY and not self.latch.cause and watchdog.until_us > now_us:
            v, yaw = self.setpoints.wanted
            v = self.reflexes.limit(v, sampler.contacts(), counts)
            duties = wheels.step(v, yaw, counts, self._supply_v)
        else:
            duties = self._drive(tick, now_us, sampler, around)
        self.drivers.switch(state, duties, wheels)
        health.tick(sampler.imu_nominal, counts, wheels, duties)
        if around is not None:
            health.on_around(around, self._model.wheel_base_m, self._model.metres_per_count)
        if health.bits != self._logged_bits:
            self._log_faults(health.bits)
        if self.modes.state is not _STOPPED:
            self._judge()
        return duties

    def _drive(
        self, tick: int, now_us: int, sampler: Sampler, around: Around | None
    ) -> tuple[float, float]:
        """Return the duties when there is no valid velocity setpoint, or a stop is latched."""
        counts = sampler.counts
        if not self.latch.cause:
            if self.modes.state is DeviceState.BRINGUP:
                self.reflexes.rest()
                duties = self.duties.duties
                self.wheels.coast(counts, duties)
                return duties
            if self.modes.planning and self.onboard is not None:
                v, yaw = self._run(self.onboard, tick, now_us, sampler, around)
                v = self.reflexes.limit(v, sampler.contacts(), counts)
                return self.wheels.step(v, yaw, counts, self._supply_v)
        self.reflexes.rest()
        return self.wheels.release(counts)

    def _run(
        self, plan: Onboard, tick: int, now_us: int, sampler: Sampler, around: Around | None
    ) -> tuple[float, float]:
        wanted = plan.step(tick, now_us, sampler, around)
        for line in plan.drain_decisions():
            self._log.add(LogLevel.INFO, line)
        if plan.finish_reason is not None:
            self.fire(Event.FINISHED)
        return wanted

    def on_power(self, reading: PowerReading) -> None:
        """Process a reading of the supply."""
        self.power, self._supply_v = reading, reading.battery_v

    def check_power(self) -> None:
        """Check the newest reading of the supply; called at 5 Hz, whatever the stream's rate."""
        self.health.on_power(self.power, self._low_v, self._empty_v)

    def _judge(self) -> None:
        """Stop any motion that is unsafe with the present faults."""
        health = self.health
        if not (health.bits or health.battery_empty or self.reflexes.counting):
            return
        why = health.stopping
        if why is None and self.reflexes.over(self._model.metres_per_count):
            why = "no floor ahead"
        if why is None and health.stalled_too_long(self.wheels):
            why = "motor stalled"
        if why is None and health.bits & IMU and self.modes.state in PLANNING:
            why = "no heading"
        if why is None:
            return
        before = self.modes.state
        self.stop(StopCause.HARDWARE, Event.FAULT)
        if self.modes.state is not before:
            self._log.add(LogLevel.ERROR, f"stopped by itself: {why}")

    def _log_faults(self, bits: int) -> None:
        new, gone = bits & ~self._logged_bits, self._logged_bits & ~bits
        self._logged_bits = bits
        if new:
            self._log.add(LogLevel.WARNING, f"fault: {', '.join(flag_labels(Fault, new))}")
        if gone:
            self._log.add(LogLevel.INFO, f"fault gone: {', '.join(flag_labels(Fault, gone))}")

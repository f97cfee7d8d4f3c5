"""The virtual sweeper's firmware: session, commands, safety, wheel control and streams.

Sans-I/O like the firmware on the chip: it is told the device's microseconds, given bytes
and sensor readings, and gives bytes and duties. One control tick is 10 ms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.agreement import describe
from protocol.catalogue import CATALOGUE, Catalogue
from protocol.codec import Codec
from protocol.commands import CommandLog
from protocol.link import NODE_ALL, Link, LinkBase, Received
from protocol.message import Direction
from protocol.messages import (
    Ack,
    Describe,
    GetParameter,
    Hello,
    HostHello,
    LinkCounters,
    LogText,
    SetParameter,
    Status,
    Stop,
    Sync,
    TimeReply,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.values import (
    Capability,
    Fault,
    LogLevel,
    Mode,
    RebootKind,
    ResetCause,
    StopCause,
    label,
)
from sim_device import parameters, streams
from sim_device.commands import COMMANDS, carry_out
from sim_device.parameters import ParameterStore
from sim_device.power import PowerReading
from sim_device.safety import (
    HOST_SILENCE_US,
    DutyWatchdog,
    Freshness,
    SetpointWatchdog,
    StopLatch,
    Watchdog,
)
from sim_device.versions import as_declared, as_ours, blank
from sim_device.wheel_control import WheelControl

if TYPE_CHECKING:
    from collections.abc import MutableMapping

    from bridge.motion.robot_model import RobotModel
    from protocol.message import Message, MessageSpec
    from protocol.uart import Frame
    from sim_device.streams import Sensors

TICK_US = 1_000_000 // streams.TICK_HZ
HELLO_TICKS = 100
LOG_PERIOD_US = 100_000
"""At most ten log lines a second; what waits longer is dropped, oldest first."""
LOG_WAITING = 16
STRANGE_PERIOD_US = 100_000
LOG_BYTES = 120
"""A line's length on the wire, whatever name a host gives itself."""
POWER_TICKS, POWER_PHASE = 20, 5
"""The supply is measured at 5 Hz, with the stream's default phase."""
TICK_WORK_US = 400
FRAME_WORK_US = 25
"""Assumed cost on a 168 MHz Cortex-M4 of a control period and of a frame, for ``load``."""
LOAD_TICKS = 10
NAME = "virtual sweeper"
VERSION = (0, 1, 0)
CAPABILITIES = (
    Capability.ENCODERS
    | Capability.IMU
    | Capability.ULTRASONIC
    | Capability.INFRARED
    | Capability.BUMPER
    | Capability.CLIFF
)


@dataclass(frozen=True, slots=True)
class Identity:
    """What tells this device and this boot from others."""

    node: int
    uid: bytes
    boot_id: int
    reset_cause: ResetCause = ResetCause.POWER_ON


class Firmware:
    """The device's program, one instance per boot."""

    def __init__(  # noqa: PLR0913 - what a boot finds
        self,
        model: RobotModel,
        identity: Identity,
        sensors: Sensors,
        catalogue: Catalogue = CATALOGUE,
        *,
        stored: MutableMapping[str, int] | None = None,
        link: type[LinkBase] = Link,
    ) -> None:
        """Boot.

        ``catalogue`` is what this firmware's version of the project declares, ``stored`` the
        memory in which parameters outlive a boot, ``link`` what it is connected by.
        """
        self.identity = identity
        self.mode = Mode.IDLE
        self.latch = StopLatch()
        self.agreed = False
        self.session_id = 0
        self.faults = Fault(0)
        self.link = link(Direction.DEVICE, codec=Codec(catalogue))
        self.parameters = ParameterStore(
            parameters.table(model, identity.node), {} if stored is None else stored
        )
        self.wheels = WheelControl(
            self.parameters.applied_to(model), self.parameters.value("stop_deceleration")
        )
        self.watchdog = SetpointWatchdog()
        self.duty_watchdog = DutyWatchdog()
        self.schedule = streams.Schedule(catalogue, int(CAPABILITIES))
        self.reboot_wanted: RebootKind | None = None
        """Set once a reboot was accepted; whoever runs the firmware boots it anew."""
        self._model = model
        self._sensors = sensors
        self._freshness = Freshness()
        self._commands = CommandLog()
        self._heard_us = 0
        self._stale = 0
        self._strange_us = -STRANGE_PERIOD_US
        self._log: list[LogText] = []
        self._logged_us = -LOG_PERIOD_US
        self._supply_v = model.battery_v
        self._battery_low_v = self.parameters.value("battery_low")
        self._power = PowerReading(self._supply_v, 0.0, 0.0, 0.0)
        self._load_percent = 0
        self._frames_before = 0

    # ---- the wire -------------------------------------------------------------------------

    def receive(self, data: bytes, now_us: int) -> None:
        """Take bytes that arrived at ``now_us``."""
        for event in self.link.receive(data, now_us):
            if isinstance(event, Received) and event.frame.node in {
                self.identity.node,
                NODE_ALL,
            }:
                self._heard_us = now_us
                self._handle(as_ours(event.message, event.spec), event.frame, now_us)

    def data_to_send(self) -> bytes:
        """Bytes for the port."""
        return self.link.data_to_send()

    def _send(self, message: Message, t_us: int) -> None:
        declared = as_declared(message, self.link.codec.catalogue)
        if declared is not None:
            self.link.send(declared, t_us, node=self.identity.node)

    def _handle(self, message: Message, frame: Frame, now_us: int) -> None:
        if isinstance(message, HostHello):
            self._open(message, now_us)
        extra_us = self._freshness.extra_delay_us(frame.t_us, now_us)
        match message:
            case VelocitySetpoint() | TimeRequest() if not self.session_id:
                self._strange(now_us)
            case VelocitySetpoint():
                self._setpoint(message, extra_us, now_us)
            case WheelDuty():
                self._duty(message, extra_us, now_us)
            case TimeRequest():
                self._send(TimeReply(message.ping, now_us & 0xFFFF_FFFF), now_us)
            case Describe():
                self._describe(message, now_us)
            case Stop():
                # Obeyed before any question of session or repetition.
                self.stop(_cause(message.cause))
                self._send(Ack(message.command_id, frame.type_id), now_us)
            case _ if isinstance(message, COMMANDS):
                self._command(message, frame.type_id, now_us)
            case _:
                pass

    def _command(self, message: Message, type_id: int, now_us: int) -> None:
        reply = self._commands.once(
            self.session_id, type_id, message, lambda: carry_out(self, message)
        )
        if isinstance(message, GetParameter | SetParameter) and isinstance(reply, Ack):
            # For a repeated command too: its value may be what was lost.
            value = self.parameters.describe(message.parameter)
            if value is not None:
                self._send(value, now_us)
        self._send(reply, now_us)

    def _describe(self, question: Describe, now_us: int) -> None:
        codec = self.link.codec
        self._send(describe(codec.catalogue, question), now_us)
        spec = codec.catalogue.by_type.get(question.described_type)
        if spec is not None and spec.direction is Direction.HOST:
            # An older host leaves out our last fields; one that differs will not send it at all.
            fewer = question.field_count < len(spec.fields)
            codec.limit(spec.type_id, question.field_count if fewer else None)

    # ---- session --------------------------------------------------------------------------

    def _strange(self, now_us: int) -> None:
        """A host talks on in a session that we do not know: say at once who and which boot."""
        if now_us - self._strange_us >= STRANGE_PERIOD_US:
            self._strange_us = now_us
            self._hello(now_us)

    def _open(self, hello: HostHello, now_us: int) -> None:
        if not hello.session_id:
            return  # 0 says "no session", whose host is never missed
        if hello.session_id != self.session_id:
            if self.session_id:
                self.stop(StopCause.LINK, only_if_free=True)
            self.session_id = hello.session_id
            self.link.forget_sequence()  # another host, or the same begun anew
            self._forget_host()
        if hello.agreed and not self.agreed:
            self.agreed = True
            self.log(LogLevel.INFO, f"session with {hello.name}")
        self._hello(now_us)

    def _hello(self, now_us: int) -> None:
        identity = self.identity
        self._send(
            Hello(
                self.link.codec.catalogue.hash,
                identity.uid,
                identity.boot_id,
                self.session_id,
                identity.reset_cause,
                int(CAPABILITIES),
                *VERSION,
                NAME,
            ),
            now_us,
        )

    def _close(self) -> None:
        """Nobody is there: be safe, and say hello until somebody is."""
        self.stop(StopCause.LINK, only_if_free=True)
        self.session_id = 0
        self._forget_host()

    def _forget_host(self) -> None:
        """Nothing that a session asked for outlives it."""
        self.agreed = False
        self.mode = Mode.IDLE
        self.watchdog.reset()
        self.duty_watchdog.reset()
        self._freshness.reset()
        self.schedule.reset()
        for spec in self.link.codec.catalogue:
            self.link.codec.limit(spec.type_id, None)

    # ---- what commands ask for ------------------------------------------------------------

    def enter(self, mode: Mode) -> None:
        """Let something else move the wheels, from rest."""
        self.mode = mode
        self.watchdog.halt()
        self.duty_watchdog.halt()

    def apply_parameters(self) -> None:
        """Keep to what was set, as far as it counts at once."""
        model = self.parameters.applied_to(self._model)
        self.wheels.limit(model, self.parameters.value("stop_deceleration"))
        self._battery_low_v = self.parameters.value("battery_low")

    def stream_spec(self, type_id: int) -> MessageSpec | None:
        """The device's stream of this type; None where it is another kind of message."""
        spec = self.link.codec.catalogue.by_type.get(type_id)
        return spec if spec is not None and streams.is_device_stream(spec) else None

    def stop(self, cause: StopCause, *, only_if_free: bool = False) -> None:
        """Latch a stop and leave any driving mode.

        With ``only_if_free`` a stop that is latched already keeps its cause: a host that
        leaves after an orderly end does not turn it into a lost link.
        """
        if only_if_free and self.latch.latched:
            return
        if self.latch.latch(cause):
            self.log(LogLevel.WARNING, f"stop latched: {label(StopCause, cause)}")
        self.enter(Mode.IDLE)

    def _setpoint(self, message: VelocitySetpoint, extra_us: float, now_us: int) -> None:
        if self.mode is not Mode.VELOCITY or not self.agreed:
            return
        if not self.watchdog.offer(message, extra_us, now_us):
            self._stale += 1

    def _duty(self, message: WheelDuty, extra_us: float, now_us: int) -> None:
        if self.mode is not Mode.BRINGUP or not self.agreed:
            return
        if not self.duty_watchdog.offer(message, extra_us, now_us):
            self._stale += 1

    # ---- control --------------------------------------------------------------------------

    def tick(self, now_us: int) -> tuple[float, float]:
        """One control period: left and right duty, and the streams that are due."""
        if self.session_id and now_us - self._heard_us > HOST_SILENCE_US:
            self._close()
        active = self._active_watchdog
        if active.expired(now_us):
            self.faults |= Fault.SETPOINT_EXPIRED
        elif active.left_us(now_us):
            self.faults &= ~Fault.SETPOINT_EXPIRED
        duties = self._drive()
        self.faults = _with(self.faults, Fault.MOTOR_STALL, present=self.wheels.stalled)
        self._stream(now_us)
        return duties

    @property
    def _active_watchdog(self) -> Watchdog:
        return self.duty_watchdog if self.mode is Mode.BRINGUP else self.watchdog

    def _drive(self) -> tuple[float, float]:
        counts = self._sensors.encoders()
        free = not self.latch.latched
        if self.mode is Mode.BRINGUP and free:
            self.wheels.coast(counts)
            return self.duty_watchdog.duties
        moving = self.mode is Mode.VELOCITY and free
        v = self.watchdog.v_m_s if moving else 0.0
        yaw = self.watchdog.yaw_rate_rad_s if moving else 0.0
        return self.wheels.step(v, yaw, counts, self._supply_v)

    def _stream(self, now_us: int) -> None:
        tick = now_us // TICK_US
        if tick % LOAD_TICKS == 0:
            self._measure_load()
        if not self.agreed:
            if tick % HELLO_TICKS == 0:
                self._hello(now_us)
            return
        due = list(self.schedule.due(tick))
        # The supply is looked after whether or not anybody is told.
        if "power" in due or tick % POWER_TICKS == POWER_PHASE:
            self._measure_power()
        for name in due:
            self._send(self._read(name, now_us), now_us)
        if self._log and now_us - self._logged_us >= LOG_PERIOD_US:
            self._send(self._log.pop(0), now_us)
            self._logged_us = now_us

    def _read(self, name: str, now_us: int) -> Message:  # noqa: PLR0911 - one per stream
        statistics = self.link.statistics
        match name:
            case "imu":
                return streams.read_imu(self._sensors)
            case "encoders":
                return streams.read_encoders(self._sensors)
            case "range":
                return streams.read_range(self._sensors)
            case "power":
                return streams.power_message(self._power)
            case "sync":
                return Sync((statistics.frames_out + 1) & 0xFFFF_FFFF)
            case "link_counters":
                return LinkCounters(
                    statistics.frames_in & 0xFFFF,
                    statistics.damaged + statistics.rejected & 0xFFFF,
                    self._stale & 0xFFFF,
                )
            case "status":
                return Status(
                    self.mode,
                    self.latch.cause,
                    int(self.faults),
                    min(250, self._active_watchdog.left_us(now_us) // 1000),
                    self._load_percent,
                )
            case _:  # of another version of the project
                return blank(self.link.codec.catalogue.by_name[name])

    def _measure_load(self) -> None:
        statistics = self.link.statistics
        frames = statistics.frames_in + statistics.frames_out
        work_us = LOAD_TICKS * TICK_WORK_US + (frames - self._frames_before) * FRAME_WORK_US
        self._frames_before = frames
        self._load_percent = min(100, round(100 * work_us / (LOAD_TICKS * TICK_US)))

    def _measure_power(self) -> None:
        self._power = reading = self._sensors.power()
        self._supply_v = reading.battery_v
        low = self._supply_v < self._battery_low_v
        self.faults = _with(self.faults, Fault.BATTERY_LOW, present=low)

    def log(self, level: LogLevel, line: str) -> None:
        """Queue a line for the host."""
        text = line.encode()[:LOG_BYTES].decode(errors="ignore")
        self._log.append(LogText(level, text))
        del self._log[:-LOG_WAITING]


def _cause(raw: int) -> StopCause:
    """The cause named; one that we do not know counts as the operator's."""
    known = StopCause.NONE < raw <= max(StopCause)
    return StopCause(raw) if known else StopCause.OPERATOR


def _with(faults: Fault, fault: Fault, *, present: bool) -> Fault:
    return faults | fault if present else faults & ~fault

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
from protocol.link import NODE_ALL, Link, Received
from protocol.message import Direction
from protocol.messages import (
    Ack,
    ClearStop,
    Describe,
    Hello,
    HostHello,
    LinkCounters,
    LogText,
    SetMode,
    Status,
    Stop,
    Sync,
    TimeReply,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.values import (
    Capability,
    Fault,
    LogLevel,
    Mode,
    NackReason,
    ResetCause,
    StopCause,
    label,
)
from sim_device import streams
from sim_device.safety import HOST_SILENCE_US, Freshness, SetpointWatchdog, StopLatch
from sim_device.wheel_control import WheelControl

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from protocol.message import Message
    from protocol.uart import Frame
    from sim_device.streams import Sensors

TICK_US = 10_000
TICK_HZ = 100
HELLO_TICKS = 100
LOG_PERIOD_US = 100_000
"""At most ten log lines a second; what waits longer is dropped, oldest first."""
LOG_WAITING = 16
STRANGE_PERIOD_US = 100_000
LOG_BYTES = 120
"""A line's length on the wire, whatever name a host gives itself."""
BATTERY_LOW_V = 12.8
"""3.2 V a cell of four."""
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

    def __init__(
        self,
        model: RobotModel,
        identity: Identity,
        sensors: Sensors,
        catalogue: Catalogue = CATALOGUE,
    ) -> None:
        """``catalogue`` is what this firmware's version of the project declares."""
        self.identity = identity
        self.mode = Mode.IDLE
        self.latch = StopLatch()
        self.agreed = False
        self.session_id = 0
        self.faults = Fault(0)
        self.link = Link(Direction.DEVICE, codec=Codec(catalogue))
        self.wheels = WheelControl(model)
        self.watchdog = SetpointWatchdog()
        self._sensors = sensors
        self._freshness = Freshness()
        self._commands = CommandLog()
        self._rates = streams.schedule(TICK_HZ)
        self._heard_us = 0
        self._stale = 0
        self._strange_us = -STRANGE_PERIOD_US
        self._log: list[LogText] = []
        self._logged_us = -LOG_PERIOD_US
        self._supply_v = model.battery_v
        self._load_percent = 0
        self._frames_before = 0

    # ---- the wire -------------------------------------------------------------------------

    def receive(self, data: bytes, now_us: int) -> None:
        """Take bytes that arrived at ``now_us``."""
        for event in self.link.receive(data):
            if isinstance(event, Received) and event.frame.node in {
                self.identity.node,
                NODE_ALL,
            }:
                self._heard_us = now_us
                self._handle(event.message, event.frame, now_us)

    def data_to_send(self) -> bytes:
        """Bytes for the port."""
        return self.link.data_to_send()

    def _send(self, message: Message, t_us: int) -> None:
        self.link.send(message, t_us, node=self.identity.node)

    def _handle(self, message: Message, frame: Frame, now_us: int) -> None:
        if isinstance(message, HostHello):
            self._open(message, now_us)
        extra_us = self._freshness.extra_delay_us(frame.t_us, now_us)
        match message:
            case VelocitySetpoint() | TimeRequest() if not self.session_id:
                self._strange(now_us)
            case VelocitySetpoint():
                self._setpoint(message, extra_us, now_us)
            case TimeRequest():
                self._send(TimeReply(message.ping, now_us & 0xFFFF_FFFF), now_us)
            case Describe():
                self._send(describe(self.link.codec.catalogue, message), now_us)
            case Stop():
                # Obeyed before any question of session or repetition.
                self.stop(_cause(message.cause))
                self._send(Ack(message.command_id, frame.type_id), now_us)
            case ClearStop() | SetMode():
                reply = self._commands.once(
                    self.session_id, frame.type_id, message, lambda: self._command(message)
                )
                self._send(reply, now_us)
            case _:
                pass

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
            self.agreed = False
            self.mode = Mode.IDLE
            self.watchdog.reset()
            self._freshness.reset()
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
        self.agreed = False
        self._freshness.reset()
        self.watchdog.reset()

    # ---- commands -------------------------------------------------------------------------

    def _command(self, message: ClearStop | SetMode) -> int | None:
        if not self.agreed:
            return NackReason.NO_SESSION
        return self._clear(message) if isinstance(message, ClearStop) else self._choose(message)

    def _clear(self, message: ClearStop) -> int | None:
        if not self.latch.latched:
            return None
        if not self.latch.clear(message.cause):
            return NackReason.OTHER_CAUSE
        self.log(LogLevel.INFO, f"stop cleared: {label(StopCause, message.cause)}")
        return None

    def _choose(self, message: SetMode) -> int | None:
        if message.mode not in {Mode.IDLE, Mode.VELOCITY}:
            return NackReason.BAD_VALUE
        if message.mode != Mode.IDLE and self.latch.latched:
            return NackReason.STOP_LATCHED
        self.mode = Mode(message.mode)
        self.watchdog.halt()
        return None

    def stop(self, cause: StopCause, *, only_if_free: bool = False) -> None:
        """Latch a stop and leave any driving mode.

        With ``only_if_free`` a stop that is latched already keeps its cause: a host that
        leaves after an orderly end does not turn it into a lost link.
        """
        if only_if_free and self.latch.latched:
            return
        if self.latch.latch(cause):
            self.log(LogLevel.WARNING, f"stop latched: {label(StopCause, cause)}")
        self.mode = Mode.IDLE
        self.watchdog.halt()

    def _setpoint(self, message: VelocitySetpoint, extra_us: float, now_us: int) -> None:
        if self.mode is not Mode.VELOCITY or not self.agreed:
            return
        if not self.watchdog.offer(message, extra_us, now_us):
            self._stale += 1

    # ---- control --------------------------------------------------------------------------

    def tick(self, now_us: int) -> tuple[float, float]:
        """One control period: left and right duty, and the streams that are due."""
        if self.session_id and now_us - self._heard_us > HOST_SILENCE_US:
            self._close()
        if self.watchdog.expired(now_us):
            self.faults |= Fault.SETPOINT_EXPIRED
        elif self.watchdog.left_us(now_us):
            self.faults &= ~Fault.SETPOINT_EXPIRED
        moving = self.mode is Mode.VELOCITY and not self.latch.latched
        v = self.watchdog.v_m_s if moving else 0.0
        yaw = self.watchdog.yaw_rate_rad_s if moving else 0.0
        duties = self.wheels.step(v, yaw, self._sensors.encoders(), self._supply_v)
        self.faults = _with(self.faults, Fault.MOTOR_STALL, present=self.wheels.stalled)
        self._stream(now_us)
        return duties

    def _stream(self, now_us: int) -> None:
        tick = now_us // TICK_US
        if tick % LOAD_TICKS == 0:
            self._measure_load()
        if not self.agreed:
            if tick % HELLO_TICKS == 0:
                self._hello(now_us)
            return
        for name in streams.due(self._rates, tick):
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
                return self._power()
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
                    min(250, self.watchdog.left_us(now_us) // 1000),
                    self._load_percent,
                )
            case _:
                raise LookupError(name)

    def _measure_load(self) -> None:
        statistics = self.link.statistics
        frames = statistics.frames_in + statistics.frames_out
        work_us = LOAD_TICKS * TICK_WORK_US + (frames - self._frames_before) * FRAME_WORK_US
        self._frames_before = frames
        self._load_percent = min(100, round(100 * work_us / (LOAD_TICKS * TICK_US)))

    def _power(self) -> Message:
        message = streams.read_power(self._sensors)
        self._supply_v = self._sensors.power().battery_v
        low = self._supply_v < BATTERY_LOW_V
        self.faults = _with(self.faults, Fault.BATTERY_LOW, present=low)
        return message

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

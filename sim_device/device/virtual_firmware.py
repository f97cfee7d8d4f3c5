"""The virtual sweeper's firmware: session, commands and streams around its control loop.

Sans-I/O (no ports, no clock): the inputs are the device's time in microseconds, received bytes and
sensor readings. The outputs are bytes and motor duties. One control tick is 10 ms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from protocol.can.link import CanLink
from protocol.imu import NOMINAL, ImuScale
from protocol.link import LinkBase, Received, addresses
from protocol.messages.device import Ack, Nack, ParameterValue, TimeReply
from protocol.messages.host import (
    Describe,
    DescribeEnum,
    GetParameter,
    HostHello,
    SaveParameters,
    SetKey,
    SetParameter,
    Stop,
    StopAll,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.messages.values import (
    Fault,
    LogLevel,
    Mode,
    NackReason,
    RebootKind,
    StopCause,
)
from protocol.retransmission import CommandLog
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.comparison import describe
from protocol.schema.message import Direction
from protocol.uart.framing import FLAG_AUTHENTICATED
from protocol.uart.link import Link
from sim_device.device import parameters, streams
from sim_device.device.clock import DeviceClock
from sim_device.device.commands import COMMANDS, carry_out
from sim_device.device.control import Control
from sim_device.device.flash import Flash
from sim_device.device.freshness import Freshness
from sim_device.device.keyring import Keyring
from sim_device.device.log_lines import LogLines
from sim_device.device.modes import DeviceState, Event, ModeMachine
from sim_device.device.parameters import ParameterStore
from sim_device.device.sampling import Sampler
from sim_device.device.telemetry import LOAD_TICKS, Telemetry
from sim_device.device.versions import as_declared, as_ours

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.robot_model import RobotModel
    from protocol.schema.message import Message, MessageSpec
    from protocol.uart.framing import Frame
    from sim_device.device.identity import Identity
    from sim_device.device.latch import StopLatch
    from sim_device.device.sampling import Sensors

TICK_US = 1_000_000 // streams.TICK_HZ
_HALF_TICK_US = TICK_US // 2
_TICK_MS = TICK_US // 1000
_VALUE = CATALOGUE.by_class[ParameterValue].type_id
HELLO_TICKS = 100
"""Number of control periods between two hellos, or two reports of the IMU's scale: 1 s."""
HOST_SILENCE_US = 1_000_000
"""Maximum time without a frame of the host in a session, µs; then the session ends."""
NO_CRYSTAL = "clock: no crystal; it runs from the chip's own oscillator, CAN is off"
NOT_SAVED = "parameters not saved: the flash does not read back what was written"
UNKNOWN_HELLO_PERIOD_US = 100_000
"""Minimum interval between two hellos that answer frames of no session, µs."""
POWER_TICKS = 20
"""Number of control periods per supply measurement: 5 Hz, in phase with the stream ``power``."""
RANGE_TICKS = 5
"""Number of control periods per range measurement: 20 Hz, in phase with the stream ``range``."""


class Firmware:
    """The device's program, one instance per boot."""

    def __init__(  # noqa: PLR0913 - one parameter per input of a boot
        self,
        model: RobotModel,
        identity: Identity,
        sensors: Sensors,
        catalogue: Catalogue = CATALOGUE,
        *,
        flash: Flash | None = None,
        link: type[LinkBase] = Link,
        clock: DeviceClock | None = None,
        modes: ModeMachine | None = None,
        local: bool = True,
        imu_scale: ImuScale = NOMINAL,
    ) -> None:
        """Boot.

        Args:
            model: The robot.
            identity: The identity that the device reports.
            sensors: The sensors.
            catalogue: The message catalogue of this firmware's version.
            flash: The flash memory, which stores parameters over resets.
            link: The link to the host.
            clock: The clock of the stamps.
            modes: The mode machine, already booted.
            local: True if only a person beside the robot can use the link.
            imu_scale: The IMU scale that the firmware configures.

        """
        self.identity = identity
        self.negotiated = False
        self.session_id = 0
        self._status_wanted = False
        """True: a stop for all nodes has arrived; the status is sent in the next period."""
        self.link = link(Direction.DEVICE, codec=Codec(catalogue))
        self._flash = flash or Flash()
        self.parameters = ParameterStore(parameters.table(model, identity.node), self._flash.load())
        self._lines = LogLines()
        self.control = Control(
            model,
            self.parameters,
            modes or ModeMachine(DeviceState.STOPPED),
            self._lines,
            identity.boot_id,
        )
        self.schedule = streams.Schedule(catalogue, int(identity.capabilities))
        self._range_phase = self.schedule.default_phase("range", RANGE_TICKS)
        self._power_phase = self.schedule.default_phase("power", POWER_TICKS)
        self._off_bus = identity.crystal_failed and issubclass(link, CanLink)
        if identity.crystal_failed:
            self.control.health.bits = int(Fault.CLOCK)
        self.reboot_wanted: RebootKind | None = None
        """Kind of an accepted reboot; the caller boots the firmware again. None: no reboot."""
        self._sampler = Sampler(sensors, self.parameters.range_corrections(), imu_scale)
        self._imu_info = imu_scale.info()
        self._clock = clock or DeviceClock()
        self._freshness = Freshness()
        self._commands = CommandLog()
        self.keyring = Keyring(self._flash, self.link, identity.boot_id, local=local)
        self._received_us = 0
        self._unknown_hello_us = -UNKNOWN_HELLO_PERIOD_US
        self._imu_sent = 0
        self._saving: tuple[dict[str, int], Message] | None = None
        self._declared = catalogue.by_class
        self._handlers: dict[type[Message], Callable[[Any, float, int], None]] = {
            VelocitySetpoint: self._setpoint,
            WheelDuty: self._duty,
            TimeRequest: self._time,
            Describe: self._describe,
            DescribeEnum: self._describe_enum,
        }
        self.telemetry = Telemetry(self.link, self._sampler, self.control)

    # ---- present state -----------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """Present mode."""
        return self.control.mode

    @property
    def latch(self) -> StopLatch:
        """The latch that stops the wheels."""
        return self.control.latch

    @property
    def state(self) -> DeviceState:
        """State in the mode table."""
        return self.control.modes.state

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop."""
        return self.control.latch.cause

    @property
    def drivers(self) -> bool:
        """Whether the motor drivers are enabled."""
        return self.control.drivers.enabled

    @property
    def fed(self) -> bool:
        """True, because each tick feeds the watchdog."""
        return True

    @property
    def waits(self) -> bool:
        """True with a key, because a command on CAN then waits for its tag."""
        return self.link.key is not None

    @property
    def faults(self) -> Fault:
        """Faults as in the status message."""
        return Fault(self.control.fault_bits)

    # ---- the link -------------------------------------------------------------------------

    def receive(self, data: bytes, now_us: int) -> None:
        """Process bytes that arrived at ``now_us``, µs of uptime."""
        if self._off_bus:
            return
        node = self.identity.node
        for event in self.link.receive(data, now_us):
            if event.__class__ is Received:
                message, frame, spec = event
                if addresses(frame, spec, node):
                    if self.link.key is not None and self.keyring.must_reject(frame):
                        self._reject(message, frame, now_us)  # it does not keep the session alive
                        continue
                    self._handle(as_ours(message, spec), frame, now_us)

    def data_to_send(self) -> bytes:
        """Return the bytes to send."""
        if self._off_bus:
            self.link.data_to_send()
            return b""
        return self.link.data_to_send()

    def _reject(self, message: Message, frame: Frame, now_us: int) -> None:
        """Reject a frame without the tag that the key requires."""
        command_id = getattr(message, "command_id", None)
        if command_id is None:
            self.telemetry.counters.stale += 1
            return
        self._send(Nack(command_id, frame.type_id, NackReason.NOT_AUTHENTICATED), now_us)

    def _send(self, message: Message, now_us: int, rank: int | None = None) -> None:
        if message.__class__ not in self._declared:
            declared = as_declared(message, self.link.codec.catalogue)
            if declared is None:
                return
            message = declared
        stamp_us = now_us + self._clock.offset_us
        self.link.send(message, stamp_us, node=self.identity.node, rank=rank)

    def _handle(self, message: Message, frame: Frame, now_us: int) -> None:
        if message.__class__ is StopAll:  # any sender; it does not keep the session alive
            self.stop(StopCause.OPERATOR)
            self._status_wanted = True
            return
        if message.__class__ is HostHello and not self._open(message, now_us):
            return
        genuine = bool(frame.version_flags & FLAG_AUTHENTICATED)
        if genuine or self.link.key is None or self.latch.cause != StopCause.NONE:
            # If a key is set and no stop is latched, only signed frames keep the session alive.
            self._received_us = now_us
        if isinstance(message, Stop):
            # A stop is executed before the checks of session and repetition. Its delay does not
            # change the session's freshness, because any sender may have sent it.
            self.stop(message.cause)
            self._send(Ack(message.command_id, frame.type_id), now_us)
            return
        extra_us = self._extra_delay_us(frame, now_us)
        handler = self._handlers.get(message.__class__)
        if handler is not None:
            handler(message, extra_us, now_us)
        elif isinstance(message, COMMANDS):
            self._command(message, frame.type_id, now_us)

    def _extra_delay_us(self, frame: Frame, now_us: int) -> float:
        """Return the frame's additional delay compared with the session's fastest frame, µs.

        With a key, frames without a tag are ignored. An attacker could forge their stamps, and a
        forged stamp could make a delayed setpoint look fresh.
        """
        if self.link.key is not None and not frame.version_flags & FLAG_AUTHENTICATED:
            return 0.0  # messages without a tag have no time to live
        return self._freshness.extra_delay_us(frame.t_us, now_us)

    def _time(self, request: TimeRequest, _extra_us: float, now_us: int) -> None:
        if not self.session_id:
            self._answer_unknown_session(now_us)
            return
        stamp_us = now_us + self._clock.offset_us
        self._send(TimeReply(request.ping, stamp_us & 0xFFFF_FFFF), now_us)

    def _command(self, message: Message, type_id: int, now_us: int) -> None:
        if self._saving is not None and isinstance(message, SaveParameters):
            return  # a repeated command during the save; the reply follows later
        reply = self._commands.once(
            self.session_id, type_id, message, lambda: carry_out(self, message)
        )
        if reply is None:
            return
        rank = None
        if isinstance(message, GetParameter | SetParameter) and isinstance(reply, Ack):
            # Also for a repeated command, because the first value message may have been lost.
            value = self.parameters.describe(message.parameter)
            if value is not None:
                self._send(value, now_us)
                rank = _VALUE  # the acknowledgement follows the value
        if self._flash.busy and isinstance(message, SaveParameters):
            self._saving = self.parameters.image(), reply
            return
        self._send(reply, now_us, rank)
        if isinstance(message, SetKey) and self.link.key is not None:
            self._send(self.keyring.challenge(), now_us)

    def _describe(self, question: Describe, _extra_us: float, now_us: int) -> None:
        codec = self.link.codec
        self._send(describe(codec.catalogue, question), now_us)
        spec = codec.catalogue.by_type.get(question.described_type)
        if spec is not None and spec.direction is Direction.HOST and not spec.bootstrap:
            # An older host omits our last fields; a host with a different declaration does not send
            # the message. Bootstrap messages are excluded, because their fields never change.
            fewer = question.field_count < len(spec.fields)
            codec.limit(spec.type_id, question.field_count if fewer else None)

    def _describe_enum(self, question: DescribeEnum, _extra_us: float, now_us: int) -> None:
        self._send(describe(self.link.codec.catalogue, question), now_us)

    # ---- session --------------------------------------------------------------------------

    def _answer_unknown_session(self, now_us: int) -> None:
        """Send a hello (identity and boot id) to a host that uses an unknown session."""
        if now_us - self._unknown_hello_us >= UNKNOWN_HELLO_PERIOD_US:
            self._unknown_hello_us = now_us
            self._hello(now_us)

    def _open(self, hello: HostHello, now_us: int) -> bool:
        """Process a host's hello; return False if it does not open or continue a session."""
        if not hello.session_id:
            return False  # 0 means "no session"; a lost link would not be detected
        if hello.session_id != self.session_id:
            if hello.boot_id != self.identity.boot_id:
                self._hello(now_us)  # the host does not know this boot yet: only reply
                return False
            if self.session_id:
                self.stop(StopCause.LINK, Event.NEW_SESSION)
            self.session_id = hello.session_id
            self.link.forget_sequence()  # another host, or a new session of the same host
            self.keyring.open(hello.session_id)
            self._forget_host()
        if hello.negotiated and not self.negotiated:
            self.negotiated = True
            self._received_us = now_us
            self.log(LogLevel.INFO, f"session with {hello.name}")
            if self.identity.crystal_failed:
                self.log(LogLevel.WARNING, NO_CRYSTAL)
            if self.identity.crash is not None:
                self.log(LogLevel.ERROR, self.identity.crash.text)
        self._hello(now_us)
        return True

    def _hello(self, now_us: int) -> None:
        catalogue_hash, keyed = self.link.codec.catalogue.hash, self.link.key is not None
        hello = self.identity.hello(catalogue_hash, self.session_id, keyed=keyed)
        self._send(hello, now_us)
        if self.session_id and keyed:
            self._send(self.keyring.challenge(), now_us)
        if self.negotiated:  # sent before any IMU sample
            self._send(self._imu_info, now_us)

    def _close(self) -> None:
        """End the session: make the robot safe, and send hellos until a host answers."""
        self.stop(StopCause.LINK, Event.SILENCE)
        self.session_id = 0
        self.keyring.close()
        self._forget_host()

    def _forget_host(self) -> None:
        """Discard all requests of the session."""
        self.negotiated = False
        self.control.forget_host()
        self._freshness.reset()
        self.schedule.reset()
        for spec in self.link.codec.catalogue:
            self.link.codec.limit(spec.type_id, None)

    # ---- effects of commands ------------------------------------------------------------

    def stop(self, cause: int, event: Event = Event.STOP) -> None:
        """Latch a stop and leave any driving mode, as the mode table defines."""
        self.control.stop(cause, event)

    def stream_spec(self, type_id: int) -> MessageSpec | None:
        """Return the device's stream of this type; None for another kind of message."""
        spec = self.link.codec.catalogue.by_type.get(type_id)
        return spec if spec is not None and streams.is_device_stream(spec) else None

    def begin_save(self) -> None:
        """Start to store the present parameters; the reply follows when they are stored."""
        self._flash.begin(self.parameters.image())

    @property
    def saving(self) -> bool:
        """Whether parameters are being stored."""
        return self._flash.busy

    def _carry_on_saving(self, now_us: int) -> None:
        if not self._flash.advance(_TICK_MS) or self._saving is None:
            return
        (image, reply), self._saving = self._saving, None
        if self._flash.reads_back():
            self.parameters.saved(image)
            self.log(LogLevel.INFO, "parameters saved")
        else:
            self.log(LogLevel.ERROR, NOT_SAVED)
            if isinstance(reply, Ack):
                reply = Nack(reply.command_id, reply.command_type, NackReason.NOT_SAVED)
                self._commands.amend(self.session_id, reply)
        self._send(reply, now_us)

    def _setpoint(self, message: VelocitySetpoint, extra_us: float, now_us: int) -> None:
        if not self.session_id:
            self._answer_unknown_session(now_us)
        elif self.negotiated and self.control.modes.state is DeviceState.VELOCITY:
            taken = self.control.setpoints.offer(message, extra_us, now_us)
            self.telemetry.counters.stale += not taken

    def _duty(self, message: WheelDuty, extra_us: float, now_us: int) -> None:
        if self.negotiated and self.control.modes.state is DeviceState.BRINGUP:
            taken = self.control.duties.offer(message, extra_us, now_us)
            self.telemetry.counters.stale += not taken

    def log(self, level: LogLevel, line: str) -> None:
        """Queue a line for the host."""
        self._lines.add(level, line)

    # ---- time -----------------------------------------------------------------------------

    def _measure_power(self, *, checks: bool) -> None:
        """Measure the supply. It is measured and checked even if no stream reports it."""
        self.control.on_power(self._sampler.power())
        if checks:
            self.control.check_power()

    def tick(self, now_us: int) -> tuple[float, float]:
        """Run one control period: return left and right duty, and queue the due streams."""
        if self.session_id and now_us - self._received_us > HOST_SILENCE_US:
            self._close()
        tick = (now_us + _HALF_TICK_US) // TICK_US
        sampler = self._sampler
        sampler.begin(now_us)
        sounded = self.negotiated and tick % RANGE_TICKS == self._range_phase
        around = sampler.around() if sounded else None
        duties = self.control.tick(tick, now_us, sampler, around)
        if self._flash.busy:
            self._carry_on_saving(now_us)
        due = self.schedule.due(tick)
        self._answer_stop(due, now_us)
        checks = tick % POWER_TICKS == self._power_phase
        if checks or "power" in due:
            self._measure_power(checks=checks)
        if tick % LOAD_TICKS == 0:
            self.telemetry.measure_load()
        if self.negotiated:
            if due:
                self._send_streams(due, now_us)
            if tick % HELLO_TICKS == 0:
                self._send(self._imu_info, now_us)
            if self._lines.waiting:
                self._send_line(now_us)
        elif tick % HELLO_TICKS == 0:
            self._hello(now_us)
        return duties

    def next_us(self, now_us: int) -> int:
        """Return the start of the control period after ``now_us``, µs of uptime."""
        return ((now_us + _HALF_TICK_US) // TICK_US + 1) * TICK_US

    def _answer_stop(self, due: tuple[str, ...], now_us: int) -> None:
        """Send the status after a stop from any sender, unless the status stream is due."""
        stopped, self._status_wanted = self._status_wanted, False
        if stopped and not (self.negotiated and "status" in due):
            self._send_streams(("status",), now_us)

    def _send_line(self, now_us: int) -> None:
        """Send a log line, if one may be sent now."""
        line = self._lines.take(now_us)
        if line is not None:
            self._send(line, now_us)

    def _send_streams(self, due: tuple[str, ...], now_us: int) -> None:
        """Send the streams that are due."""
        known, send = self.telemetry.streams, self.link.send_payload
        stamp_us, node = now_us + self._clock.offset_us, self.identity.node
        sampler = self._sampler
        for name in due:
            sampled_us = stamp_us
            if name == "imu":  # send each sample once, with its own time
                if sampler.imu_samples == self._imu_sent:
                    continue
                self._imu_sent = sampler.imu_samples
                sampled_us += sampler.imu_us - now_us
            type_id, pack = known[name]
            send(type_id, pack(now_us), sampled_us, node)

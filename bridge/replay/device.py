"""Replay of a recorded robot on a serial link, at the times of the recording.

Sans-I/O. Telemetry and damaged bytes come from the log, with unchanged payloads and stamps.
Messages that answer the host (hello, time replies, acknowledgements) are created anew. The replayed
robot cannot be driven: it rejects commands that would move or change it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from bridge.record.errors import LogReadError
from bridge.record.version_1 import Version1, is_version_1
from bridge.record.wire_records import RAW_TOPICS, in_order, wire_records
from protocol.can.link import CanLink
from protocol.clock import DeviceUs, HostNs, extend_us
from protocol.imu import NOMINAL
from protocol.link import Received, addresses
from protocol.messages.device import (
    Ack,
    Challenge,
    DescribeEnumReply,
    DescribeReply,
    Encoders,
    Hello,
    Imu,
    ImuInfo,
    Nack,
    ParameterValue,
    Power,
    Range,
    Status,
    TimeReply,
)
from protocol.messages.host import (
    ClearStop,
    Describe,
    DescribeEnum,
    HostHello,
    Stop,
    StopAll,
    TimeRequest,
)
from protocol.messages.values import Mode, NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.comparison import describe
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame
from protocol.uart.link import Link

if TYPE_CHECKING:
    from bridge.record.reader import LogReader
    from bridge.record.wire_records import WireRecord
    from protocol.link import LinkBase
    from protocol.schema.message import Message

_CONVERSATION = (
    Hello,
    DescribeReply,
    DescribeEnumReply,
    Ack,
    Nack,
    TimeReply,
    ParameterValue,
    Challenge,
)
_DEFAULT_HELLO = Hello(CATALOGUE.hash, bytes(12), 1, 0, 0, 0, 0, 0, 0, "recorded")
"""Hello for a recording without a hello."""
_STANDING = (Status, Encoders, Imu, Range, Power)
"""Messages that are repeated after the end of the recording, so that the robot seems to stand
still."""
_HELLO_NS = 1_000_000_000
"""Period of the hello before a host has connected, ns."""
_STANDING_NS = 50_000_000
"""Period of the repeated messages after the end of the recording, ns."""
_WRAP_US = 1 << 32
_BEFORE_US = 60_000_000
"""Time by which stamps before the playback are earlier than the first recorded stamp, µs.

Before the playback, its start time is unknown. A stamp that is too early only makes the clock's
error bound larger. A stamp that is too late would cause a clock step at the start of the playback.
"""


class Played(NamedTuple):
    """One recorded frame, or one sequence of damaged bytes."""

    log_ns: int
    node: int
    type_id: int
    t_us: int
    """Device time without wraps, µs."""
    payload: bytes
    """Payload of the frame, or the damaged bytes."""
    is_damaged: bool


class RecordedRun(NamedTuple):
    """The data that a robot has sent, and its hello."""

    hello: Hello
    node: int
    played: list[Played]
    duration_s: float
    imu_info: ImuInfo
    """Scale of the IMU. If the recording has no scale, it is the nominal scale, because version 1
    had only this scale."""


def load(reader: LogReader) -> RecordedRun:
    """Read the received bytes of a log.

    Raises:
        LogReadError: the log has no received bytes.

    """
    loader = _Loader()
    version_1 = Version1() if is_version_1(reader) else None
    for record in sorted(wire_records(reader.messages(RAW_TOPICS)), key=in_order):
        if not record.outgoing:
            loader.take(record if version_1 is None else version_1.rewrite(record))
    if not loader.played:
        raise LogReadError(reader.path, "it contains no raw bytes of a robot")
    first, last = loader.played[0], loader.played[-1]
    duration_s = (last.log_ns - first.log_ns) / 1e9
    return RecordedRun(
        loader.hello or _DEFAULT_HELLO, loader.node, loader.played, duration_s, loader.imu_info
    )


class _Loader:
    def __init__(self) -> None:
        self.hello: Hello | None = None
        self.node = 1
        self.played: list[Played] = []
        self.imu_info = NOMINAL.info()
        self._known: DeviceUs | None = None
        self._link: LinkBase | None = None

    def take(self, record: WireRecord) -> None:
        if self._link is None:
            self._link = CanLink(Direction.HOST) if record.is_can else Link(Direction.HOST)
        for event in self._link.receive(record.data, record.log_ns // 1000):
            if isinstance(event, DamagedFrame):
                stamp = self._known or 0
                self.played.append(Played(record.log_ns, 0, 0, stamp, event.data, is_damaged=True))
            elif isinstance(event, Received):
                self._message(event, record.log_ns)

    def _message(self, received: Received, log_ns: int) -> None:
        message, frame, spec = received
        stamp = DeviceUs(frame.t_us) if self._known is None else extend_us(self._known, frame.t_us)
        self._known = stamp
        if isinstance(message, Hello):
            self.hello, self.node = self.hello or message, frame.node
        elif isinstance(message, ImuInfo):
            self.imu_info = message
        elif not isinstance(message, _CONVERSATION):
            assert self._link is not None  # noqa: S101 - it gave the message
            payload = self._link.codec.encode(message)[1]
            self.played.append(
                Played(log_ns, frame.node, spec.type_id, stamp, payload, is_damaged=False)
            )


class ReplayDevice:
    """The device's side of a link.

    It plays a recording after a host has completed the handshake.
    """

    def __init__(self, recording: RecordedRun) -> None:
        self.recording = recording
        self.session_id = 0
        """Session id of the connected host; 0: no host is connected."""
        self._link = Link(Direction.DEVICE)
        self._first_ns = recording.played[0].log_ns
        # Device time at the first record. With this value, no recorded stamp is in the future.
        self._clock_us = max(p.t_us - (p.log_ns - self._first_ns) // 1000 for p in recording.played)
        self._begun_ns: HostNs | None = None
        self._opened_ns: HostNs | None = None
        self._next = 0
        self._hello_ns = 0
        self._standing_ns = 0
        self._out = bytearray()
        self._imu_info = recording.imu_info
        self._last = {p.type_id: p for p in recording.played if not p.is_damaged}

    @property
    def is_over(self) -> bool:
        """True after the last recorded frame."""
        return self._next >= len(self.recording.played)

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle bytes from the host."""
        for event in self._link.receive(data):
            if isinstance(event, Received) and addresses(
                event.frame, event.spec, self.recording.node
            ):
                self._answer(event.message, now_ns)

    def poll(self, now_ns: HostNs) -> None:
        """Send the frames that are due."""
        if self._opened_ns is None:
            self._opened_ns = now_ns
        if self._begun_ns is None:
            if now_ns >= self._hello_ns:
                self._hello_ns = now_ns + _HELLO_NS
                self._send_hello(now_ns)
            return
        played, at_ns = self.recording.played, now_ns - self._begun_ns + self._first_ns
        while self._next < len(played) and played[self._next].log_ns <= at_ns:
            self._play(played[self._next])
            self._next += 1
            self._standing_ns = now_ns + _STANDING_NS
        if self.is_over and now_ns >= self._standing_ns:
            self._standing_ns = now_ns + _STANDING_NS
            self._stand(now_ns)

    def next_deadline(self) -> HostNs:
        """Return the time of the next frame."""
        if self._begun_ns is None:
            return HostNs(self._hello_ns)
        if self.is_over:
            return HostNs(self._standing_ns)
        due_ns = self.recording.played[self._next].log_ns - self._first_ns
        return HostNs(self._begun_ns + due_ns)

    def data_to_send(self) -> bytes:
        """Return the bytes to write to the port."""
        self._drain()
        data = bytes(self._out)
        self._out.clear()
        return data

    # ---- inside ---------------------------------------------------------------------------

    def _device_us(self, now_ns: HostNs) -> int:
        """Return the device time in the transmitted form, 32 bits."""
        if self._begun_ns is None:
            return (self._clock_us - _BEFORE_US) % _WRAP_US
        return (self._clock_us + (now_ns - self._begun_ns) // 1000) % _WRAP_US

    def _drain(self) -> None:
        self._out += self._link.data_to_send()

    def _play(self, played: Played) -> None:
        if played.is_damaged:
            self._drain()
            # Delimiters on both sides separate the damaged bytes from the intact frames.
            self._out += b"\0" + played.payload.replace(b"\0", b"\1") + b"\0"
        else:
            stamp = played.t_us % _WRAP_US
            self._link.send_payload(played.type_id, played.payload, stamp, played.node)

    def _stand(self, now_ns: HostNs) -> None:
        """Repeat the last message of each kind."""
        stamp = self._device_us(now_ns)
        for message in _STANDING:
            last = self._last.get(CATALOGUE.spec(message).type_id)
            if last is not None:
                self._link.send_payload(last.type_id, last.payload, stamp, last.node)

    def _send(self, message: Message, now_ns: HostNs) -> None:
        stamp = self._device_us(now_ns)
        self._link.send(message, stamp, node=self.recording.node)

    def _send_hello(self, now_ns: HostNs) -> None:
        # Messages are encoded with this program's catalogue, not the recorded device's.
        _, uid, boot_id, _, *others = tuple(self.recording.hello)
        self._send(Hello(CATALOGUE.hash, uid, boot_id, self.session_id, *others), now_ns)
        if self._begun_ns is not None:
            self._send(self._imu_info, now_ns)

    def _answer(self, message: Message, now_ns: HostNs) -> None:
        match message:
            case HostHello():
                self.session_id = message.session_id
                if message.negotiated and self._begun_ns is None:
                    self._begun_ns = now_ns
                self._send_hello(now_ns)
            case TimeRequest():
                self._send(TimeReply(message.ping, self._device_us(now_ns)), now_ns)
            case Describe() | DescribeEnum():
                self._send(describe(CATALOGUE, message), now_ns)
            case StopAll():
                self._send(Status(Mode.IDLE, StopCause.OPERATOR, 0, 0, 0), now_ns)
            case Stop() | ClearStop():
                type_id = CATALOGUE.spec(type(message)).type_id
                self._send(Ack(message.command_id, type_id), now_ns)
            case _:
                command_id = getattr(message, "command_id", None)
                if command_id is not None:
                    type_id = CATALOGUE.spec(type(message)).type_id
                    rejection = Nack(command_id, type_id, NackReason.UNSUPPORTED)
                    self._send(rejection, now_ns)


def replay_device(reader: LogReader) -> ReplayDevice:
    """Create a replayed device from a log.

    Raises:
        LogReadError: the log contains no raw bytes of a robot.

    """
    return ReplayDevice(load(reader))

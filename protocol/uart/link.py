"""One end of a serial link: it converts bytes to messages, and messages to bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol import primitives
from protocol.authentication import TRAILER
from protocol.errors import PayloadError
from protocol.link import LinkBase, Medium, Received
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.framing import (
    FLAG_AUTHENTICATED,
    HEADER,
    OWN_VERSION,
    DamagedFrame,
    Frame,
    UartEncoder,
    UartParser,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from protocol.link import LinkEvent
    from protocol.schema.codec import Codec
    from protocol.schema.message import Message, MessageSpec

_HALF_SEQ = 128
_STOPS = frozenset({"stop", "stop_all"})
"""Names of the stop messages. They need no tag and are accepted even with a wrong tag."""
_TIME_REQUEST = "time_request"
"""Name of the time request. It needs no tag and is answered even with a wrong tag. So a host with a
wrong key can measure the link, although the device rejects its commands."""
_HELLO = "hello"
"""Name of the message with the device's boot id. Sequence numbers restart at each boot."""
_PLAIN_MASK = 0xF0 | FLAG_AUTHENTICATED
"""Mask of the version and the authentication flag in the first header byte. Frames with this flag
are decoded by the general path, not by the fast path."""
_OWN_VERSION = OWN_VERSION
_UNKNOWN = -1
"""Placeholder for an unknown sequence number: any next number is accepted."""


class _Ordinary:
    """Decoding data for the fast path: a message that type and length alone identify."""

    def __init__(self, spec: MessageSpec) -> None:
        self.spec = spec
        self.cls: type[Message] = spec.cls
        self.size = spec.layout.size
        self.unpack: Callable[[bytes], tuple[Any, ...]] = spec.layout.unpack


class Link(LinkBase):
    """Converts a byte stream to messages, and messages to bytes."""

    medium = Medium.UART

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        super().__init__(sends, codec=codec)
        self._parser = UartParser()
        self._encoder = UartEncoder()
        self._seq = 0
        self._expected_seq = [_UNKNOWN] * 256
        """Expected next sequence number of each sender."""
        self._boots: dict[int, int] = {}
        """Boot id in the newest hello of each device."""
        # The node in a device's frame is the sender. A host uses one sequence for its frames to all
        # nodes.
        self._sender_mask = 0xFF if sends is Direction.HOST else 0
        self._ordinary: list[_Ordinary | None] = [None] * 256
        """Messages for the fast path, by type; None: this end does not receive the type, or the
        type needs the general path."""
        for spec in self.codec.catalogue:
            if spec.direction is not sends and spec.text_field is None and not spec.is_bare:
                self._ordinary[spec.type_id] = _Ordinary(spec)

    # ---- receiving ------------------------------------------------------------------------

    def receive(self, data: bytes, now_us: int = 0) -> list[LinkEvent]:  # noqa: ARG002 - stamps are whole
        """Process bytes from the port; return the completed events, in order."""
        parser, statistics = self._parser, self.statistics
        by_type, expected = statistics.by_type, self._expected_seq
        found: list[LinkEvent] = []
        frames = parser.frames
        damaged = parser.damaged
        rare = 0
        parser.take(data)
        while True:
            event = parser.next_event()
            if event is None:
                break
            if isinstance(event, _DamagedFrame):
                found.append(event)
                continue
            type_id = parser.type_id
            sender = parser.node & self._sender_mask
            ordinary = self._ordinary[type_id]
            if (
                ordinary is not None
                and parser.seq == expected[sender]
                and len(parser.payload) == ordinary.size
                and parser.version_flags & _PLAIN_MASK == _OWN_VERSION
                and not (self.disabled and type_id in self.disabled)
            ):
                by_type[type_id] = by_type.get(type_id, 0) + 1
                expected[sender] = (parser.seq + 1) & 0xFF
                message = primitives.make(ordinary.cls, ordinary.unpack(parser.payload))
                found.append(primitives.make(_Received, (message, event, ordinary.spec)))
            else:
                rare += 1
                found.append(self._interpret(event))
        statistics.bytes_in += len(data)
        statistics.frames_in += parser.frames - frames - rare
        statistics.damaged += parser.damaged - damaged
        return found

    def _interpret(self, frame: Frame) -> LinkEvent:
        version_flags, _, type_id, *_ = frame
        if version_flags >> 4 != PROTOCOL_VERSION:
            return self._reject(frame, "version")
        codec = self.codec
        spec = codec.catalogue.by_type.get(type_id)
        if spec is not None and spec.direction is self._sends:
            return self._reject(frame, "direction")
        statistics = self.statistics
        statistics.frames_in += 1
        statistics.by_type[type_id] = statistics.by_type.get(type_id, 0) + 1
        # a bare message (stop_all) has no sequence number: all senders send the same bytes
        if spec is None or not spec.is_bare:
            self._count(spec, frame)
        if spec is None:
            return self._reject(frame, "type")
        genuine = True
        if version_flags & FLAG_AUTHENTICATED and type_id not in self.disabled:
            if spec.name in _STOPS:  # executed with any tag, but not marked as authentic
                frame = frame._replace(version_flags=version_flags & ~FLAG_AUTHENTICATED)
            else:
                frame, genuine = self._opened(frame)
                if not genuine and spec.name == _TIME_REQUEST:  # answered, but not marked authentic
                    frame = frame._replace(version_flags=version_flags & ~FLAG_AUTHENTICATED)
                    genuine = True
        if not genuine or type_id in self.disabled:
            return self._reject(frame, "disabled" if genuine else "key")
        try:
            return Received(codec.decode(spec, frame.payload), frame, spec)
        except PayloadError:
            return self._reject(frame, "payload")

    def _opened(self, frame: Frame) -> tuple[Frame, bool]:
        """Return a frame without its authentication trailer, and whether the trailer is valid."""
        payload, trailer = frame.payload[: -TRAILER.size], frame.payload[-TRAILER.size :]
        frame = frame._replace(payload=payload)
        covered = HEADER.pack(*frame[:-1]) + payload
        return frame, self.key is not None and self.key.check(covered, trailer)

    def _count(self, spec: MessageSpec | None, frame: Frame) -> None:
        """Update the counts of lost and reordered frames from a frame's sequence number."""
        sender, seq = frame.node & self._sender_mask, frame.seq
        booted = spec is not None and spec.name == _HELLO and self._booted(sender, spec, frame)
        if booted or self._expected_seq[sender] in {seq, _UNKNOWN}:
            self._expected_seq[sender] = (seq + 1) & 0xFF
        else:
            self._out_of_sequence(sender, seq)

    def _booted(self, sender: int, spec: MessageSpec, frame: Frame) -> bool:
        """Return whether a hello's boot id has changed, so that sequence numbers restart."""
        try:
            boot_id = getattr(self.codec.decode(spec, frame.payload), "boot_id", None)
        except PayloadError:
            return False
        if boot_id is None:
            return False
        known, self._boots[sender] = self._boots.get(sender, boot_id), boot_id
        return bool(known != boot_id)

    def _out_of_sequence(self, sender: int, seq: int) -> None:
        gap = (seq - self._expected_seq[sender]) & 0xFF
        if gap >= _HALF_SEQ:
            self.statistics.reordered += 1
        else:
            self.statistics.lost += gap
            self._expected_seq[sender] = (seq + 1) & 0xFF

    def forget_sequence(self) -> None:
        """Accept any sequence number next, because the peer has booted."""
        self._expected_seq = [_UNKNOWN] * 256

    # ---- sending --------------------------------------------------------------------------

    def data_to_send(self) -> bytes:
        """Return and remove the queued bytes."""
        if not self._queue.frames:
            return b""
        # A leading delimiter separates this frame from the rest of a damaged frame.
        data = b"\0"
        by_type = self.codec.catalogue.by_type
        for node, type_id, t_us, payload, flags, _ in self._queue.take():  # rarely more than one
            version_flags, stamp_us = OWN_VERSION | flags, t_us & 0xFFFF_FFFF
            content = payload
            if not payload and by_type[type_id].is_bare:  # the same frame from every sender
                data += self._encoder.frame(OWN_VERSION, node, type_id, 0, 0, payload)
                continue
            if flags & FLAG_AUTHENTICATED and self.key is not None:
                head = HEADER.pack(version_flags, node, type_id, self._seq, stamp_us)
                content += self.key.sign(head + payload)
            data += self._encoder.frame(version_flags, node, type_id, self._seq, stamp_us, content)
            self._seq = (self._seq + 1) & 0xFF
        self.statistics.bytes_out += len(data)
        return data


_DamagedFrame, _Received = DamagedFrame, Received

"""One end of a link: frames in, messages out, and the accounts of both; and that over UART.

Sans-I/O: bytes are handed in, messages and events come back, and what is to be written is
fetched with :meth:`Link.data_to_send`. It does not know which end it plays beyond the
direction of the messages that it sends.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple
from zlib import crc32

from cobs import cobs

from protocol.authentication import GUARDED_TYPES, TRAILER
from protocol.errors import LocalError, PayloadError
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.codec import Codec
from protocol.schema.message import Direction, Message
from protocol.uart.framing import (
    FLAG_AUTHENTICATED,
    MAX_NODE,
    MAX_PAYLOAD,
    OWN_VERSION,
    PACK_BODY,
    RESIDUE,
    UNPACK_BODY,
    Damage,
    DamagedFrame,
    Frame,
    UartParser,
    check_frame,
    pack_crc,
)

if TYPE_CHECKING:
    from protocol.authentication import Authenticator
    from protocol.schema.message import MessageSpec

NODE_ALL = 0
"""Addresses every device; for stop, hello and time requests only."""
_HALF_SEQ = 128
_STOP = "stop"
"""Name of the message that needs no tag, and is not refused for a wrong one."""
_HELLO = "hello"
"""Name of the message that says which boot a device's sequence numbers are of."""
_PLAIN = 0xF0 | FLAG_AUTHENTICATED
"""Version and this flag: a frame that claims to be authenticated never goes the short way."""
_new = tuple.__new__


class Received(NamedTuple):
    """An intact message that is meant for this end."""

    message: Message
    frame: Frame
    spec: MessageSpec


_Waiting = tuple[int, int, int, bytes, int]
"""A frame to be: node, type, stamp, payload, flags. It takes its sequence number as it leaves,
or a replaced one would be a gap; a bare tuple, for there is one for every message sent."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """An intact frame that this end could not use."""

    frame: Frame
    reason: str
    """``version``, ``direction``, ``type``, ``disabled``, ``payload``, or ``key``: it is marked as
    authenticated, and there is no key here, or its tag or counter is wrong."""


LinkEvent = Received | Rejected | DamagedFrame


@dataclass(slots=True)
class LinkStatistics:
    """Counts since the link was made."""

    frames_in: int = 0
    frames_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    damaged: int = 0
    rejected: int = 0
    lost: int = 0
    """Frames missing by their sequence numbers."""
    reordered: int = 0
    superseded: int = 0
    """Messages replaced by a newer one before they were written."""
    by_type: dict[int, int] = field(default_factory=dict)


class WrongDirectionError(LocalError):
    """A message that the other side sends."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message} is not sent in this direction")
        self.message = message


def addresses(frame: Frame, spec: MessageSpec, node: int) -> bool:
    """Whether a host's frame is for the device of this node."""
    return frame.node == node or (frame.node == NODE_ALL and spec.to_all)


class Medium(Enum):
    """What carries the bytes."""

    UART = "uart"
    CAN = "can"
    """Each frame as the 16 bytes of Linux' ``struct can_frame``."""


class LinkBase(ABC):
    """What a session needs of a link, whichever medium it runs over."""

    medium: Medium

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        self.codec = codec or Codec()
        self.statistics = LinkStatistics()
        self.disabled: set[int] = set()
        """Types whose declaration the peer does not share: neither sent nor decoded."""
        self._sends = sends
        self._own_types = {s.type_id for s in self.codec.catalogue if s.direction is sends}
        self._queue: list[_Waiting] = []
        self.key: Authenticator | None = None
        """Signs what needs it once its session has begun, and checks what comes signed."""

    @abstractmethod
    def receive(self, data: bytes, now_us: int) -> list[LinkEvent]:
        """Take bytes that arrived at ``now_us`` of our own clock; give what they complete."""

    @abstractmethod
    def data_to_send(self) -> bytes:
        """Fetch and forget what is queued."""

    @abstractmethod
    def forget_sequence(self) -> None:
        """Expect any sequence number next: the peer has booted anew."""

    def _reject(self, frame: Frame, reason: str) -> Rejected:
        self.statistics.rejected += 1
        return Rejected(frame, reason)

    def send(
        self, message: Message, t_us: int, *, node: int, flags: int = 0, latest: bool = False
    ) -> bool:
        """Queue a message; False where the peer does not share its declaration.

        With ``latest`` a message of the same type that still waits is replaced: what is
        cyclic must never queue up.

        Raises:
            WrongDirectionError: the message belongs to the other side.
            FieldRangeError: a value does not fit.
            FrameSizeError: a text is too long for a frame.
            UnknownMessageError: the catalogue does not hold the message.

        """
        type_id, payload = self.codec.encode(message)
        if type_id in self.disabled:
            return False
        if type_id not in self._own_types:
            raise WrongDirectionError(type(message).__name__)
        if self.key is not None and self.key.begun and type_id in GUARDED_TYPES:
            flags |= FLAG_AUTHENTICATED
        if flags or not 0 <= node <= MAX_NODE or len(payload) > MAX_PAYLOAD:
            check_frame(node, type_id, payload, flags)
        statistics = self.statistics
        if latest and self._queue:
            kept = [w for w in self._queue if w[1] != type_id or w[0] != node]
            replaced = len(self._queue) - len(kept)
            statistics.superseded += replaced
            statistics.frames_out -= replaced
            self._queue = kept
        self._queue.append((node, type_id, t_us, payload, flags))
        statistics.frames_out += 1
        return True

    def send_payload(self, type_id: int, payload: bytes, t_us: int, node: int) -> bool:
        """Queue what a stream's own layout has packed; False as for :meth:`send`.

        For a device's streams, of which there are hundreds a second and none is authenticated:
        the caller answers for the type, its direction, and a node and a length that fit.
        """
        if type_id in self.disabled:
            return False
        self._queue.append((node, type_id, t_us, payload, 0))
        self.statistics.frames_out += 1
        return True

    @property
    def has_data(self) -> bool:
        """True where something waits to be written."""
        return bool(self._queue)


class Link(LinkBase):
    """Turns a byte stream into messages and messages into bytes."""

    medium = Medium.UART

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        super().__init__(sends, codec=codec)
        self._parser = UartParser()
        self._seq = 0
        self._expected_seq: dict[int, int] = {}
        self._boots: dict[int, int] = {}
        """The boot that each device's newest hello names."""
        # A device's frames name it; a host counts all its own together, whatever node they name.
        self._sender_mask = 0xFF if sends is Direction.HOST else 0
        self._plain = {
            spec.type_id << 8 | spec.layout.size: (spec, spec.cls, spec.layout.unpack)
            for spec in self.codec.catalogue
            if spec.direction is not sends and spec.text_field is None
        }
        """What can come in by type and length of payload, where that alone says how to read it."""

    # ---- receiving ------------------------------------------------------------------------

    def receive(self, data: bytes, now_us: int = 0) -> list[LinkEvent]:  # noqa: ARG002 - stamps are whole
        """Take bytes from the port; give what they complete, in order."""
        # The parser's own loop, and what follows for an ordinary frame in the same breath: at
        # a full line a call for each frame would be a tenth of the time.
        parser, statistics = self._parser, self.statistics
        statistics.bytes_in += len(data)
        pieces = parser.split(data)
        found: list[Any] = []
        plain, expected, disabled = self._plain, self._expected_seq, self.disabled
        by_type, sender_mask = statistics.by_type, self._sender_mask
        ordinary = damaged = 0
        for piece in filter(None, pieces):
            try:
                body = cobs.decode(piece)
                unpack = UNPACK_BODY[len(body)]
            except cobs.DecodeError:
                found.append(Damage.COBS)
                damaged += 1
                continue
            except KeyError:
                found.append(Damage.LENGTH)
                damaged += 1
                continue
            if crc32(body) != RESIDUE:
                found.append(Damage.CRC)
                damaged += 1
                continue
            header = unpack(body)
            version_flags, node, type_id, seq, _, payload = header
            sender = node & sender_mask
            try:
                spec, cls, unpack = plain[type_id << 8 | len(payload)]
                if (
                    expected[sender] == seq
                    and version_flags & _PLAIN == OWN_VERSION
                    and type_id not in disabled
                ):
                    by_type[type_id] += 1
                    expected[sender] = (seq + 1) & 0xFF
                    ordinary += 1
                    message = _new(cls, unpack(payload))  # type: ignore[type-var]  # a tuple
                    found.append(_new(Received, (message, _new(Frame, header), spec)))
                    continue
            except KeyError:
                pass  # the first of its sender or type, or one with a text
            found.append(self._interpret(_new(Frame, header)))
        statistics.frames_in += ordinary
        parser.frames += len(found)
        if damaged:
            statistics.damaged += damaged
            parser.locate(found, pieces)
        return found

    def _interpret(self, frame: Frame) -> LinkEvent:
        version_flags, node, type_id, seq, *_ = frame
        if version_flags >> 4 != PROTOCOL_VERSION:
            return self._reject(frame, "version")
        codec = self.codec
        spec = codec.catalogue.by_type.get(type_id)
        if spec is not None and spec.direction is self._sends:
            return self._reject(frame, "direction")
        statistics = self.statistics
        statistics.frames_in += 1
        try:
            statistics.by_type[type_id] += 1
        except KeyError:
            statistics.by_type[type_id] = 1
        sender = node & self._sender_mask
        booted = spec is not None and spec.name == _HELLO and self._booted(sender, spec, frame)
        if booted or seq == self._expected_seq.get(sender, seq):
            self._expected_seq[sender] = (seq + 1) & 0xFF
        else:
            self._out_of_sequence(sender, seq)
        if spec is None:
            return self._reject(frame, "type")
        genuine = True
        if version_flags & FLAG_AUTHENTICATED and type_id not in self.disabled:
            if spec.name == _STOP:  # obeyed from anyone, so whatever its tag; it is not genuine
                frame = frame._replace(version_flags=version_flags & ~FLAG_AUTHENTICATED)
            else:
                frame, genuine = self._opened(frame)
        if not genuine or type_id in self.disabled:
            return self._reject(frame, "disabled" if genuine else "key")
        try:
            return _new(Received, (codec.decode(spec, frame.payload), frame, spec))
        except PayloadError:
            return self._reject(frame, "payload")

    def _opened(self, frame: Frame) -> tuple[Frame, bool]:
        """A frame that says it is authenticated without its trailer, and whether it is."""
        payload, trailer = frame.payload[: -TRAILER.size], frame.payload[-TRAILER.size :]
        frame = frame._replace(payload=payload)
        covered = PACK_BODY[len(payload)](*frame)
        return frame, self.key is not None and self.key.check(covered, trailer)

    def _booted(self, sender: int, spec: MessageSpec, frame: Frame) -> bool:
        """Whether a hello is of another boot than the one before: its numbers begin anew."""
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
        """Expect any sequence number next: the peer has booted anew."""
        self._expected_seq.clear()

    # ---- sending --------------------------------------------------------------------------

    def data_to_send(self) -> bytes:
        """Fetch and forget what is queued."""
        if not self._queue:
            return b""
        # With a leading delimiter on an idle line, a damaged tail costs no intact neighbour.
        data = b"\0"
        seq = self._seq
        for node, type_id, t_us, payload, flags in self._queue:  # hardly ever more than one
            # As encode_frame does it, in the same breath.
            pack = PACK_BODY[len(payload)]
            body = pack(OWN_VERSION | flags, node, type_id, seq, t_us & 0xFFFF_FFFF, payload)
            if flags & FLAG_AUTHENTICATED and self.key is not None:
                body += self.key.sign(body)
            data += cobs.encode(body + pack_crc(crc32(body))) + b"\0"
            seq = (seq + 1) & 0xFF
        self._seq = seq
        self._queue.clear()
        self.statistics.bytes_out += len(data)
        return data

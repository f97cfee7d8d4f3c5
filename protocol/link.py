"""One end of a link over UART: frames in, messages out, and the accounts of both.

Sans-I/O: bytes are handed in, messages and events come back, and what is to be written is
fetched with :meth:`Link.data_to_send`. It does not know which end it plays beyond the
direction of the messages that it sends.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from protocol.catalogue import PROTOCOL_VERSION
from protocol.codec import Codec
from protocol.errors import LocalError, PayloadError
from protocol.message import Direction, Message
from protocol.uart import MAX_NODE, DamagedFrame, Frame, UartParser, check_frame, encode_checked

if TYPE_CHECKING:
    from protocol.message import MessageSpec

NODE_ALL = 0
"""Addresses every device; for stop, hello and time requests only."""
NODE_MAX = MAX_NODE
_HALF_SEQ = 128
_new = tuple.__new__


class Received(NamedTuple):
    """An intact message that is meant for this end."""

    message: Message
    frame: Frame
    spec: MessageSpec


class _Waiting(NamedTuple):
    """A frame to be: it takes its sequence number as it leaves, or a replaced one is a gap."""

    node: int
    type_id: int
    t_us: int
    payload: bytes
    flags: int


@dataclass(frozen=True, slots=True)
class Rejected:
    """An intact frame that this end could not use."""

    frame: Frame
    reason: str
    """``version``, ``direction``, ``type``, ``disabled`` or ``payload``."""


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


class Link:
    """Turns a byte stream into messages and messages into bytes."""

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        self.codec = codec or Codec()
        self.statistics = LinkStatistics()
        self.disabled: set[int] = set()
        """Types whose declaration the peer does not share: neither sent nor decoded."""
        self._sends = sends
        self._parser = UartParser()
        self._seq = 0
        self._expected_seq: dict[int, int] = {}
        # A device's frames name it; a host counts all its own together, whatever node they name.
        self._sender_mask = 0xFF if sends is Direction.HOST else 0
        self._queue: list[_Waiting] = []

    # ---- receiving ------------------------------------------------------------------------

    def receive(self, data: bytes) -> list[LinkEvent]:
        """Take bytes from the port; give what they complete, in order."""
        self.statistics.bytes_in += len(data)
        return [
            self._interpret(item) if isinstance(item, Frame) else self._damage(item)
            for item in self._parser.feed(data)
        ]

    def _damage(self, item: DamagedFrame) -> DamagedFrame:
        self.statistics.damaged += 1
        return item

    def _interpret(self, frame: Frame) -> LinkEvent:
        version_flags, node, type_id, seq, _, payload = frame
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
        if seq == self._expected_seq.get(sender, seq):
            self._expected_seq[sender] = (seq + 1) & 0xFF
        else:
            self._out_of_sequence(sender, seq)
        if spec is None:
            return self._reject(frame, "type")
        if type_id in self.disabled:
            return self._reject(frame, "disabled")
        try:
            return _new(Received, (codec.decode(spec, payload), frame, spec))
        except PayloadError:
            return self._reject(frame, "payload")

    def _reject(self, frame: Frame, reason: str) -> Rejected:
        self.statistics.rejected += 1
        return Rejected(frame, reason)

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
        if self.codec.catalogue.by_type[type_id].direction is not self._sends:
            raise WrongDirectionError(type(message).__name__)
        check_frame(node, type_id, payload, flags)
        statistics = self.statistics
        if latest:
            kept = [w for w in self._queue if w.type_id != type_id or w.node != node]
            replaced = len(self._queue) - len(kept)
            statistics.superseded += replaced
            statistics.frames_out -= replaced
            self._queue = kept
        self._queue.append(_Waiting(node, type_id, t_us, payload, flags))
        statistics.frames_out += 1
        return True

    def data_to_send(self) -> bytes:
        """Fetch and forget what is queued."""
        if not self._queue:
            return b""
        # With a leading delimiter on an idle line, a damaged tail costs no intact neighbour.
        wires = [b"\0"]
        for node, type_id, t_us, payload, flags in self._queue:
            wires.append(encode_checked(node, type_id, self._seq, t_us, payload, flags))
            self._seq = (self._seq + 1) & 0xFF
        self._queue.clear()
        data = b"".join(wires)
        self.statistics.bytes_out += len(data)
        return data

    @property
    def has_data(self) -> bool:
        """True where something waits to be written."""
        return bool(self._queue)

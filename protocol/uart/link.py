"""One end of a link over a serial line: its bytes to messages, and messages to bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zlib import crc32

from cobs import cobs

from protocol.authentication import TRAILER
from protocol.errors import PayloadError
from protocol.link import LinkBase, Medium, Received
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.framing import (
    FLAG_AUTHENTICATED,
    OWN_VERSION,
    PACK_BODY,
    RESIDUE,
    UNPACK_BODY,
    Damage,
    Frame,
    UartParser,
    pack_crc,
)

if TYPE_CHECKING:
    from protocol.link import LinkEvent
    from protocol.schema.codec import Codec
    from protocol.schema.message import MessageSpec

_HALF_SEQ = 128
_STOP = "stop"
"""Name of the message that needs no tag, and is not refused for a wrong one."""
_HELLO = "hello"
"""Name of the message that says which boot a device's sequence numbers are of."""
_PLAIN = 0xF0 | FLAG_AUTHENTICATED
"""Version and this flag: a frame that claims to be authenticated never goes the short way."""
_new = tuple.__new__


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

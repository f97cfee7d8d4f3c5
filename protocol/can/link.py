"""One end of a link over classic CAN: the same messages and events as over UART.

This module passes each CAN frame as 16 bytes (:data:`protocol.can.frames.RECORD`), so that ports
and logs handle both media in the same form.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

from protocol.authentication import CAN_AUTH_TYPE, SIGNED_TYPES
from protocol.can.awaiting_tag import HeldMessages
from protocol.can.frames import (
    RECORD,
    T16,
    T32,
    CanFrame,
    Part,
    from_record,
    is_native,
    join,
    pack,
    parts_of,
    to_record,
)
from protocol.can.stamps import StampExtender
from protocol.can.transfers import (
    FLAG_WHOLE_STAMP,
    TRANSFER,
    Reassembler,
    TransferResult,
    content,
    parse_content,
    segments,
)
from protocol.errors import FieldRangeError, PayloadError
from protocol.link import LinkBase, LinkStatistics, Medium, Received
from protocol.messages.device import Sync
from protocol.messages.host import Stop
from protocol.schema.catalogue import PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.framing import FLAG_AUTHENTICATED, Damage, DamagedFrame, Frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from protocol.link import LinkEvent
    from protocol.schema.codec import Codec
    from protocol.schema.message import Message, MessageSpec

DUPLICATE_US = 500_000
"""Maximum time between two equal frames that count as duplicates, µs. Stamps and transfer ids
repeat only after a longer time."""
_SPAN32, _HALF32 = 1 << 32, 1 << 31
_VERSION = PROTOCOL_VERSION << 4
_ID_SIZE = 2
_rank = itemgetter(5)


@dataclass(slots=True)
class CanStatistics(LinkStatistics):
    """Counts of frames by result; ``lost`` is derived from the frame count in Sync."""

    foreign: int = 0
    """Number of frames in another format."""
    duplicates: int = 0
    stale: int = 0
    """Number of frames whose short stamp was too old to be extended."""
    incomplete: int = 0
    """Number of parts of messages whose other parts did not arrive."""
    given_up: int = 0
    """Number of transfers that were dropped because a frame was missing."""


class _Native(NamedTuple):
    """Periodic message that a frame belongs to, and the frame's part number."""

    spec: MessageSpec
    part: int


@dataclass(slots=True)
class _Incomplete:
    """A message of which some parts are missing."""

    stamp_us: int
    frames: dict[int, CanFrame]
    """Received frames by part number."""


class _Sender:
    """State of one sender on the bus."""

    def __init__(self) -> None:
        self.stamps = StampExtender()
        self.pending: dict[tuple[int, int], _Incomplete] = {}
        """Incomplete messages by node and message type. In a host's message, the node is the
        addressed device."""
        self.slow: dict[tuple[int, int], bytes] = {}
        self.messages = 0
        """Number of messages delivered. It replaces the sequence number, which CAN frames do not
        have."""
        self.frames = 0
        """Number of frames since the last Sync."""
        self.count: int | None = None
        """Frame count in the last Sync."""


class CanLink(LinkBase):
    """Turns CAN frames into messages and messages into CAN frames."""

    medium = Medium.CAN
    statistics: CanStatistics

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        super().__init__(sends, codec=codec)
        self.statistics = CanStatistics()
        self._reassembler = Reassembler()
        self._senders: dict[int, _Sender] = {}
        self._last: dict[int, tuple[bytes, int]] = {}
        self._partial = b""
        self._native = {
            part.can_type: _Native(spec, number)
            for spec in self.codec.catalogue
            if is_native(spec)
            for number, part in enumerate(spec.can_parts)
        }
        self._bare = {
            spec.type_id: spec
            for spec in self.codec.catalogue
            if spec.is_bare and spec.direction is not sends
        }
        self._parts: dict[tuple[int, int], tuple[Part, ...]] = {}
        self._transfer_ids: dict[int, int] = {}
        self._slow_sent_us: dict[int, int] = {}
        self._frame_count = 0
        self._held = HeldMessages()
        self._unmarked: list[Received] = []
        """Held messages to deliver as untagged, because the next message arrived before the tag."""

    def _parts_of(self, spec: MessageSpec) -> tuple[Part, ...]:
        shared = self.codec.shared_fields(spec)
        parts = self._parts.get((spec.type_id, shared))
        if parts is None:
            parts = self._parts[spec.type_id, shared] = parts_of(spec, shared)
        return parts

    # ---- receiving ------------------------------------------------------------------------

    @property
    def held_bytes(self) -> int:
        """Size of the incomplete transfers, bytes."""
        return self._reassembler.held_bytes

    def receive(self, data: bytes, now_us: int) -> list[LinkEvent]:
        """Process frames that arrived at ``now_us`` of our clock; return the completed events."""
        data = self._partial + data
        whole = len(data) - len(data) % RECORD.size
        self._partial = data[whole:]
        events: list[LinkEvent] = [*self._held.late(now_us)]
        for offset in range(0, whole, RECORD.size):
            frame = from_record(data[offset : offset + RECORD.size])
            if frame is None:
                self.statistics.foreign += 1
                continue
            bare = self._bare.get(frame.can_type)
            event = self._frame(frame, now_us) if bare is None else self._take_bare(frame, bare)
            if event is not None:
                events.append(event)
            events += self._unmarked
            self._unmarked.clear()
        return events

    def _frame(self, frame: CanFrame, now_us: int) -> LinkEvent | None:
        statistics = self.statistics
        can_id, data = frame
        statistics.bytes_in += _ID_SIZE + len(data)
        last = self._last.get(can_id)
        if last is not None and last[0] == data and now_us - last[1] < DUPLICATE_US:
            statistics.duplicates += 1
            return None
        self._last[can_id] = (data, now_us)
        native = self._native.get(frame.can_type)
        spec = native.spec if native else self.codec.catalogue.by_type.get(frame.can_type)
        if spec is None:
            statistics.frames_in += 1
            self._sender(frame.node).frames += 1
            return self._tag(frame, now_us)
        if spec.direction is self._sends:
            if self._sends is Direction.DEVICE:
                return None  # from another device; a CAN controller's filter drops it
            head = Frame(_VERSION, frame.node, spec.type_id, 0, 0, data)
            return self._reject(head, "direction")
        statistics.frames_in += 1
        statistics.by_type[spec.type_id] = statistics.by_type.get(spec.type_id, 0) + 1
        self._sender(frame.node).frames += 1
        if native is not None:
            return self._take_native(frame, native, now_us)
        return self._take_segment(frame, spec, now_us)

    def _take_bare(self, frame: CanFrame, spec: MessageSpec) -> LinkEvent:
        """Process a message without fields: the frame's data is ignored, and repeats are valid."""
        self.statistics.bytes_in += _ID_SIZE + len(frame.data)
        self.statistics.frames_in += 1
        by_type = self.statistics.by_type
        by_type[spec.type_id] = by_type.get(spec.type_id, 0) + 1
        self._sender(frame.node).frames += 1
        return self._interpret(spec, frame.node, _VERSION, 0, b"")

    def _tag(self, frame: CanFrame, now_us: int) -> LinkEvent:
        """Handle a frame that is not part of a message: a tag, or an unknown type."""
        head = Frame(_VERSION, frame.node, frame.can_type, 0, 0, frame.data)
        if frame.can_type != CAN_AUTH_TYPE or self.key is None:
            return self._reject(head, "type")
        held = self._held.tagged(frame.node, frame.data, self.key, now_us)
        if held is None:
            return self._reject(head, "key")
        self._sender(frame.node).stamps = held.stamps
        return held.event

    @property
    def _guards(self) -> bool:
        """Return whether frames of the peer need tags."""
        return self.key is not None and self.key.begun and self._sends is Direction.DEVICE

    def _stamps_of(self, sender: _Sender) -> StampExtender:
        """Return the sender's stamp state; a copy if only a valid tag may change the state."""
        return copy(sender.stamps) if self._guards else sender.stamps

    def _sender(self, node: int) -> _Sender:
        # The node in a device's frame is the sender. The node in a host's frame is the addressee,
        # so all frames of the host count as one sender, 0.
        node = node if self._sends is Direction.HOST else 0
        sender = self._senders.get(node)
        if sender is None:
            sender = self._senders[node] = _Sender()
        return sender

    def _interpret(
        self, spec: MessageSpec, node: int, version_flags: int, t_us: int, payload: bytes
    ) -> LinkEvent:
        sender = self._sender(node)
        seq = sender.messages & 0xFF
        frame = Frame(version_flags, node, spec.type_id, seq, t_us & 0xFFFF_FFFF, payload)
        if version_flags >> 4 != PROTOCOL_VERSION:
            return self._reject(frame, "version")
        if spec.type_id in self.disabled:
            return self._reject(frame, "disabled")
        try:
            received = Received(self.codec.decode(spec, payload), frame, spec)
        except PayloadError:
            return self._reject(frame, "payload")
        sender.messages += 1
        return received

    # ---- receiving: periodic messages

    def _take_native(self, frame: CanFrame, native: _Native, now_us: int) -> LinkEvent | None:
        spec, data, sender = native.spec, frame.data, self._sender(frame.node)
        stamps = self._stamps_of(sender)
        if spec.full_stamp:
            if len(data) < T32.size:
                return self._malformed(frame, spec)
            stamp_us: int | None = stamps.whole(T32.unpack_from(data)[0], now_us)
            payload = data[T32.size :]
        else:
            if len(data) < T16.size:
                return self._malformed(frame, spec)
            stamp_us = stamps.short(T16.unpack_from(data)[0], now_us)
            payload = data[T16.size :]
        if stamp_us is None:
            self.statistics.stale += 1
            return None
        self._expire(sender, stamp_us)
        parts, frames = self._parts_of(spec), [frame]
        if len(parts) > 1 or native.part:  # a part may also have no shared field
            whole = self._join(sender, frame, native, parts, stamp_us, payload)
            if whole is None:
                return None
            payload, frames = whole
        event = self._interpret(spec, frame.node, _VERSION, stamp_us, payload)
        if isinstance(event, Received) and isinstance(event.message, Sync):
            self._count(sender, event.message.frame_count)
        return self._guarded(event, frames, stamps, now_us)

    def _guarded(
        self,
        event: LinkEvent,
        covered: Sequence[tuple[int, bytes]],
        stamps: StampExtender,
        now_us: int,
    ) -> LinkEvent | None:
        """Hold a message that needs a tag until the tag arrives; return any other event at once."""
        if not self._guards or not isinstance(event, Received):
            return event
        if event.spec.type_id not in SIGNED_TYPES:
            return event
        before = self._held.hold(event, covered, stamps, now_us)
        if before is not None:
            self._unmarked.append(before)
        return None

    def _malformed(self, frame: CanFrame, spec: MessageSpec) -> LinkEvent:
        return self._reject(Frame(_VERSION, frame.node, spec.type_id, 0, 0, frame.data), "payload")

    def _join(  # noqa: PLR0913, PLR0917 - a frame, taken apart
        self,
        sender: _Sender,
        frame: CanFrame,
        native: _Native,
        parts: tuple[Part, ...],
        stamp_us: int,
        payload: bytes,
    ) -> tuple[bytes, list[CanFrame]] | None:
        """Return the payload that a frame completes, and the message's frames with this stamp."""
        spec, number = native
        part = next((p for p in parts if p.number == number), None)
        if part is None:  # only the peer has the fields of this part
            self.codec.extra_bytes += len(payload)
            return None
        if part.slow_us:
            sender.slow[spec.type_id, number] = payload
            return None
        place = frame.node, spec.type_id
        pending = sender.pending.get(place)
        if pending is not None and pending.stamp_us != stamp_us:
            self._drop(sender, place)
            pending = None
        if pending is None:
            pending = sender.pending[place] = _Incomplete(stamp_us, {})
        pending.frames[number] = frame
        quick = [p for p in parts if not p.slow_us]
        if len(pending.frames) < len(quick):
            return None
        slow = {p.number: sender.slow.get((spec.type_id, p.number)) for p in parts if p.slow_us}
        if None in slow.values():  # not sent yet; it will arrive within its period
            self._drop(sender, place)
            return None
        del sender.pending[place]
        known = {number: data for number, data in slow.items() if data is not None}
        payloads = {number: came.data[T16.size :] for number, came in pending.frames.items()}
        return join(spec.fields, payloads | known), [pending.frames[p.number] for p in quick]

    def _drop(self, sender: _Sender, place: tuple[int, int]) -> None:
        self.statistics.incomplete += len(sender.pending.pop(place).frames)

    def _expire(self, sender: _Sender, stamp_us: int) -> None:
        """Drop parts that are a period old by the sender's own clock."""
        for place, pending in list(sender.pending.items()):
            period_us = 1e6 / self.codec.catalogue.by_type[place[1]].default_hz
            if stamp_us - pending.stamp_us >= period_us:
                self._drop(sender, place)

    def _count(self, sender: _Sender, count: int) -> None:
        if sender.count is not None:
            missing = (count - sender.count - sender.frames) % _SPAN32
            if missing < _HALF32:
                self.statistics.lost += missing
            else:
                self.statistics.reordered += _SPAN32 - missing
        sender.count, sender.frames = count, 0

    # ---- receiving: transfers

    def _take_segment(self, frame: CanFrame, spec: MessageSpec, now_us: int) -> LinkEvent | None:
        statistics, reassembler = self.statistics, self._reassembler
        whole = reassembler.feed(frame.can_id, frame.data, now_us)
        statistics.given_up = reassembler.given_up
        if isinstance(whole, TransferResult):
            if whole is TransferResult.DAMAGED:
                statistics.damaged += 1
                return DamagedFrame(
                    Damage.CRC, statistics.bytes_in - len(frame.data), len(frame.data), frame.data
                )
            return None
        parsed = parse_content(whole)
        if parsed is None:
            return self._malformed(frame, spec)
        sender = self._sender(frame.node)
        stamps = self._stamps_of(sender)
        if parsed.whole:
            sender.stamps.newest = parsed.stamp, now_us
            stamp_us: int | None = stamps.whole(parsed.stamp, now_us)
        else:
            stamp_us = stamps.short(parsed.stamp, now_us)
            if stamp_us is None and spec.cls is Stop:
                stamp_us = stamps.sender_us(now_us)  # valid at any age
        if stamp_us is None:
            statistics.stale += 1
            return None
        flags = parsed.version_flags
        if self.key is not None:
            flags &= ~FLAG_AUTHENTICATED  # only the tag decides, not the frame's flag
        event = self._interpret(spec, frame.node, flags, stamp_us, parsed.payload)
        return self._guarded(event, [(frame.can_id, whole)], stamps, now_us)

    def forget_sequence(self) -> None:
        """Reset counts, clocks and incomplete messages, because the peer has booted.

        The stamp of the peer's hello stays, because later short stamps are extended from it.
        """
        for node, before in list(self._senders.items()):
            sender = self._senders[node] = _Sender()
            sender.stamps = before.stamps
            sender.stamps.restart()

    # ---- sending --------------------------------------------------------------------------

    def send(  # noqa: PLR0913 - the frame, and how it waits
        self,
        message: Message,
        t_us: int,
        *,
        node: int,
        flags: int = 0,
        latest: bool = False,
        rank: int | None = None,
    ) -> bool:
        """Queue a message as on any link; on CAN, ``flags`` has three bits instead of four.

        Raises:
            FieldRangeError: a value does not fit, or ``flags`` has the bit that CAN needs.

        """
        if flags & FLAG_WHOLE_STAMP:
            raise FieldRangeError("frame", "flags", flags)
        return super().send(message, t_us, node=node, flags=flags, latest=latest, rank=rank)

    def data_to_send(self) -> bytes:
        """Return and remove the queued frames, lowest rank first."""
        queue = self._queue.take()
        if not queue:
            return b""
        queue.sort(key=_rank)
        records: list[bytes] = []
        for node, type_id, t_us, payload, flags, _ in queue:
            spec = self.codec.catalogue.by_type[type_id]
            if spec.is_bare:
                frames = [CanFrame(type_id << 4 | node, b"")]
                self._frame_count += 1
                covered: Sequence[tuple[int, bytes]] = frames
            elif is_native(spec):
                frames = self._pack(spec, node, t_us, payload)
                covered = frames
            else:
                can_id = type_id << 4 | node
                transfer = self._transfer_ids.get(can_id, -1) + 1
                self._transfer_ids[can_id] = transfer & TRANSFER
                whole = content(_VERSION | flags, t_us, payload)
                frames = [CanFrame(can_id, data) for data in segments(whole, transfer)]
                self._frame_count += len(frames)
                covered = [(can_id, whole)]
            if flags & FLAG_AUTHENTICATED and self.key is not None:
                tag = self.key.sign_can(covered)
                frames.append(CanFrame(CAN_AUTH_TYPE << 4 | node, tag))
                self._frame_count += 1
            records += [to_record(frame) for frame in frames]
            self.statistics.bytes_out += sum(_ID_SIZE + len(f.data) for f in frames)
        # Each queued message was counted as one frame. Add the additional frames of long messages.
        self.statistics.frames_out += len(records) - len(queue)
        return b"".join(records)

    def _pack(self, spec: MessageSpec, node: int, t_us: int, payload: bytes) -> list[CanFrame]:
        frames = []
        for part in self._parts_of(spec):
            if part.slow_us:
                sent_us = self._slow_sent_us.get(part.can_type)
                if sent_us is not None and (t_us - sent_us) % _SPAN32 < part.slow_us:
                    continue
                self._slow_sent_us[part.can_type] = t_us
            self._frame_count += 1
            if spec.cls is Sync:  # the count depends on the order of transmission, known only now
                payload = T32.pack(self._frame_count % _SPAN32)
            frames.append(CanFrame(part.can_type << 4 | node, pack(part, payload, t_us)))
        return frames

"""Properties that hold for any bytes, one function for each reader of bytes.

Each function takes the fuzzer's bytes and raises an exception on an error. The first byte of an
input determines how the rest is split into reads.
"""

from __future__ import annotations

import gc
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING

from protocol.can.link import CanLink
from protocol.errors import ProtocolError
from protocol.link import Received
from protocol.messages.device import Encoders, LogText
from protocol.messages.host import VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.batch import REASONS, decode_capture
from protocol.uart.framing import DamagedFrame, Frame, UartParser, encode_frame
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from protocol.schema.message import Message

_FRAMED = b"\0" + encode_frame(1, 0x16, 7, 5, b"\1\2\3\4")
_HELD_MAX = 200_000
"""Maximum memory of a reader with its tables of the catalogue, bytes; a frame has 254."""
_LONG = 600
_SPAN_US = 1 << 36


def parser(data: bytes) -> None:
    """Check that the events do not depend on the split, and that the next frame is found."""
    whole, cut = UartParser(), UartParser()
    events = whole.feed(data)
    assert [e for piece in _pieces(data) for e in cut.feed(piece)] == events
    assert whole.frames + whole.damaged == len(events)
    assert whole.frames == sum(isinstance(e, Frame) for e in events)
    _bounded(cut, data)
    *_, last = cut.feed(_FRAMED)
    assert isinstance(last, Frame)
    assert last.payload == b"\1\2\3\4"


def link(data: bytes) -> None:
    """Check that both ends accept any bytes, count all of them and receive the next frame."""
    for sends, message in _NEXT:
        end = Link(sends)
        events = [e for piece in _pieces(data) for e in end.receive(piece)]
        counts = end.statistics
        assert counts.bytes_in == len(data)
        received = sum(isinstance(e, Received) for e in events)
        assert received + counts.rejected + counts.damaged == len(events)
        assert [e for e in events if isinstance(e, DamagedFrame)] == [
            e for e in UartParser().feed(data) if isinstance(e, DamagedFrame)
        ]
        _bounded(end, data)
        far = Link(Direction.HOST if sends is Direction.DEVICE else Direction.DEVICE)
        far.send(message, 5, node=1)
        *_, last = end.receive(far.data_to_send())
        assert isinstance(last, Received)
        assert last.message == message


def codec(data: bytes) -> None:
    """Check that a payload is rejected, or read as a message that encodes to the same bytes."""
    if not data:
        return
    spec = CATALOGUE.specs[data[0] % len(CATALOGUE.specs)]
    both = Codec()
    if data[0] >= _HALF and not spec.bootstrap:
        both.limit(spec.type_id, data[0] % (len(spec.fields) + 1))
    try:
        message = both.decode(spec, data[1:])
    except ProtocolError:
        return
    if None in tuple(message):
        return  # a message with fields that the peer lacks is never sent
    type_id, payload = Codec().encode(message)
    assert type_id == spec.type_id
    assert Codec().decode(spec, payload) == message


def batch(data: bytes) -> None:
    """Check that the arrays equal the streaming parser's events."""
    result = decode_capture(data, chunk_bytes=32 + (data[0] if data else 0) * 8)
    events = UartParser().feed(data)
    rows = [
        (o, n, result.damage_of(d)) for o, n, d in result.damaged[["offset", "length", "damage"]]
    ]
    assert rows == [(e.offset, e.length, e.damage) for e in events if isinstance(e, DamagedFrame)]
    frames = [e for e in events if isinstance(e, Frame)]
    assert result.message_count + len(result.rejected) == len(frames)
    assert all(r < len(REASONS) for r in result.rejected["reason"])
    stamps = [int(t) for array in result.messages.values() for t in array["t_us"]]
    stamps += [int(t) for t in result.rejected["t_us"]]
    assert sorted(stamps) == sorted(f.t_us for f in frames)


def can(data: bytes) -> None:
    """Check that CAN frames of any form, order and time need bounded memory."""
    for sends in Direction:
        end = CanLink(sends)
        now_us = 0
        for piece in _pieces(data):
            now_us = (now_us + sum(piece) * 1000) % _SPAN_US
            end.receive(piece, now_us)
        _bounded(end, data)


def _pieces(data: bytes) -> Iterator[bytes]:
    size = 1 + data[0] if data else 1
    return (data[start : start + size] for start in range(0, len(data), size))


def _bounded(reader: object, data: bytes) -> None:
    if len(data) > _LONG:
        assert held_bytes(reader) < _HELD_MAX


def held_bytes(root: object) -> int:
    """Return the memory of an object, without code and without the shared catalogue, bytes."""
    seen: set[int] = set()
    waiting = [root]
    total = 0
    while waiting:
        item = waiting.pop()
        if id(item) in seen or isinstance(item, (type, ModuleType, FunctionType, Catalogue)):
            continue
        seen.add(id(item))
        if type(item).__name__ in {"MessageSpec", "builtin_function_or_method", "mappingproxy"}:
            continue
        total += item.__sizeof__()
        waiting += gc.get_referents(item)
    return total


_HALF = 128
_NEXT: tuple[tuple[Direction, Message], ...] = (
    (Direction.HOST, LogText(level=1, line="on")),
    (Direction.HOST, Encoders(left=1, right=2)),
    (Direction.DEVICE, VelocitySetpoint(v=1, yaw_rate=0, time_to_live=250, counter=1)),
)
TARGETS: dict[str, Callable[[bytes], None]] = {
    f.__name__: f for f in (parser, link, codec, batch, can)
}

"""Decodes a whole capture to numpy arrays, one per message type.

The result equals the result of :class:`protocol.uart.framing.UartParser` and
:class:`protocol.schema.codec.Codec`. It includes damaged stretches of bytes with their offset in
the capture. All frames of the same length are decoded together (:mod:`protocol.uart.batch_frames`);
only texts are decoded one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.uart.batch_frames import (
    DAMAGES,
    INTACT,
    LENGTH,
    OFFSET_SIZE,
    decode_frames,
    find_stretches,
)
from protocol.uart.framing import HEADER, MAX_ENCODED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from protocol.schema.message import MessageSpec
    from protocol.uart.framing import Damage


class Readable(Protocol):
    """Interface of a file that is open for reading bytes."""

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes; none at the end."""


CHUNK_BYTES = 1 << 20
"""Number of bytes per decoding step. The memory needed, without the result, is about ten times
this."""
REASONS = ("version", "type", "payload")
"""Reasons why an intact frame is not a message of the catalogue. The index is the code in
``rejected``."""
DAMAGED_DTYPE = np.dtype([("offset", "<i8"), ("length", "<i8"), ("damage", "u1")])
REJECTED_DTYPE = np.dtype(
    {
        "names": ["offset", "version", "flags", "node", "type_id", "seq", "t_us", "reason"],
        "formats": ["<i8", "u1", "u1", "u1", "u1", "u1", "<u4", "u1"],
    }
)
_HEAD = {
    "offset": ("<i8", 0),
    "frame_flags": ("u1", OFFSET_SIZE),
    "node": ("u1", OFFSET_SIZE + 1),
    "type_id": ("u1", OFFSET_SIZE + 2),
    "seq": ("u1", OFFSET_SIZE + 3),
    "t_us": ("<u4", OFFSET_SIZE + 4),
}
"""Format and offset of the header's fields in each row."""
_HEAD_DTYPE = np.dtype([(name, code) for name, (code, _) in _HEAD.items()])
_HEAD_SIZE = OFFSET_SIZE + HEADER.size
_FLAGS, _TYPE = OFFSET_SIZE, OFFSET_SIZE + 2
_FORMATS = {"u8": "u1", "u16": "<u2", "u32": "<u4", "i16": "<i2", "uid96": "V12"}


@dataclass(frozen=True, slots=True)
class BatchResult:
    """Content of a capture; the rows of each array are in the order of the capture."""

    catalogue: Catalogue
    messages: dict[str, NDArray[np.void]]
    """Array of :func:`row_dtype` for each message name; empty if the capture has no such
    message."""
    damaged: NDArray[np.void]
    """Damaged stretches as rows of :data:`DAMAGED_DTYPE`; see :meth:`damage_of`."""
    rejected: NDArray[np.void]
    """Intact frames that are not messages of the catalogue, as rows of :data:`REJECTED_DTYPE`."""
    bytes_seen: int
    """Number of bytes of the capture up to the end of this result."""

    @property
    def message_count(self) -> int:
        """Number of messages of all types."""
        return sum(len(rows) for rows in self.messages.values())

    @staticmethod
    def damage_of(code: int) -> Damage:
        """Return the meaning of a code in ``damaged["damage"]``."""
        return DAMAGES[code]

    def si(self, message: str, field: str) -> NDArray[np.float64]:
        """Return one field's values in SI units; NaN for the sentinel."""
        declared = next(f for f in self.catalogue.by_name[message].fields if f.name == field)
        raw = self.messages[message][field]
        values: NDArray[np.float64] = raw * declared.si_gain + declared.si_offset
        if declared.none is not None:
            values[raw == declared.none] = np.nan
        return values


def row_dtype(spec: MessageSpec) -> np.dtype[np.void]:
    """Return the columns of one message type: offset, header, then the raw fields by name.

    ``offset`` is the index of the frame's first encoded byte in the capture. ``frame_flags`` are
    the flags in the header; a message may have a field named ``flags``. A 96-bit id is a void of 12
    bytes, a text is an object (str).
    """
    fixed = _fixed_dtype(spec)
    if spec.text_field is None:
        return fixed
    columns: list[tuple[str, Any]] = [(name, fixed[name]) for name in fixed.names or ()]
    return np.dtype([*columns, (spec.text_field.name, "O")])


def _fixed_dtype(spec: MessageSpec) -> np.dtype[np.void]:
    """Return the columns with the same layout as the frame, without the constant type byte."""
    heads = [name for name in _HEAD if name != "type_id"]
    names = [*heads]
    formats = [_HEAD[name][0] for name in heads]
    places = [_HEAD[name][1] for name in heads]
    place = _HEAD_SIZE
    for field in spec.fields:
        if not field.wire.is_text:
            names.append(field.name)
            formats.append(_FORMATS[field.wire.name])
            places.append(place)
            place += field.wire.size
    return np.dtype({"names": names, "formats": formats, "offsets": places, "itemsize": place})


def decode_capture(
    source: bytes | Iterable[bytes] | Readable,
    catalogue: Catalogue = CATALOGUE,
    *,
    chunk_bytes: int = CHUNK_BYTES,
) -> BatchResult:
    """Decode a whole capture: bytes, an iterable of consecutive pieces, or an open binary file.

    The memory needed, without the result, depends only on ``chunk_bytes``. If the result itself is
    too large, use :func:`iter_capture`.
    """
    return join(list(iter_capture(source, catalogue, chunk_bytes=chunk_bytes)), catalogue)


def iter_capture(
    source: bytes | Iterable[bytes] | Readable,
    catalogue: Catalogue = CATALOGUE,
    *,
    chunk_bytes: int = CHUNK_BYTES,
) -> Iterator[BatchResult]:
    """Decode a capture of any size in chunks; a frame belongs to the chunk in which it ends."""
    decoder = BatchDecoder(catalogue)
    for chunk in _chunks(source, chunk_bytes):
        yield decoder.feed(chunk)


def _chunks(
    source: bytes | Iterable[bytes] | Readable, chunk_bytes: int
) -> Iterator[bytes | memoryview]:
    if isinstance(source, (bytes, bytearray, memoryview)):
        view = memoryview(source)
        for start in range(0, len(view), chunk_bytes):
            yield view[start : start + chunk_bytes]
        return
    read = getattr(source, "read", None)
    if read is not None:
        while data := read(chunk_bytes):
            yield data
        return
    pieces: list[bytes] = []
    size = 0
    for piece in source:  # type: ignore[union-attr]  # no file: an iterable
        # Pieces read from a port are small. They are joined first, because a numpy call has a high
        # fixed cost.
        if size + len(piece) < chunk_bytes:
            pieces.append(piece)
            size += len(piece)
            continue
        yield from _chunks(b"".join([*pieces, piece]), chunk_bytes)
        pieces, size = [], 0
    yield b"".join(pieces)


def join(results: list[BatchResult], catalogue: Catalogue = CATALOGUE) -> BatchResult:
    """Concatenate the results of successive chunks."""
    if len(results) == 1:
        return results[0]
    empty = {spec.name: np.empty(0, row_dtype(spec)) for spec in catalogue}
    messages = {
        name: _concatenate([rows, *(r.messages[name] for r in results if len(r.messages[name]))])
        for name, rows in empty.items()
    }
    return BatchResult(
        catalogue,
        messages,
        np.concatenate([np.empty(0, DAMAGED_DTYPE), *(r.damaged for r in results)]),
        np.concatenate([np.empty(0, REJECTED_DTYPE), *(r.rejected for r in results)]),
        results[-1].bytes_seen if results else 0,
    )


class _Layout(NamedTuple):
    """Layout of one type's rows."""

    spec: MessageSpec
    fixed: np.dtype[np.void]
    """Columns without the text field."""
    row: np.dtype[np.void]


class BatchDecoder:
    """Decodes a capture in chunks; stores at most one incomplete frame between two chunks."""

    def __init__(self, catalogue: Catalogue = CATALOGUE) -> None:
        self.catalogue = catalogue
        self.bytes_seen = 0
        self._partial = b""
        self._overlong = 0
        """Number of dropped bytes of the present stretch, if it is already longer than any
        frame."""
        self._layouts = {s.type_id: _Layout(s, _fixed_dtype(s), row_dtype(s)) for s in catalogue}
        self._empty = {w.spec.name: np.empty(0, w.row) for w in self._layouts.values()}

    def feed(self, chunk: bytes | memoryview) -> BatchResult:
        """Decode the frames that end in the next chunk."""
        data = b"".join((self._partial, chunk))
        first = self.bytes_seen - len(self._partial)
        self.bytes_seen += len(chunk)
        end = data.rfind(b"\0") + 1
        # Store one byte more than the longest frame, so that the stretch still counts as too long.
        self._partial = data[end : end + MAX_ENCODED + 1]
        dropped = len(data) - end - len(self._partial)
        if not end:
            self._overlong += dropped
            return self._result(_Sorter(self._layouts))
        sorter = self._sort(data[:end], first)
        self._overlong = dropped
        return self._result(sorter)

    def _sort(self, data: bytes, first: int) -> _Sorter:
        sorter = _Sorter(self._layouts)
        found = find_stretches(data)
        if len(found.overlong_starts):
            offsets, lengths = found.overlong_starts + first, found.overlong_lengths.copy()
            if self._overlong:  # then the first stretch is already too long
                offsets[0] -= self._overlong
                lengths[0] += self._overlong
            sorter.damage(offsets, lengths, np.full(len(offsets), LENGTH, np.uint8))
        counts = np.bincount(found.lengths)
        for length in np.flatnonzero(counts).tolist():
            starts = found.starts
            if counts[length] < len(starts):
                starts = starts[found.lengths == length]
            rows, damage = decode_frames(data, starts, length, first)
            hit = damage != INTACT
            if hit.any():
                offsets = starts[hit] + first
                sorter.damage(offsets, np.full(len(offsets), length), damage[hit])
            if len(rows):
                sorter.frames(rows)
        return sorter

    def _result(self, sorter: _Sorter) -> BatchResult:
        return BatchResult(
            self.catalogue,
            {**self._empty, **{name: _ordered(parts) for name, parts in sorter.messages.items()}},
            _ordered([np.empty(0, DAMAGED_DTYPE), *sorter.damaged]),
            _ordered([np.empty(0, REJECTED_DTYPE), *sorter.rejected]),
            self.bytes_seen,
        )


def _concatenate(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    if len(parts) == 1:
        return parts[0]
    row = parts[0].dtype
    if row.hasobject:
        return np.concatenate(parts)
    # View the rows as plain bytes; numpy would copy structured rows column by column.
    whole = np.concatenate([part.view(f"V{row.itemsize}") for part in parts])
    return whole.view(row)


def _ordered(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    if len(parts) == 1:
        return parts[0]
    rows = _concatenate(parts)
    return rows[np.argsort(rows["offset"], kind="stable")]


class _Sorter:
    """Sorts rows of header and payload by message type."""

    def __init__(self, layouts: dict[int, _Layout]) -> None:
        self._layouts = layouts
        self.messages: dict[str, list[NDArray[np.void]]] = {}
        self.damaged: list[NDArray[np.void]] = []
        self.rejected: list[NDArray[np.void]] = []

    def damage(
        self, offsets: NDArray[np.int64], lengths: NDArray[np.int64], kinds: NDArray[np.uint8]
    ) -> None:
        """Add damaged stretches."""
        rows = np.empty(len(offsets), DAMAGED_DTYPE)
        rows["offset"], rows["length"], rows["damage"] = offsets, lengths, kinds
        self.damaged.append(rows)

    def frames(self, rows: NDArray[np.uint8]) -> None:
        """Add intact frames of one length."""
        current = rows[:, _FLAGS] >> 4 == PROTOCOL_VERSION
        if not current.all():
            self._reject(rows[~current], "version")
            rows = rows[current]
        types = rows[:, _TYPE]
        counts = np.bincount(types)
        for type_id in np.flatnonzero(counts).tolist():
            layout = self._layouts.get(type_id)
            own = rows if counts[type_id] == len(rows) else rows[types == type_id]
            if layout is None:
                self._reject(own, "type")
            else:
                self._message(layout, own)

    def _message(self, layout: _Layout, rows: NDArray[np.uint8]) -> None:
        spec, fixed = layout.spec, layout.fixed.itemsize
        extra = rows.shape[1] - fixed
        # As in the codec: a later version may append fields to a bootstrap message.
        if extra < 0 or (extra and spec.text_field is None and not spec.bootstrap):
            self._reject(rows, "payload")
            return
        head = rows if not extra else np.ascontiguousarray(rows[:, :fixed])
        head[:, _FLAGS] &= 0x0F
        made = head.view(layout.fixed).reshape(-1)
        if spec.text_field is not None:
            made = _with_text(layout.row, made, rows[:, fixed:])
        self.messages.setdefault(spec.name, []).append(made)

    def _reject(self, rows: NDArray[np.uint8], reason: str) -> None:
        head = np.ascontiguousarray(rows[:, :_HEAD_SIZE]).view(_HEAD_DTYPE).reshape(-1)
        made = np.empty(len(rows), REJECTED_DTYPE)
        for name in ("offset", "node", "type_id", "seq", "t_us"):
            made[name] = head[name]
        made["version"], made["flags"] = head["frame_flags"] >> 4, head["frame_flags"] & 0x0F
        made["reason"] = REASONS.index(reason)
        self.rejected.append(made)


def _with_text(
    row: np.dtype[np.void], head: NDArray[np.void], tails: NDArray[np.uint8]
) -> NDArray[np.void]:
    made = np.empty(len(head), row)
    for name in head.dtype.names or ():
        made[name] = head[name]
    made[(row.names or ())[-1]] = [tail.tobytes().decode("utf-8", "replace") for tail in tails]
    return made

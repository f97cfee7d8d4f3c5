"""Iteration over the records of an MCAP file. Damaged bytes are skipped and reported.

A record is valid if it fits the file and its fields fit the record. The bytes after it must look
like a record, or be damage that starts exactly at its end. If the record is not valid, the next
valid record is searched, and the bytes between are reported as damage. So a flipped bit in a length
field costs one record, not the rest of the file.
"""

from __future__ import annotations

import re
import struct
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.opcode import Opcode

from bridge.files import open_to_read
from bridge.record.errors import LogReadError
from bridge.record.mcap_file import MAGIC
from bridge.record.records_kernel import skip_indexes
from bridge.record.unpack import CHUNK_HEAD, HEAD

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

Bytes = bytes | mmap

_INDEX_HEAD = struct.Struct("<BQHI")
_INDEX_FIXED = 6
_WINDOW = 1 << 14
"""Number of bytes in which message indexes are skipped in one call. Most chunks have fewer."""
_LONGEST = 1 << 40
"""Maximum plausible length of a record, bytes."""
_FIRST_PRIVATE = 0x80
"""First opcode for private records."""
LAST_KNOWN = int(Opcode.DATA_END)
"""Last opcode of the specification."""
_MESSAGE_FIXED = 22
_FOOTER_BYTES = 20
_DATA_END_BYTES = 4
_IN_SUMMARY = frozenset(
    int(opcode)
    for opcode in (
        *(Opcode.FOOTER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX),
        *(Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET),
    )
)
"""Records that may follow the end of the data."""
_TWICE = frozenset({int(Opcode.CHUNK), int(Opcode.ATTACHMENT)})
"""Records that contain their size twice: in the record's head and before their data."""
_CANDIDATE = re.compile(rb"(?=[\x02-\x0f].{5}\x00\x00\x00)", re.DOTALL)
"""Pattern of an opcode of the specification, with a length below 2⁴⁰ bytes."""


class Found(NamedTuple):
    """One record: its offset and the range of its content."""

    opcode: int
    offset: int
    start: int
    end: int


class DamagedBytes(NamedTuple):
    """Bytes that are not a record."""

    offset: int
    end: int
    is_tail: bool
    """True if no record follows: the file is truncated, or the rest is damaged."""


@contextmanager
def opened(path: Path) -> Iterator[Bytes]:
    """Open an MCAP file as a memory map.

    Raises:
        LogReadError: the file is missing, cannot be read, or does not start like an MCAP file.

    """
    try:
        with open_to_read(path) as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise LogReadError(path, "it is not an MCAP file")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data
    except OSError as error:
        raise LogReadError(path, error.strerror or str(error)) from None


class RecordSearch:
    """Search for the next record, with a cache of the last result.

    The result is valid for every start offset up to the found record. Without the cache, each
    damaged record would start a search that reads up to the end of the file.
    """

    def __init__(self, data: Bytes) -> None:
        """Search in ``data``."""
        self._data = data
        self._answers: dict[bool, tuple[int, int | None]] = {False: (0, -1), True: (0, -1)}
        """Start and result of the last search, by ``only_sized``."""

    def after(self, position: int, *, only_sized: bool = False) -> int | None:
        """Return the first valid offset after ``position``; None: no valid record.

        Args:
            position: Offset after which to search.
            only_sized: Search only chunks and attachments, which never occur inside a chunk.

        """
        begin = position + 1
        first, found = self._answers[only_sized]
        if begin < first or (found is not None and begin > found):
            found = _next(self._data, begin, _TWICE if only_sized else _SHAPES)
            self._answers[only_sized] = begin, found
        return found

    def reached(self, start: int, end: int) -> int | None:
        """Return the first chunk or attachment in a range if one in the range ends after ``end``.

        Then the record from ``start`` to ``end`` has lost bytes and overlaps the next records.
        """
        first = place = self.after(start, only_sized=True)
        while place is not None and place < end:
            own = inner_end(self._data, self._data[place], place + HEAD.size)
            if own is not None and own > end:
                return first
            place = self.after(place, only_sized=True)
        return None


def records(
    data: Bytes,
    position: int = len(MAGIC),
    *,
    indexes: bool = True,
    search: RecordSearch | None = None,
) -> Iterator[Found | DamagedBytes]:
    """Yield every record from ``position`` to the end of the file, including its summary.

    The iteration ends at the footer, or at the start of another file that follows in ``data``.

    Args:
        data: Content of the file.
        position: Offset of the first record.
        indexes: Also yield message indexes, which are 90 % of all records.
        search: Search that several calls share if they read parts of the same bytes. No range is
            then searched twice.

    """
    size = len(data)
    search = search or RecordSearch(data)
    while position < size and not (data[position] == MAGIC[0] and begins_file(data, position)):
        if not indexes and data[position] == Opcode.MESSAGE_INDEX:
            position = _past_indexes(data, position)
        found, following = _fits(data, position), None
        if found is None or not _may_begin(data, found.end):
            following = search.after(position)
            # Either the bytes after the record are damaged, or the record's length is wrong. A
            # record with a wrong length usually overlaps whole records.
            if found is not None and following is not None and following < found.end:
                is_sure = inner_end(data, found.opcode, found.start) == found.end
                if not is_sure or begins_file(data, following):
                    found = None
                elif (reached := search.reached(found.start, found.end)) is not None:
                    found, following = None, reached
        if found is not None:
            yield found
            position = found.end
            if found.opcode == Opcode.FOOTER:
                return
            continue
        if following is None:
            yield DamagedBytes(position, size, is_tail=True)
            return
        yield DamagedBytes(position, following, is_tail=False)
        position = following


def _past_indexes(data: Bytes, position: int) -> int:
    """Return the offset of the first record that is not a message index."""
    while True:
        # Make a copy. A numpy array on the memory map would prevent closing the map.
        position += skip_indexes(np.frombuffer(data[position : position + _WINDOW], np.uint8))
        following = _past_index(data, position)  # an index beyond the window
        if following == position:
            return position
        position = following


def _past_index(data: Bytes, position: int) -> int:
    """Return the end of a whole message index at ``position``; otherwise ``position``."""
    if position + _INDEX_HEAD.size > len(data):
        return position
    opcode, length, _, entries = _INDEX_HEAD.unpack_from(data, position)
    end: int = position + HEAD.size + length
    is_index = opcode == Opcode.MESSAGE_INDEX and length == entries + _INDEX_FIXED
    return end if is_index and entries % 16 == 0 and end <= len(data) else position


def begins_file(data: Bytes, position: int) -> bool:
    """Return True if a file starts here: magic bytes, and a header that its two texts fill."""
    start = position + len(MAGIC)
    if data[position:start] != MAGIC or start + HEAD.size > len(data):
        return False
    opcode, length = HEAD.unpack_from(data, start)
    start += HEAD.size
    end = start + length
    return opcode == Opcode.HEADER and end <= len(data) and _header(data, start, end)


def next_file(data: Bytes, position: int, end: int) -> int | None:
    """Return the offset of the next file between ``position`` and ``end``; None: no file."""
    while (position := data.find(MAGIC, position, end)) >= 0:
        if begins_file(data, position):
            return position
        position += 1
    return None


def first_end(data: Bytes) -> tuple[int, bool]:
    """Return the end of the first file in ``data``, and True if its footer exists.

    ``data`` may be several joined files. Usually it is one file whose footer is at the end of the
    data, so no search is needed.
    """
    size = len(data)
    footer = size - len(MAGIC) - HEAD.size - _FOOTER_BYTES
    if footer > len(MAGIC) and _at(data, footer) is not None and data[footer] == Opcode.FOOTER:
        start = int.from_bytes(data[footer + HEAD.size : footer + HEAD.size + 8], "little")
        before = (start or footer) - HEAD.size - _DATA_END_BYTES
        if len(MAGIC) < before < footer and data[before] == Opcode.DATA_END and _at(data, before):
            return size, True
    end, whole = len(MAGIC), False
    for found in records(data):
        end = found.end
        if isinstance(found, Found) and found.opcode == Opcode.FOOTER:
            whole = data[end : end + len(MAGIC)] == MAGIC
            end += len(MAGIC) * whole
    return end, whole


def _next(data: Bytes, position: int, kinds: Collection[int]) -> int | None:
    """Return the next offset of a record of these kinds or of a file; None: not found."""
    end = len(data)
    for match in _CANDIDATE.finditer(data, position):
        found = _fits(data, match.start())
        # Random bytes may look like a record. So require a known kind that another record follows
        # (not the file's end), or two equal sizes of 64 bits.
        if found is None or found.opcode not in kinds:
            continue
        is_sure = found.opcode in _TWICE and inner_end(data, found.opcode, found.start) == found.end
        if is_sure or (_may_begin(data, found.end) and _is_followed(data, found.end)):
            end = match.start()
            break
    file = next_file(data, position, end)
    return file if file is not None or end == len(data) else end


def _is_followed(data: Bytes, position: int) -> bool:
    """Return True if a whole record or the regular end of the file is at ``position``."""
    if data[position : position + len(MAGIC)] == MAGIC:
        return True
    if position + HEAD.size > len(data):
        return False
    opcode, length = HEAD.unpack_from(data, position)
    shape = _SHAPES.get(opcode)
    start, end = position + HEAD.size, position + HEAD.size + length
    return shape is not None and end <= len(data) and shape(data, start, end)


def _at(data: Bytes, position: int) -> Found | None:
    """Return the record at an offset, if its end is a possible start of another record."""
    found = _fits(data, position)
    return found if found is not None and _may_begin(data, found.end) else None


def _fits(data: Bytes, position: int) -> Found | None:
    """Return the record at an offset if its length fits the file and its fields fit its length."""
    size = len(data)
    if position + HEAD.size > size:
        return None
    opcode, length = HEAD.unpack_from(data, position)
    start = position + HEAD.size
    end = start + length
    if opcode == 0 or end > size:
        return None
    shape = _SHAPES.get(opcode)
    if shape is not None:
        try:
            if not shape(data, start, end):
                return None
        except struct.error:
            return None
    return Found(opcode, position, start, end)


def _may_begin(data: Bytes, position: int) -> bool:
    """Return True if the bytes may be the head of a record, or are the file's end."""
    if position + HEAD.size > len(data):
        return True
    if data[position : position + len(MAGIC)] == MAGIC:
        return True
    opcode: int
    length: int
    opcode, length = HEAD.unpack_from(data, position)
    return (0 < opcode <= LAST_KNOWN or opcode >= _FIRST_PRIVATE) and length < _LONGEST


def has_shape(data: Bytes, opcode: int, start: int, end: int) -> bool:
    """Return True if a record's fields fit its content."""
    shape = _SHAPES.get(opcode)
    try:
        return shape is None or shape(data, start, end)
    except struct.error:
        return False


def inner_end(data: Bytes, opcode: int, start: int) -> int | None:
    """Return the end of a record, computed from its own fields. Its content begins at ``start``.

    None: this kind of record has no such fields, or they exceed the file.
    """
    size = len(data)
    match opcode:
        case Opcode.CHUNK:
            end = _after(data, _after(data, start + CHUNK_HEAD.size), 8)
        case Opcode.ATTACHMENT:
            end = _after(data, _after(data, _after(data, start + 16)), 8) + 4
        case Opcode.METADATA:
            end = _after(data, _after(data, start))
        case Opcode.MESSAGE_INDEX:
            end = _after(data, start + 2)
        case Opcode.SCHEMA:
            end = _after(data, _after(data, _after(data, start + 2)))
        case Opcode.CHANNEL:
            end = _after(data, _after(data, _after(data, start + 4)))
        case _:
            return None
    return end if start < end <= size else None


# ---- fields of each record kind: newer writers may append fields but never remove fields


def _after(data: Bytes, position: int, size_bytes: int = 4) -> int:
    """Return the offset after a text or a list. It starts with its size in bytes."""
    size = int.from_bytes(data[position : position + size_bytes], "little")
    return position + size_bytes + size


def _schema(data: Bytes, start: int, end: int) -> bool:
    position = start + 2
    for _ in range(3):
        position = _after(data, position)
        if position > end:
            return False
    return True


def _channel(data: Bytes, start: int, end: int) -> bool:
    return _schema(data, start + 2, end)


def _message(_data: Bytes, start: int, end: int) -> bool:
    return end - start >= _MESSAGE_FIXED


def _chunk(data: Bytes, start: int, end: int) -> bool:
    begin = _after(data, start + CHUNK_HEAD.size)
    return begin + 8 <= end and _after(data, begin, 8) <= end


def _message_index(data: Bytes, start: int, end: int) -> bool:
    size = _after(data, start + 2) - start - 6
    return size % 16 == 0 and start + 6 + size <= end


def _attachment(data: Bytes, start: int, end: int) -> bool:
    position = _after(data, start + 16)
    if position > end:
        return False
    position = _after(data, position)
    return position <= end and _after(data, position, 8) + 4 <= end


def _metadata(data: Bytes, start: int, end: int) -> bool:
    position = _after(data, start)
    return position <= end and _after(data, position) <= end


def _header(data: Bytes, start: int, end: int) -> bool:
    position = _after(data, start)
    return position <= end and _after(data, position) == end


def _footer(data: Bytes, start: int, end: int) -> bool:
    """Return True if only the last bytes of the file follow. These bytes may be truncated."""
    return end - start >= _FOOTER_BYTES and MAGIC.startswith(data[end : end + len(MAGIC)])


def _data_end(data: Bytes, start: int, end: int) -> bool:
    """Return True if a summary record follows. Otherwise it is an index with a damaged opcode."""
    if end - start < _DATA_END_BYTES:
        return False
    return end >= len(data) or data[end] in _IN_SUMMARY or data[end] >= _FIRST_PRIVATE


def _at_least(size: int) -> Callable[[Bytes, int, int], bool]:
    return lambda _data, start, end: end - start >= size


_SHAPES: dict[int, Callable[[Bytes, int, int], bool]] = {
    Opcode.HEADER: _header,
    Opcode.FOOTER: _footer,
    Opcode.SCHEMA: _schema,
    Opcode.CHANNEL: _channel,
    Opcode.MESSAGE: _message,
    Opcode.CHUNK: _chunk,
    Opcode.MESSAGE_INDEX: _message_index,
    Opcode.CHUNK_INDEX: _at_least(56),
    Opcode.ATTACHMENT: _attachment,
    Opcode.ATTACHMENT_INDEX: _at_least(44),
    Opcode.STATISTICS: _at_least(46),
    Opcode.METADATA: _metadata,
    Opcode.METADATA_INDEX: _at_least(20),
    Opcode.SUMMARY_OFFSET: _at_least(17),
    Opcode.DATA_END: _data_end,
}

"""Walking an MCAP file record by record, past whatever is damaged.

Nothing is believed without a second look: a record must fit the file, its own fields must fit
the record, and what follows it must begin like a record, or be damage that begins where the record
ends. Where that fails, the next place that
passes is searched for, and the stretch between is given as damage. So one flipped bit in a
length costs one record, not the rest of the file.
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
"""Bytes of message indexes looked at in one go; a chunk mostly has fewer."""
_LONGEST = 1 << 40
_FIRST_PRIVATE = 0x80
_LAST_KNOWN = int(Opcode.DATA_END)
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
"""What may follow the end of the data."""
_TWICE = frozenset({int(Opcode.CHUNK), int(Opcode.ATTACHMENT)})
"""Records that have the length of their content twice, in their head and before their data."""
_CANDIDATE = re.compile(rb"(?=[\x02-\x0f].{5}\x00\x00\x00)", re.DOTALL)
"""An opcode of the specification, and a length below 2⁴⁰."""


class Found(NamedTuple):
    """One record: where it begins, and where its content lies."""

    opcode: int
    offset: int
    start: int
    end: int


class DamagedBytes(NamedTuple):
    """Bytes that are no record."""

    offset: int
    end: int
    is_tail: bool
    """Nothing follows: the file was cut here, or all the rest is damaged."""


@contextmanager
def opened(path: Path) -> Iterator[Bytes]:
    """The bytes of an MCAP file, not read before they are looked at.

    Raises:
        LogReadError: it is missing, cannot be read, or does not begin as an MCAP file.

    """
    try:
        with open_to_read(path) as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise LogReadError(path, "it is not an MCAP file")
            with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                yield data
    except OSError as error:
        raise LogReadError(path, error.strerror or str(error)) from None


class Search:
    """Searches for the next place where a record stands, and remembers the answer.

    It holds for every place up to the one found. Without it a file of records that each begin a
    search would be read to its end for each of them.
    """

    def __init__(self, data: Bytes) -> None:
        """Search these bytes."""
        self._data = data
        self._answers: dict[bool, tuple[int, int | None]] = {False: (0, -1), True: (0, -1)}
        """By whether only sized records count: where the search began, and what it found."""

    def after(self, position: int, *, only_sized: bool = False) -> int | None:
        """Find the first place after this one; None: there is none.

        Args:
            position: byte after which to search.
            only_sized: find only chunks and attachments, which never stand within a chunk.

        """
        begin = position + 1
        first, found = self._answers[only_sized]
        if begin < first or (found is not None and begin > found):
            found = _next(self._data, begin, _TWICE if only_sized else _SHAPES)
            self._answers[only_sized] = begin, found
        return found

    def reached(self, start: int, end: int) -> int | None:
        """Find the first chunk or attachment between two bytes, if one of them ends behind ``end``.

        A record from ``start`` to ``end`` has then lost bytes: it reaches into what follows.
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
    search: Search | None = None,
) -> Iterator[Found | DamagedBytes]:
    """Every record from ``position`` to the end of the file, its summary included.

    The footer ends it, and so does the beginning of another file that was joined to this one.
    Without ``indexes`` those of messages are passed over: they are nine of ten records. Who walks
    the same bytes in several parts gives a ``search``, so that none is searched twice.
    """
    size = len(data)
    search = search or Search(data)
    while position < size and not (data[position] == MAGIC[0] and begins_file(data, position)):
        if not indexes and data[position] == Opcode.MESSAGE_INDEX:
            position = _past_indexes(data, position)
        found, following = _fits(data, position), None
        if found is None or not _may_begin(data, found.end):
            following = search.after(position)
            # What stands behind it is damaged, or its length is, which then mostly reaches into
            # or over whole records.
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
    """Where the first record stands that is no message index."""
    while True:
        # A copy: an array on the map itself would keep it from being closed.
        position += skip_indexes(np.frombuffer(data[position : position + _WINDOW], np.uint8))
        following = _past_index(data, position)  # one that does not end within the window
        if following == position:
            return position
        position = following


def _past_index(data: Bytes, position: int) -> int:
    """Where a message index ends, if one stands here whole."""
    if position + _INDEX_HEAD.size > len(data):
        return position
    opcode, length, _, entries = _INDEX_HEAD.unpack_from(data, position)
    end: int = position + HEAD.size + length
    is_index = opcode == Opcode.MESSAGE_INDEX and length == entries + _INDEX_FIXED
    return end if is_index and entries % 16 == 0 and end <= len(data) else position


def begins_file(data: Bytes, position: int) -> bool:
    """Whether a file begins here: the magic bytes, and a header whose two texts fill it."""
    start = position + len(MAGIC)
    if data[position:start] != MAGIC or start + HEAD.size > len(data):
        return False
    opcode, length = HEAD.unpack_from(data, start)
    start += HEAD.size
    end = start + length
    return opcode == Opcode.HEADER and end <= len(data) and _header(data, start, end)


def next_file(data: Bytes, position: int, end: int) -> int | None:
    """Where the next file begins, from ``position`` on; None where none does before ``end``."""
    while (position := data.find(MAGIC, position, end)) >= 0:
        if begins_file(data, position):
            return position
        position += 1
    return None


def first_end(data: Bytes) -> tuple[int, bool]:
    """Where the first of the files that were joined ends, and whether its end is there.

    Mostly the last footer is its own: then nothing is searched.
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
    """The next place from here where a record of these kinds stands, or a file begins."""
    end = len(data)
    for match in _CANDIDATE.finditer(data, position):
        found = _fits(data, match.start())
        # Here chance could have a hand in it: it must be of a known kind, and followed by
        # another record, not by the file's end; or have two sizes of 64 bits that agree.
        if found is None or found.opcode not in kinds:
            continue
        is_sure = found.opcode in _TWICE and inner_end(data, found.opcode, found.start) == found.end
        if is_sure or (_may_begin(data, found.end) and _is_followed(data, found.end)):
            end = match.start()
            break
    file = next_file(data, position, end)
    return file if file is not None or end == len(data) else end


def _is_followed(data: Bytes, position: int) -> bool:
    """Whether another record stands there whole, or the file ends as it should."""
    if data[position : position + len(MAGIC)] == MAGIC:
        return True
    if position + HEAD.size > len(data):
        return False
    opcode, length = HEAD.unpack_from(data, position)
    shape = _SHAPES.get(opcode)
    start, end = position + HEAD.size, position + HEAD.size + length
    return shape is not None and end <= len(data) and shape(data, start, end)


def _at(data: Bytes, position: int) -> Found | None:
    """The record at a place, if there is one and another may follow it."""
    found = _fits(data, position)
    return found if found is not None and _may_begin(data, found.end) else None


def _fits(data: Bytes, position: int) -> Found | None:
    """The record at a place, if its length fits the file, and its fields fit its length."""
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
    """Whether what stands at a place could be the head of a record, or is the file's end."""
    if position + HEAD.size > len(data):
        return True
    if data[position : position + len(MAGIC)] == MAGIC:
        return True
    opcode: int
    length: int
    opcode, length = HEAD.unpack_from(data, position)
    return (0 < opcode <= _LAST_KNOWN or opcode >= _FIRST_PRIVATE) and length < _LONGEST


def has_shape(data: Bytes, opcode: int, start: int, end: int) -> bool:
    """Whether a record's own fields fit its content."""
    shape = _SHAPES.get(opcode)
    try:
        return shape is None or shape(data, start, end)
    except struct.error:
        return False


def inner_end(data: Bytes, opcode: int, start: int) -> int | None:
    """Where a record ends by its own fields; ``start`` is where its content begins.

    None: it is of a kind that does not say, or the fields reach beyond the file.
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


# ---- what the content of each kind looks like: newer writers may append fields, never remove


def _after(data: Bytes, position: int, size_bytes: int = 4) -> int:
    """Where what follows a text or a list begins; its size comes first."""
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
    """Nothing follows it but the file's last bytes, as far as they are there."""
    return end - start >= _FOOTER_BYTES and MAGIC.startswith(data[end : end + len(MAGIC)])


def _data_end(data: Bytes, start: int, end: int) -> bool:
    """What follows belongs to the summary: an index whose opcode is damaged ends no data."""
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

"""Arrow columns as a CSV file: lists as JSON, bytes in hexadecimal, for CSV has neither.

Arrow's own writer makes a text column of each column and puts those together, which takes four
times as long as to write each row at once (see ``csv_kernel``).
"""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa

from bridge.record import csv_kernel as kernel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Ints = NDArray[np.int64]

_OUT_BYTES = 1 << 20
"""Written at a time: it stays in the processor's cache."""
_VALUES = 1 << 18
"""Of lists, taken at a time."""


class _Text(NamedTuple):
    """Texts or bytes on end, and where each begins (and the last one ends)."""

    data: Bytes
    places: Ints


class CsvTable:
    """One file."""

    def __init__(self, path: Path, columns: Mapping[str, pa.DataType]) -> None:
        """Create it, with a line of the columns' names.

        Raises:
            OSError: it cannot be.

        """
        head = io.StringIO()
        csv.writer(head, lineterminator="\n").writerow(columns)
        self._file = path.open("wb", buffering=0)
        self._file.write(head.getvalue().encode())
        self._kinds = np.array([_kind(column) for column in columns.values()])
        self._out = np.empty(_OUT_BYTES, np.uint8)

    def write(self, columns: Sequence[pa.Array]) -> None:
        """Write rows.

        Raises:
            OSError: the disk is full.

        """
        count, rows = len(columns), len(columns[0])
        kinds = self._kinds.copy()
        bits, known = np.empty((count, rows), np.int64), np.ones((count, rows), np.uint8)
        texts: list[_Text] = []
        bounds = np.full(rows, kernel.WIDEST * count, np.int64)
        size = places = 0
        for index, column in enumerate(columns):
            if column.null_count:
                known[index] = _flags(column, column.buffers()[0])
            if kinds[index] < kernel.TEXT:
                bits[index] = _numbers(column)
                continue
            if pa.types.is_list(column.type):
                kinds[index], text = _lists(column)
            else:
                text = _texts(column)
            lengths = np.diff(text.places)
            bounds += 2 * lengths
            bits[index] = np.arange(places, places + rows)
            texts.append(_Text(text.data, text.places + size))
            size, places = size + len(text.data), places + rows + 1
        data = np.concatenate([np.empty(0, np.uint8), *(text.data for text in texts)])
        offsets = np.concatenate([np.empty(0, np.int64), *(text.places for text in texts)])
        before = np.zeros((4, count), np.int64)
        ends = np.cumsum(bounds)
        first, done = 0, 0
        while first < rows:
            last = max(int(np.searchsorted(ends, done + _OUT_BYTES, "right")), first + 1)
            self._out = _roomy(self._out, int(ends[last - 1]) - done)
            before[2] = 0  # what they say stood in the bytes before
            written = kernel.put_rows(
                kinds, bits, known, data, offsets, first, last, before, self._out
            )
            self._file.write(self._out[:written].data)
            first, done = last, int(ends[last - 1])

    def close(self) -> None:
        """End the file."""
        self._file.close()


def _roomy(out: Bytes, size: int) -> Bytes:
    return out if len(out) >= size else np.empty(size, np.uint8)


_KINDS = {
    pa.bool_(): kernel.BOOLEAN,
    pa.float64(): kernel.DOUBLE,
    pa.float32(): kernel.SINGLE,
    pa.uint64(): kernel.UNSIGNED,
    pa.binary(): kernel.HEX,
}


def _kind(kind: pa.DataType) -> int:
    """How a column's cells are written; lists as texts, for by then they are JSON."""
    known = _KINDS.get(kind)
    if known is not None:
        return known
    if pa.types.is_timestamp(kind):
        return kernel.TIME
    return kernel.INTEGER if pa.types.is_integer(kind) else kernel.TEXT


def _flags(array: pa.Array, bitmap: pa.Buffer) -> Bytes:
    """Bits, one a row, as bytes."""
    begin, end = array.offset, array.offset + len(array)
    bits = np.frombuffer(bitmap, np.uint8)[begin // 8 : (end + 7) // 8]
    return np.unpackbits(bits, bitorder="little")[begin % 8 :][: len(array)]


def _numbers(array: pa.Array) -> NDArray[Any]:
    """Numbers as integers of 64 bits or of what they have: floats as the bits that they are."""
    kind, values = array.type, array.buffers()[1]
    if pa.types.is_boolean(kind):
        return _flags(array, values)
    if pa.types.is_timestamp(kind) or kind in {pa.float64(), pa.uint64()}:
        dtype: np.dtype[Any] = np.dtype(np.int64)
    else:
        dtype = np.dtype(np.int32 if kind == pa.float32() else kind.to_pandas_dtype())
    found: NDArray[Any] = np.frombuffer(values, dtype, len(array), array.offset * dtype.itemsize)
    return found


def _offsets(array: pa.Array) -> Ints:
    """Where each text or list begins, and the last one ends."""
    found = np.frombuffer(array.buffers()[1], np.int32, len(array) + 1, array.offset * 4)
    return found.astype(np.int64)


def _texts(array: pa.Array) -> _Text:
    places = _offsets(array)
    held = array.buffers()[2]
    data = np.frombuffer(held, np.uint8) if held is not None and held.size else _none()
    return _Text(data[places[0] : places[-1]], places - places[0])


def _none() -> Bytes:
    return np.empty(0, np.uint8)


def _lists(lists: pa.ListArray) -> tuple[int, _Text]:
    """Each list as a JSON text, and how that is written."""
    places, values = _offsets(lists), lists.values
    if _kind(values.type) >= kernel.TEXT:
        return kernel.TEXT, _texts(_as_json(lists))
    numbers, kind = _numbers(values), _kind(values.type)
    parts, ends = [], np.zeros(len(lists) + 1, np.int64)
    first, done = 0, 0
    while first < len(lists):
        last = max(int(np.searchsorted(places, places[first] + _VALUES, "right")) - 1, first + 1)
        bits = numbers[places[first] : places[last]].astype(np.int64)
        rows = last - first
        out = np.empty(kernel.WIDEST * len(bits) + 4 * rows, np.uint8)
        offsets, own = places[first : last + 1] - places[first], np.empty(rows + 1, np.int64)
        size = kernel.put_lists(kind, bits, offsets, own, out)
        parts.append(out[:size].copy())
        ends[first + 1 : last + 1] = own[1:] + done
        first, done = last, done + size
    return kernel.READY, _Text(np.concatenate([_none(), *parts]), ends)


def _as_json(lists: pa.ListArray) -> pa.Array:
    """Lists of texts; the same one in every row, mostly."""
    if len(lists) > 1 and lists.null_count == 0 and lists[1:].equals(lists[:-1]):
        return pa.repeat(pa.scalar(json.dumps(lists[0].as_py())), len(lists))
    made: dict[tuple[Any, ...], str] = {}
    texts = []
    for value in lists.to_pylist():
        key = tuple(value or ())
        if key not in made:
            made[key] = json.dumps(value or [])
        texts.append(made[key])
    return pa.array(texts, pa.string())

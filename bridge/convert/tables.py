"""Tables of one topic's messages in Arrow format, and their files."""

from __future__ import annotations

import errno
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet

from bridge.convert.csv_table import CsvTable
from bridge.record.decode.blocks import LOG_NS, MESSAGE_HEAD, PUBLISH_NS, SEQUENCE
from bridge.record.decode.forms import unzigzag, varints
from bridge.record.names import is_utf8
from bridge.record.records_kernel import split_messages

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from numpy.typing import NDArray

    from bridge.record.decode.blocks import Block
    from bridge.record.decode.forms import Column, Form, Leaf, Template

_MAX_SHAPES = 64
"""Maximum number of message shapes per block. Messages of further shapes are decoded one by one."""
_FEW = 3
"""Maximum number of equal messages that are decoded one by one."""
_LONG = 2048
"""Minimum length of a message for which a template always saves time, bytes."""
_ALIGNED = 64
"""Alignment of an Arrow column, bytes."""
_HEADS = (LOG_NS, PUBLISH_NS, SEQUENCE)
_TIME = pa.timestamp("ns", "UTC")
_PLAIN = {"text": pa.string(), "json": pa.string(), "bytes": pa.binary(), "bool": pa.bool_()}


def arrow_type(column: Column) -> pa.DataType:
    """Return a column's type in the table."""
    return _arrow_type(column.type, column.is_list)


@cache
def _arrow_type(name: str, is_list: bool) -> pa.DataType:  # noqa: FBT001 - a property of the column
    plain = _PLAIN.get(name)
    made = pa.from_numpy_dtype(np.dtype(name)) if plain is None else plain
    return pa.list_(made) if is_list else made


class TableWriter:
    """Writer of one topic's file: CSV for the suffix ``.csv``, otherwise Parquet."""

    def __init__(self, path: Path, columns: Iterable[Column], notes: dict[str, str]) -> None:
        """Create the file.

        Raises:
            OSError: the file cannot be created.

        """
        self._columns = tuple(columns)
        self._shapes: dict[Form, dict[int, Template]] = {}
        """Newest template of each form, by message length."""
        fields = [
            *(("log_time", _TIME), ("publish_time", _TIME), ("sequence", pa.uint32())),
            *((column.name, arrow_type(column)) for column in self._columns),
        ]
        self._schema = pa.schema(fields, metadata={f"sweepctl.{k}": v for k, v in notes.items()})
        self._csv: CsvTable | None = None
        if path.suffix == ".csv":
            self._csv = CsvTable(path, dict(fields))
        else:
            if not is_utf8(path):
                raise OSError(errno.EILSEQ, "Parquet needs a name in UTF-8; CSV does not")
            # For measured values, dictionaries take twice the time and more space. Statistics of
            # lists do not help to find a row.
            self._parquet = pa_parquet.ParquetWriter(
                str(path),
                self._schema,
                compression="zstd",
                use_dictionary=False,
                write_statistics=[n for n, kind in fields if not pa.types.is_list(kind)],
            )

    def write(self, block: Block, channels: Iterable[tuple[int, Form]]) -> int:
        """Write these channels' messages of a block; return the number of undecodable messages."""
        return sum(self._write(block, channel_id, form) for channel_id, form in channels)

    def _write(self, block: Block, channel_id: int, form: Form) -> int:
        starts = block.starts[channel_id]
        data = np.frombuffer(block.data, np.uint8)
        _, heads = _split(data, starts, np.empty(0, np.uint8), np.empty(0, np.uint8), _HEADS)
        log_ns, publish_ns, sequence = (values.reshape(-1) for values in heads)
        values, bad = _decode(
            block.data,
            starts,
            block.lengths[channel_id],
            form,
            self._shapes.setdefault(form, {}),
        )
        named = dict(zip((c.name for c in form.columns), values, strict=True))
        arrays = [
            _as(arrow_type(c), named[c.name])
            if c.name in named
            else pa.nulls(len(starts), arrow_type(c))
            for c in self._columns
        ]
        rows = [_times(log_ns), _times(publish_ns), pa.array(sequence.view("<u4")), *arrays]
        if self._csv is not None:
            self._csv.write(rows)
        else:
            self._parquet.write_table(pa.table(rows, schema=self._schema))
        return bad

    def close(self) -> None:
        """Complete and close the file."""
        (self._csv or self._parquet).close()


def _times(values: NDArray[np.uint8]) -> pa.Array:
    return pa.Array.from_buffers(_TIME, len(values) // 8, [None, pa.py_buffer(values)])


def _as(kind: pa.DataType, array: pa.Array) -> pa.Array:
    """Convert to a type. A topic's schemas may differ; values that do not fit become null."""
    if array.type == kind:
        return array
    try:
        return array.cast(kind)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return pa.nulls(len(array), kind)


def _decode(
    data: bytes,
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    form: Form,
    known: dict[int, Template],
) -> tuple[list[pa.Array], int]:
    """Return an array per column, in message order, and the number of undecodable messages."""
    parts: list[tuple[NDArray[np.int64], list[pa.Array]]] = []
    single: list[NDArray[np.int64]] = []
    used: dict[int, Template] = {}
    shapes = 0
    content = np.frombuffer(data, np.uint8)
    for length in np.unique(lengths).tolist():
        places = np.flatnonzero(lengths == length)
        while len(places):
            first = int(starts[places[0]]) + MESSAGE_HEAD
            few = shapes >= max(_MAX_SHAPES, len(starts) // 8)
            few = few or (len(places) <= _FEW and length < _LONG)
            template = known.pop(length, None)
            if template is None and length and not few:
                template = form.template(data[first : first + length])
            if template is None:
                # If a message gives no template, the next message may still give a template.
                single.append(places if few else places[:1])
                places = places[:0] if few else places[1:]
                shapes += not few
                continue
            fit, arrays = _of_shape(content, starts[places], template, form)
            if not fit.any():
                continue  # an old template that no longer fits
            shapes += 1
            parts.append((places[fit], arrays))
            places, used[length] = places[~fit], template
    known.update(used)
    bad = 0
    if single:
        own = np.sort(np.concatenate(single))
        arrays, bad = _one_by_one(data, starts[own], lengths[own], form)
        parts.append((own, arrays))
    if len(parts) == 1:
        return parts[0][1], bad
    order = pa.array(np.argsort(np.concatenate([own for own, _ in parts]), kind="stable"))
    joined = [
        pa.concat_arrays(arrays).take(order) for arrays in zip(*(a for _, a in parts), strict=True)
    ]
    return joined, bad


def _of_shape(
    data: NDArray[np.uint8], starts: NDArray[np.int64], template: Template, form: Form
) -> tuple[NDArray[np.bool_], list[pa.Array]]:
    """Return a mask of the messages that fit a template, and their columns."""
    leaves = [template.leaves.get(column.name) for column in form.columns]
    moving = [leaf for leaf in leaves if leaf is not None and leaf.how != "same"]
    places = tuple((MESSAGE_HEAD + leaf.offset, leaf.size) for leaf in moving)
    fit, values = _split(data, starts, template.head, template.mask, places)
    of_leaf = dict(zip((leaf.column.name for leaf in moving), values, strict=True))
    count = int(np.count_nonzero(fit))
    return fit, [
        _column(column, leaf, of_leaf.get(column.name), count)
        for column, leaf in zip(form.columns, leaves, strict=True)
    ]


def _split(
    data: NDArray[np.uint8],
    starts: NDArray[np.int64],
    shape: NDArray[np.uint8],
    mask: NDArray[np.uint8],
    places: tuple[tuple[int, int], ...],
) -> tuple[NDArray[np.bool_], list[NDArray[np.uint8]]]:
    """Return a mask of the messages with a shape, and their bytes at these offsets and sizes."""
    values = np.zeros((len(places), 3), np.int64)
    size_bytes = 0
    for row, (offset, size) in enumerate(places):
        values[row] = offset, size, size_bytes
        size_bytes += -(-size * len(starts) // _ALIGNED) * _ALIGNED
    out, fits = np.empty(size_bytes, np.uint8), np.empty(len(starts), np.uint8)
    count = split_messages(data, starts, MESSAGE_HEAD, shape, mask, values, out, fits)
    cut = [out[begin : begin + count * size] for _, size, begin in values.tolist()]
    return fits.view(np.bool_), cut


def _column(
    column: Column, leaf: Leaf | None, values: NDArray[np.uint8] | None, count: int
) -> pa.Array:
    kind = arrow_type(column)
    if leaf is None or values is None:
        value = leaf.value if leaf is not None else [] if column.is_list else None
        return pa.repeat(pa.scalar(value, kind), count)
    if leaf.how != "fixed":
        return _integers(column, leaf, values.reshape(count, leaf.size))
    if column.type in {"text", "json", "bytes"}:
        return _texts(kind, values, leaf.size, count)
    flat = values != 0 if column.type == "bool" else values.view(column.type)
    array = pa.array(flat)
    if not column.is_list:
        return array
    size = len(array) // count
    offsets = pa.array(np.arange(count + 1, dtype=np.int32) * size)
    return pa.ListArray.from_arrays(offsets, array)


def _integers(column: Column, leaf: Leaf, values: NDArray[np.uint8]) -> pa.Array:
    raw = varints(values)
    if column.type == "bool":
        return pa.array(raw != 0)
    if leaf.how == "zigzag":
        return pa.array(unzigzag(raw).astype(column.type))
    return pa.array(raw.astype(column.type))  # truncated to its width, as protobuf does


def _texts(kind: pa.DataType, values: NDArray[np.uint8], size: int, count: int) -> pa.Array:
    data = values.tobytes()
    if kind == pa.string():
        try:
            data.decode()
        except UnicodeDecodeError:
            rows = (data[i : i + size] for i in range(0, len(data), size or 1))
            return pa.array([row.decode("utf-8", "replace") for row in rows], kind)
    offsets = np.arange(count + 1, dtype=np.int32) * size
    buffers = [None, pa.py_buffer(offsets.tobytes()), pa.py_buffer(data)]
    return pa.Array.from_buffers(kind, count, buffers)


def _one_by_one(
    data: bytes, starts: NDArray[np.int64], lengths: NDArray[np.int64], form: Form
) -> tuple[list[pa.Array], int]:
    rows, bad = [], 0
    for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
        try:
            begin = start + MESSAGE_HEAD
            rows.append(form.row(data[begin : begin + length]))
        except ValueError:
            rows.append({})
            bad += 1
    arrays = []
    for column in form.columns:
        values: list[Any] = [row.get(column.name, [] if column.is_list else None) for row in rows]
        arrays.append(pa.array(values, arrow_type(column)))
    return arrays, bad

"""Messages of one topic as an Arrow table, and that into a file."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from bridge.record.forms import unzigzag, varints

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from numpy.typing import NDArray

    from bridge.record.blocks import Block
    from bridge.record.forms import Column, Form, Leaf, Template

_MOST_SHAPES = 64
"""In one block; what has more is read a message at a time, where that is no slower."""
_FEW = 3
"""Messages of one shape that are not worth a template, unless they are"""
_LONG = 2048
"""bytes long."""
_TIME = pa.timestamp("ns", "UTC")
_PLAIN = {"text": pa.string(), "json": pa.string(), "bytes": pa.binary(), "bool": pa.bool_()}


def arrow_type(column: Column) -> pa.DataType:
    """A column's type in the table."""
    plain = _PLAIN.get(column.type)
    made = pa.from_numpy_dtype(np.dtype(column.type)) if plain is None else plain
    return pa.list_(made) if column.is_list else made


class TableWriter:
    """One topic's file; CSV where its name says so, else Parquet."""

    def __init__(self, path: Path, columns: Iterable[Column], notes: dict[str, str]) -> None:
        """Create the file.

        Raises:
            OSError: it cannot be.

        """
        self._columns = tuple(columns)
        fields = [
            *(("log_time", _TIME), ("publish_time", _TIME), ("sequence", pa.uint32())),
            *((column.name, arrow_type(column)) for column in self._columns),
        ]
        self._schema = pa.schema(fields, metadata={f"sweepctl.{k}": v for k, v in notes.items()})
        self._csv: pa_csv.CSVWriter | None = None
        if path.suffix == ".csv":
            texts = [(name, _in_csv(kind)) for name, kind in fields]
            self._csv = pa_csv.CSVWriter(str(path), pa.schema(texts))
        else:
            # Dictionaries would take twice the time and, of measured values, more room.
            self._parquet = pa_parquet.ParquetWriter(
                str(path), self._schema, compression="zstd", use_dictionary=False
            )

    def write(self, block: Block, channels: Iterable[tuple[int, Form]]) -> int:
        """Write some channels' messages of a block; how many of them did not decode."""
        return sum(self._write(block, channel_id, form) for channel_id, form in channels)

    def _write(self, block: Block, channel_id: int, form: Form) -> int:
        starts, lengths, heads = block.heads(channel_id)
        values, bad = _decode(block.data, starts, lengths, form)
        times = [
            pa.array(np.ascontiguousarray(heads[name]).view("<i8"), pa.int64()).cast(_TIME)
            for name in ("log_ns", "publish_ns")
        ]
        sequence = pa.array(np.ascontiguousarray(heads["sequence"]))
        named = dict(zip((c.name for c in form.columns), values, strict=True))
        arrays = [
            named.get(c.name, pa.nulls(len(starts), arrow_type(c))).cast(arrow_type(c))
            for c in self._columns
        ]
        table = pa.table([*times, sequence, *arrays], schema=self._schema)
        if self._csv is not None:
            self._csv.write_table(_for_csv(table))
        else:
            self._parquet.write_table(table)
        return bad

    def close(self) -> None:
        """End the file."""
        (self._csv or self._parquet).close()


def _decode(
    data: bytes, starts: NDArray[np.int64], lengths: NDArray[np.int64], form: Form
) -> tuple[list[pa.Array], int]:
    """An array for each column, in the messages' order; and how many did not decode."""
    parts: list[tuple[NDArray[np.int64], list[pa.Array]]] = []
    single: list[NDArray[np.int64]] = []
    shapes = 0
    for length in np.unique(lengths).tolist():
        places = np.flatnonzero(lengths == length)
        while len(places):
            first = int(starts[places[0]])
            few = shapes >= max(_MOST_SHAPES, len(starts) // 8)
            few = few or (len(places) <= _FEW and length < _LONG)
            template = None if few or not length else form.template(data[first : first + length])
            if template is None:
                # One message without a shape says nothing of the next.
                single.append(places if few else places[:1])
                places = places[:0] if few else places[1:]
                shapes += not few
                continue
            shapes += 1
            rows = _gather(data, starts[places], length)
            fit = template.fits(rows)
            whole = bool(fit.all())
            own, of_shape = (places, rows) if whole else (places[fit], rows[fit])
            parts.append((own, [_column(column, template, of_shape) for column in form.columns]))
            places = places[:0] if whole else places[~fit]
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


def _gather(data: bytes, starts: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    # One overlapping item of `length` bytes at each byte: numpy then copies whole messages.
    items = np.ndarray((len(data) - length + 1,), f"V{length}", data, 0, (1,))
    return items[starts].view(np.uint8).reshape(-1, length)


def _column(column: Column, template: Template, rows: NDArray[np.uint8]) -> pa.Array:
    leaf = template.leaves.get(column.name)
    kind, count = arrow_type(column), len(rows)
    if leaf is None or leaf.how == "same":
        value = leaf.value if leaf is not None else [] if column.is_list else None
        return pa.repeat(pa.scalar(value, kind), count)
    values = np.ascontiguousarray(rows[:, leaf.offset : leaf.offset + leaf.size])
    if leaf.how != "fixed":
        return _integers(column, leaf, values)
    if column.type in {"text", "json", "bytes"}:
        return _texts(kind, values, leaf.size)
    flat = values.ravel() != 0 if column.type == "bool" else values.reshape(-1).view(column.type)
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
    return pa.array(raw.astype(column.type))  # cut to its width, as protobuf does


def _texts(kind: pa.DataType, values: NDArray[np.uint8], size: int) -> pa.Array:
    data = values.tobytes()
    if kind == pa.string():
        try:
            data.decode()
        except UnicodeDecodeError:
            rows = (data[i : i + size] for i in range(0, len(data), size or 1))
            return pa.array([row.decode("utf-8", "replace") for row in rows], kind)
    offsets = np.arange(len(values) + 1, dtype=np.int32) * size
    buffers = [None, pa.py_buffer(offsets.tobytes()), pa.py_buffer(data)]
    return pa.Array.from_buffers(kind, len(values), buffers)


def _one_by_one(
    data: bytes, starts: NDArray[np.int64], lengths: NDArray[np.int64], form: Form
) -> tuple[list[pa.Array], int]:
    rows, bad = [], 0
    for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
        try:
            rows.append(form.row(data[start : start + length]))
        except ValueError:
            rows.append({})
            bad += 1
    arrays = []
    for column in form.columns:
        values: list[Any] = [row.get(column.name, [] if column.is_list else None) for row in rows]
        arrays.append(pa.array(values, arrow_type(column)))
    return arrays, bad


def _in_csv(kind: pa.DataType) -> pa.DataType:
    return pa.string() if pa.types.is_list(kind) or pa.types.is_binary(kind) else kind


def _for_csv(table: pa.Table) -> pa.Table:
    """Lists as JSON, bytes in hexadecimal: CSV has neither."""
    for index, field in enumerate(table.schema):
        column = table[index]
        if pa.types.is_list(field.type):
            column = pa.chunked_array([_json(chunk) for chunk in column.chunks], pa.string())
        elif pa.types.is_binary(field.type):
            texts = [None if v is None else v.hex() for v in column.to_pylist()]
            column = pa.array(texts, pa.string())
        else:
            continue
        table = table.set_column(index, field.name, column)
    return table


def _json(lists: pa.ListArray) -> pa.Array:
    """Each list as a JSON text."""
    if not pa.types.is_primitive(lists.type.value_type) or pa.types.is_boolean(
        lists.type.value_type
    ):
        known: dict[str, str] = {}
        keys = (None if v is None else json.dumps(v) for v in lists.to_pylist())
        return pa.array([key and known.setdefault(key, key) for key in keys], pa.string())
    values, texts = lists.values, lists.values.cast(pa.string())
    if pa.types.is_floating(values.type):  # JSON has neither NaN nor infinity
        texts = pc.if_else(pc.is_finite(values), texts, "null")
    words = pa.ListArray.from_arrays(lists.offsets, texts)
    joined = pc.binary_join(words, ",")
    return pc.binary_join_element_wise("[", joined, "]", "")

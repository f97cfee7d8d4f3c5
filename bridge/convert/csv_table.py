"""CSV files from Arrow columns: lists as JSON, bytes in hexadecimal."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pyarrow as pa
from pyarrow import csv

from bridge.files import check_target

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


class CsvTable:
    """Writer of one CSV file."""

    def __init__(self, path: Path, columns: Mapping[str, pa.DataType]) -> None:
        """Create the file and write the header line.

        Raises:
            OSError: the file cannot be created.

        """
        fields = [(name, pa.string() if _is_text(kind) else kind) for name, kind in columns.items()]
        self._schema = pa.schema(fields)
        check_target(path)
        self._file = path.open("wb")
        self._writer = csv.CSVWriter(self._file, self._schema)

    def write(self, columns: Sequence[pa.Array]) -> None:
        """Write rows.

        Raises:
            OSError: the disk is full.

        """
        self._writer.write_table(pa.table([_cells(c) for c in columns], schema=self._schema))

    def close(self) -> None:
        """Complete and close the file."""
        self._writer.close()
        self._file.close()


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_list(kind) or pa.types.is_binary(kind))


def _cells(column: pa.Array) -> pa.Array:
    """Convert a column to a type that CSV supports."""
    if pa.types.is_binary(column.type):
        return pa.array([None if v is None else v.hex() for v in column.to_pylist()], pa.string())
    if pa.types.is_list(column.type):
        return _as_json(column)
    return column


def _as_json(lists: pa.ListArray) -> pa.Array:
    """Convert lists to JSON texts. JSON has no infinite numbers, so they become null."""
    known = lists.drop_null()
    if len(known) == len(lists) > 1 and lists[1:].equals(lists[:-1]):  # usually joint names
        return pa.repeat(pa.scalar(_json(lists[0].as_py())), len(lists))
    texts = [None if value is None else _json(value) for value in lists.to_pylist()]
    return pa.array(texts, pa.string())


def _json(values: list[Any]) -> str:
    if values and isinstance(values[0], float):
        values = [v if v is not None and v - v == 0.0 else None for v in values]
    return json.dumps(values)

"""Rows of exported tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:
    from pathlib import Path


def table(path: Path) -> list[dict[str, Any]]:
    """A table's rows."""
    read = pq.read_table(path)
    for name in ("log_time", "publish_time"):
        assert read.schema.field(name).type == pa.timestamp("ns", "UTC")
        index = read.schema.get_field_index(name)
        read = read.set_column(index, name, read[name].cast(pa.int64()))
    rows: list[dict[str, Any]] = read.to_pylist()
    return rows

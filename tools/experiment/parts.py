"""Results of an experiment as a Parquet dataset, in parts that are written during the runs."""

from __future__ import annotations

import importlib.util
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    Row = dict[str, Any]

FOLDER = "dataset"
"""Folder of the parts, in the experiment's folder."""
PART_ROWS = 1000
"""Number of results in a part."""
DETAIL = "detail"
"""Column with curves, paths and other structured values, as JSON text."""
_WHOLE = frozenset({"seed", "turns", "collisions"})
"""Columns of whole numbers. Other numbers are floating point."""


class Parts:
    """The dataset of one experiment. Without pyarrow nothing is written."""

    def __init__(self, folder: Path, rows: Mapping[str, Row]) -> None:
        """Open the dataset, and find the results (by key) that it does not contain."""
        self._folder = folder / FOLDER
        self._pending: list[Row] = []
        self._number = 0
        self._usable = importlib.util.find_spec("pyarrow") is not None
        if not self._usable:
            return
        written: set[str] = set()
        for path in sorted(self._folder.glob("part-*.parquet")):
            keys = _keys(path)
            if keys is None or not keys <= rows.keys():  # damaged, or its results were discarded
                path.unlink()
                continue
            written |= keys
            self._number = int(path.stem.removeprefix("part-")) + 1
        self._pending = [row for key, row in rows.items() if key not in written]

    def add(self, row: Row) -> None:
        """Add a result; write a part when it is full."""
        if self._usable:
            self._pending.append(row)
            if len(self._pending) >= PART_ROWS:
                self.seal()

    def seal(self) -> None:
        """Write the results that are in no part yet."""
        if not self._pending:
            return
        import pyarrow.parquet as pq

        self._folder.mkdir(exist_ok=True)
        path = self._folder / f"part-{self._number:05d}.parquet"
        unfinished = path.with_name(f"_{path.name}")  # readers of a dataset ignore this name
        pq.write_table(_table(self._pending), unfinished, compression="zstd")
        unfinished.replace(path)
        self._number += 1
        self._pending = []


def _keys(path: Path) -> set[str] | None:
    """Return the keys of the results in a part; None if it is damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return set(pq.read_table(path, columns=["key"]).column("key").to_pylist())
    except (pa.ArrowInvalid, KeyError):
        return None


def _table(rows: list[Row]) -> Any:  # noqa: ANN401 - pyarrow has no types
    """Return results as a table: a column for each plain value, and a JSON column for the rest."""
    import pyarrow as pa

    plain = (str, int, float, bool, type(None))
    names = dict.fromkeys(
        name for row in rows for name, value in row.items() if isinstance(value, plain)
    )
    columns = {name: _column([row.get(name) for row in rows], name) for name in names}
    details = [
        json.dumps({name: value for name, value in row.items() if not isinstance(value, plain)})
        for row in rows
    ]
    return pa.table({**columns, DETAIL: details})


def _column(values: list[Any], name: str) -> Any:  # noqa: ANN401 - pyarrow has no types
    import pyarrow as pa

    known = [value for value in values if value is not None]
    if known and all(isinstance(value, bool) for value in known):
        return pa.array(values, pa.bool_())
    if any(isinstance(value, str) for value in known):
        return pa.array([None if v is None else str(v) for v in values], pa.string())
    if name in _WHOLE:
        return pa.array(values, pa.int64())
    return pa.array([None if v is None else float(v) for v in values], pa.float64())

"""CSV cells must be read back as equal values by Python's CSV and JSON readers."""

from __future__ import annotations

import csv
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pytest

from bridge.convert.csv_table import CsvTable

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

RNG = np.random.default_rng(20)
POWERS_OF_TWO = np.exp2(np.arange(-1074, 1024))
DOUBLES = np.concatenate(
    [
        np.array([0.0, -0.0, 1.0, 0.1, -2.5, 1 / 3, 5e-324, 1e-5, 1e-4, 1e15, 1e16, 1e22, 1e23]),
        # Random bit patterns with equal probability; NaN and infinity are removed later.
        RNG.integers(-(2**63), 2**63 - 1, 20_000, dtype=np.int64).view(np.float64),
        RNG.normal(size=20_000),
        RNG.integers(-(10**6), 10**6, 5_000) / 1000,
        RNG.integers(0, 2**62, 5_000).astype(np.float64),
        # Powers of two and their neighbours: the next lower float is only half as far away as the
        # next higher.
        POWERS_OF_TWO,
        np.nextafter(POWERS_OF_TWO, 0.0),
        np.nextafter(POWERS_OF_TWO[:-1], np.inf),
        10.0 ** np.arange(-323, 309),
    ]
)


def cells(path: Path, columns: dict[str, pa.Array]) -> list[dict[str, str]]:
    """Write columns to a file; return the rows that Python's CSV reader reads."""
    table = CsvTable(path, {name: column.type for name, column in columns.items()})
    table.write(list(columns.values()))
    table.close()
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def written(path: Path, values: NDArray[Any]) -> list[str]:
    """Write one column; return its cells."""
    return [row["x"] for row in cells(path, {"x": pa.array(values)})]


def digits(text: str) -> int:
    """Return the significant digits of a number's text."""
    return len(text.lstrip("-").split("e")[0].replace(".", "").strip("0"))


def test_doubles_read_back_with_the_fewest_digits(tmp_path: Path) -> None:
    values = DOUBLES[np.isfinite(DOUBLES)]
    found = written(tmp_path / "x.csv", values)
    assert (np.array(found, np.float64).view(np.int64) == values.view(np.int64)).all()
    assert [digits(text) for text in found] == [digits(repr(value)) for value in values.tolist()]
    odd = written(tmp_path / "y.csv", np.array([np.nan, np.inf, -np.inf]))
    assert odd == ["nan", "inf", "-inf"]


def test_singles_read_back_with_the_fewest_digits(tmp_path: Path) -> None:
    bits = RNG.integers(-(2**31), 2**31 - 1, 20_000, dtype=np.int32)
    values = np.concatenate(
        [bits.view(np.float32), np.exp2(np.arange(-149, 128)).astype(np.float32)]
    )
    values = values[np.isfinite(values)]
    found = written(tmp_path / "x.csv", values)
    assert (np.array(found, np.float32) == values).all()
    fewest = [np.format_float_scientific(value, unique=True) for value in values]
    assert [digits(text) for text in found] == [digits(text) for text in fewest]


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_integers(tmp_path: Path, dtype: str) -> None:
    ends = np.iinfo(dtype)
    near = [0, 1, 9, 10, 99, 100, ends.min, ends.max, ends.max - 1, 0, 0, 7, 7]
    values = np.concatenate(
        [np.array(near, dtype), RNG.integers(ends.min, ends.max, 300, dtype=dtype)]
    )
    assert written(tmp_path / "x.csv", values) == [str(value) for value in values.tolist()]


def test_times_are_those_of_the_calendar(tmp_path: Path) -> None:
    """The times include leap years, century years, equal seconds, and times before 1970."""
    days = np.arange("1677-09-22", "2262-04-11", dtype="M8[D]").astype("M8[ns]").view(np.int64)
    within = RNG.integers(0, 86_400_000_000_000, len(days))
    close = 1_700_000_000_000_000_000 + np.arange(0, 3_000_000_000, 7_654_321)
    values = np.concatenate([(days + within)[::7], close])
    column = pa.array(values.view("M8[ns]")).cast(pa.timestamp("ns", "UTC"))
    found = [row["x"] for row in cells(tmp_path / "x.csv", {"x": column})]
    assert found == [str(t).replace("T", " ") + "Z" for t in values.view("M8[ns]")]


def test_texts_bytes_lists_and_absent_values(tmp_path: Path) -> None:
    texts = ["plain", 'a "quoted" one', "two\nlines", "a, b", "", None, "é→x", "cr\r", '"'] * 3
    held = [b"", b"\x00\xff", None, bytes(range(256)), b"a"] * 9
    numbers = [[1.5, float("nan"), -1e300], [], [0.0], [0.1, 0.1, 0.1], None] * 9
    words = [["a", 'b"'], [], ["c,d"]] * 9
    columns = {
        "text, with a comma": pa.array(texts, pa.string()),
        "bytes": pa.array(held[:27], pa.binary()),
        "numbers": pa.array(numbers[:27], pa.list_(pa.float64())),
        "map": pa.array([[0] * 50 + [100] * 60 + [-1, 7, 7]] * 27, pa.list_(pa.int8())),
        "words": pa.array(words, pa.list_(pa.string())),
        "same": pa.array([["x", "y"]] * 27, pa.list_(pa.string())),
        "flag": pa.array([True, None, False] * 9),
        "flags": pa.array([[True, False], []] * 13 + [[True]], pa.list_(pa.bool_())),
    }
    rows = cells(tmp_path / "x.csv", columns)
    for i, row in enumerate(rows):
        assert row["text, with a comma"] == (texts[i] or "")
        assert row["bytes"] == (held[i] or b"").hex()
        value = numbers[i]
        assert row["numbers"] == "" or json.loads(row["numbers"]) == [
            None if v != v else v  # noqa: PLR0124 - a comparison with itself finds NaN
            for v in value or []
        ]
        assert (row["numbers"] == "") == (value is None)
        assert json.loads(row["map"]) == [0] * 50 + [100] * 60 + [-1, 7, 7]
        assert json.loads(row["words"]) == words[i]
        assert json.loads(row["same"]) == ["x", "y"]
        assert row["flag"] == ["true", "", "false"][i % 3]
        assert json.loads(row["flags"]) == columns["flags"][i].as_py()
    assert len(rows) == 27
    # An empty text and a missing text differ in the file, but Python's reader returns equal values.
    lines = (tmp_path / "x.csv").read_bytes().split(b"\n")
    assert sum(line.startswith(b'"",') for line in lines) == 3


def test_rows_longer_than_the_buffer_and_slices(tmp_path: Path) -> None:
    """A block of output ends between two rows, even if a column is a slice of a larger array."""
    long = pa.array([list(range(i, i + 20_000)) for i in range(30)], pa.list_(pa.int32()))
    number, text = pa.array([None, *range(29)]), pa.array([str(i) * i for i in range(30)])
    flag = pa.array([i % 3 == 0 for i in range(30)])
    columns = {"a": long, "b": number, "c": text, "d": flag}
    rows = cells(tmp_path / "x.csv", {name: column[3:] for name, column in columns.items()})
    assert len(rows) == 27
    for i, row in enumerate(rows, 3):
        assert json.loads(row["a"]) == list(range(i, i + 20_000))
        assert (row["b"], row["c"]) == (str(i - 1), str(i) * i)
        assert row["d"] == ("true" if i % 3 == 0 else "false")

"""The library of runs: the logs that it reads and stores, and the limits of a condition."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader

from bridge.library import entry
from bridge.library.columns import NAMES
from bridge.library.errors import IndexBusyError, IndexDamagedError, LibraryError
from bridge.library.index import FILE_NAME
from bridge.library.library import Library, mark_run
from bridge.library.selection import Selection
from bridge.record.log_writer import RunWriter
from bridge.record.policy import RecordOptions, open_log
from support.small_logs import summary_of, write_log
from support.synthetic_run import run_info, synthetic_run

if TYPE_CHECKING:
    from pathlib import Path


def listed(
    folder: Path,
    where: str = "",
    *,
    sort: str = "date",
    tags: tuple[str, ...] = (),
    last: int | None = None,
) -> list[dict[str, Any]]:
    library = Library([folder])
    library.refresh()
    return [run.values for run in library.select(Selection(where, sort, tags, last))]


def read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Update the index; return the logs that this update read."""
    names: list[str] = []
    real = entry.read_entry

    def counted(path: Path, modified_ns: int) -> entry.Entry:
        names.append(path.name)
        return real(path, modified_ns)

    with monkeypatch.context() as patch:
        patch.setattr(entry, "read_entry", counted)
        Library([folder]).refresh()
    return names


def test_a_run_is_listed_with_the_figures_of_its_log(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", seed=4, coverage=0.93)
    (row,) = listed(tmp_path)
    assert tuple(row) == NAMES
    expected = {
        "log": str(tmp_path / "a.mcap"),
        "folder": str(tmp_path),
        "date": "2023-11-14T22:13:20Z",
        "kind": "live",
        "robot": "sweeper",
        "room": "synthetic",
        "planner": "paper",
        "seed": 4,
        "outcome": "complete",
        "coverage": 0.93,
        "duration_s": 104.0,
        "collisions": 1,
        "pose_error_m": 0.01,
        "device_faults": 1,
        "supervision": 3,
        "lost": 2,
        "crc_errors": 1,
        "version": "0.0.test",
        "whole": 1,
        "problem": None,
        "tags": " ",
        "note": None,
        "mouth_passing": None,
    }
    assert {name: row[name] for name in expected} == expected


def test_only_new_and_changed_logs_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(3):
        write_log(tmp_path / f"{number}.mcap", at_s=number)
    assert read_again(tmp_path, monkeypatch) == ["0.mcap", "1.mcap", "2.mcap"]
    assert read_again(tmp_path, monkeypatch) == []
    (tmp_path / "1.mcap").unlink()
    write_log(tmp_path / "1.mcap", planner="random", records=60)
    write_log(tmp_path / "3.mcap", at_s=3)
    assert read_again(tmp_path, monkeypatch) == ["1.mcap", "3.mcap"]
    (tmp_path / "0.mcap").unlink()
    assert read_again(tmp_path, monkeypatch) == []
    assert [row["planner"] for row in listed(tmp_path)] == ["random", "paper", "paper"]


def test_a_growing_log_is_listed_without_an_end_and_then_with_it(tmp_path: Path) -> None:
    path = tmp_path / "now.mcap"
    writer = RunWriter(path, run_info())
    records = list(synthetic_run())[:400]
    for record in records[:200]:
        writer.write(record)
    writer.flush()
    (row,) = listed(tmp_path)
    assert (row["whole"], row["outcome"], row["planner"]) == (0, None, "u-shape")
    assert row["room"] == "synthetic"
    for record in records[200:]:
        writer.write(record)
    writer.close(summary_of("u-shape", 1, 0.5))
    (row,) = listed(tmp_path)
    assert (row["whole"], row["outcome"], row["coverage"]) == (1, "complete", 0.5)


def test_damaged_and_foreign_files_hide_no_run(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap", records=3000)
    data = whole.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])  # between messages
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "noise.mcap").write_bytes(os.urandom(5000))
    (tmp_path / "notes.txt").write_text("no log")
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "gone.mcap").symlink_to(tmp_path / "nowhere")
    library = Library([tmp_path])
    library.refresh()
    found = {run.path.name: run.values["whole"] for run in library.select(Selection())}
    assert found == {"whole.mcap": 1, "cut.mcap": 0}
    assert {path.name for path, _ in library.unreadable} == {"empty.mcap", "noise.mcap"}


@pytest.mark.parametrize("step", range(7))
def test_a_flipped_byte_never_raises(tmp_path: Path, step: int) -> None:
    path = write_log(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    for place in range(step, len(data), 7 * 61):
        data[place] ^= 0xFF
    path.write_bytes(data)
    library = Library([tmp_path])
    library.refresh()
    assert len(library.select(Selection())) + len(library.unreadable) <= 1


def test_a_damaged_summary_is_a_problem_and_not_a_figure(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap")
    data = path.read_bytes()
    path.write_bytes(data.replace(b'"outcome": "complete"', b'"outcome": "complote"'))
    (row,) = listed(tmp_path)
    assert row["outcome"] is None
    assert "summary.json is damaged" in row["problem"]


def test_an_index_that_points_behind_the_end_hides_no_run(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", coverage=0.93)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    index = summary.attachment_indexes[0]
    place = struct.pack("<QQ", index.offset, index.length)
    assert data.count(place) == 1
    at = data.index(place)
    data[at : at + 16] = struct.pack("<QQ", len(data), 0)
    path.write_bytes(data)
    (row,) = listed(tmp_path)
    assert row["outcome"] == "complete", "the whole file is read instead"


def test_tags_and_notes_follow_a_log_that_was_moved(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    path = write_log(tmp_path / "a.mcap", seed=1)
    write_log(tmp_path / "b.mcap", seed=2)
    mark_run(path, add=("good", "carpet"), note="left brush replaced")
    path.rename(tmp_path / "renamed.mcap")
    (row,) = listed(tmp_path, tags=("good",))
    assert (row["log"], row["tags"]) == (str(tmp_path / "renamed.mcap"), " carpet good ")
    (tmp_path / "renamed.mcap").rename(inner / "a.mcap")
    (row,) = listed(tmp_path, where="note LIKE '%brush%'")
    assert row["log"] == str(inner / "a.mcap")
    shutil.copy(inner / "a.mcap", inner / "copy.mcap")
    assert len(listed(tmp_path, tags=("good",))) == 1, "a copy is another log"


def test_tags_are_added_and_removed(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap")
    assert mark_run(path, add=("b", "a")).tags == ("a", "b")
    assert mark_run(path, remove=("a", "never")).tags == ("b",)
    assert mark_run(path, note=" kept ").note == "kept"
    assert mark_run(path).note == "kept"
    assert mark_run(path, note="").note is None
    for wrong in ("", "two words", "x" * 65, "a'b"):
        with pytest.raises(LibraryError, match="is no tag"):
            mark_run(path, add=(wrong,))
    with pytest.raises(LibraryError, match="not the log of a run"):
        mark_run(tmp_path / "none.mcap", add=("a",))


def test_marks_survive_an_index_of_another_version(tmp_path: Path) -> None:
    mark_run(write_log(tmp_path / "a.mcap"), add=("good",))
    with sqlite3.connect(tmp_path / FILE_NAME) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    (row,) = listed(tmp_path, tags=("good",))
    assert row["planner"] == "paper"


def test_an_invalid_index_is_named_and_kept(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap")
    (tmp_path / FILE_NAME).write_bytes(b"no database at all, but long enough" * 40)
    with pytest.raises(IndexDamagedError, match="delete it to make a new one"):
        listed(tmp_path)
    assert (tmp_path / FILE_NAME).read_bytes().startswith(b"no database")


def test_without_a_place_for_the_index_runs_are_listed_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(tmp_path / "a.mcap")
    monkeypatch.setattr(os, "access", lambda _path, mode: mode != os.W_OK)
    library = Library([tmp_path])
    library.refresh()
    assert len(library.select(Selection())) == 1
    assert library.unstored == [tmp_path]
    assert not (tmp_path / FILE_NAME).exists()
    with pytest.raises(LibraryError, match="access denied"):
        mark_run(path, add=("a",))


def test_a_run_of_several_files_is_one_run(tmp_path: Path) -> None:
    info = run_info()
    writer = open_log(tmp_path / "long.mcap", info, RecordOptions(rotate_s=2.0), force=False)
    for record in list(synthetic_run())[:4000]:
        writer.write(record)
    parts = sorted(tmp_path.glob("*.mcap"))
    assert len(parts) > 2
    (row,) = listed(tmp_path)
    assert row["outcome"] is None
    writer.close(summary_of("u-shape", 1, 0.7))
    (row,) = listed(tmp_path)
    parts = sorted(tmp_path.glob("*.mcap"))
    assert row["log"] == str(tmp_path / "long.mcap")
    assert (row["outcome"], row["coverage"], row["whole"]) == ("complete", 0.7, 1)
    assert row["bytes"] == sum(part.stat().st_size for part in parts)


def test_a_simulated_run_is_dated_by_its_name_or_its_file(tmp_path: Path) -> None:
    write_log(tmp_path / "20240229T010203Z-case-1.mcap", port="virtual")
    other = write_log(tmp_path / "clean.mcap", port="virtual")
    os.utime(other, (1_700_000_000, 1_700_000_000))
    odd = write_log(tmp_path / "20249999T010203Z-x.mcap", port="virtual")
    os.utime(odd, (1_600_000_000, 1_600_000_000))
    assert {row["log"].rpartition("/")[2][:12]: row["date"] for row in listed(tmp_path)} == {
        "20240229T010": "2024-02-29T01:02:03Z",
        "clean.mcap": "2023-11-14T22:13:20Z",
        "20249999T010": "2020-09-13T12:26:40Z",
    }


def test_kinds_of_logs(tmp_path: Path) -> None:
    write_log(tmp_path / "a.mcap", port="virtual")
    write_log(tmp_path / "b.mcap", port="emulated")
    write_log(tmp_path / "c.mcap", port="/dev/x", planner="", extra={"command": "calibrate gyro"})
    write_log(tmp_path / "d.mcap", port="/dev/x", extra={"faults": "unplug@3"})
    found = {row["log"][-6]: (row["kind"], row["faults"]) for row in listed(tmp_path)}
    assert found == {
        "a": ("simulated", None),
        "b": ("truth", None),
        "c": ("bringup", None),
        "d": ("live", "unplug@3"),
    }


def test_selection_sorts_filters_and_takes_the_last(tmp_path: Path) -> None:
    for number, coverage in enumerate((0.9, None, 0.7, 0.8)):
        write_log(tmp_path / f"{number}.mcap", seed=number, coverage=coverage, at_s=number)
    seeds = [row["seed"] for row in listed(tmp_path, sort="coverage")]
    assert seeds == [1, 2, 3, 0]
    assert [row["seed"] for row in listed(tmp_path, sort="-coverage")] == [0, 3, 2, 1]
    assert [row["seed"] for row in listed(tmp_path, where="coverage > 0.75")] == [0, 3]
    assert [row["seed"] for row in listed(tmp_path, last=2)] == [2, 3]
    best = "coverage = (SELECT max(coverage) FROM runs)"
    assert [row["seed"] for row in listed(tmp_path, where=best)] == [0]
    assert listed(tmp_path, where="seed = 1 -- a comment")[0]["seed"] == 1
    (row,) = listed(tmp_path, where="UPPER(kind) LIKE '%E%' AND round(abs(coverage), 1) = 0.9")
    assert row["seed"] == 0


@pytest.mark.parametrize(
    ("where", "text"),
    [
        ("covrage > 0.9", "did you mean coverage"),
        ("coverage >", "not SQL over the columns"),
        ("1; DROP TABLE runs", "not SQL over the columns"),
        ("(SELECT count(*) FROM sqlite_master) > 0", "does more than read runs"),
        ("load_extension('x')", "no function 'load_extension'; there are abs, avg,"),
        ("randomblob(1000000000) IS NULL", "no function 'randomblob'"),
        ("printf('%1000000000d', 1) IS NULL", "no function 'printf'"),
        ("date = ?", "not SQL over the columns"),
        (
            "EXISTS (WITH RECURSIVE n(i) AS (SELECT 1 UNION SELECT i + 1 FROM n) SELECT i FROM n)",
            "does more than read runs",
        ),
    ],
)
def test_a_condition_only_reads_runs(tmp_path: Path, where: str, text: str) -> None:
    write_log(tmp_path / "a.mcap")
    with pytest.raises(LibraryError, match=text):
        listed(tmp_path, where=where)
    assert len(listed(tmp_path)) == 1


def test_an_unknown_column_to_sort_by_is_named(tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="did you mean coverage"):
        listed(tmp_path, sort="coverag")


def test_a_name_that_is_not_utf8_is_listed(tmp_path: Path) -> None:
    name = os.fsdecode(b"n\xff\xfe.mcap")
    try:
        write_log(tmp_path / name)
    except OSError:
        pytest.skip("this file system takes UTF-8 only")  # pragma: no cover
    library = Library([tmp_path])
    library.refresh()
    (run,) = library.select(Selection())
    assert run.path == tmp_path / name
    assert run.values["log"].endswith("n\ufffd\ufffd.mcap")


def test_an_index_in_use_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(tmp_path / "a.mcap")
    listed(tmp_path)
    monkeypatch.setattr("bridge.library.index._WAIT_S", 0.05)
    with closing(sqlite3.connect(tmp_path / FILE_NAME, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(IndexBusyError, match=rf"{FILE_NAME} cannot be used: .*; try again"):
            mark_run(path, add=("a",))
    assert mark_run(path, add=("a",)).tags == ("a",)

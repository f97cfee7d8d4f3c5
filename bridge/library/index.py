"""Index of one folder: a SQLite file beside the logs.

A file is read again only if its size or its modification time has changed. Tags and notes are
stored by the file's name. If a file is moved or renamed, its digest identifies it, and its tags and
notes are moved to its new name.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.library.columns import INDEXED
from bridge.library.errors import LibraryError, index_error
from bridge.record.names import readable_name

if TYPE_CHECKING:
    from bridge.library.entry import Entry

FILE_NAME = ".sweepctl-runs.sqlite"
"""Name of the index in a folder of logs."""
SUFFIX = ".mcap"
_VERSION = 1
"""Version of the index's tables. An index of another version is rebuilt, but its tags and notes
stay."""
_BATCH = 200
"""Number of logs after which the index is saved. So an interruption loses only a few entries."""
_END_BYTES = 4096
"""Number of bytes at each end of a file. Together with size and values, they identify the file."""
_WAIT_S = 10.0
"""Maximum wait for another process that updates the same index, s."""
_TABLES = f"""
CREATE TABLE IF NOT EXISTS entries (
  name BLOB PRIMARY KEY, size INTEGER, modified_ns INTEGER, shown TEXT, digest TEXT,
  is_run INTEGER, first BLOB, unreadable TEXT,
  {", ".join(f"{column.name} {column.kind}" for column in INDEXED)}
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS marks (
  name BLOB PRIMARY KEY, digest TEXT, tags TEXT NOT NULL DEFAULT ' ', note TEXT
) WITHOUT ROWID;
"""
_VALUES = ", ".join("?" for _ in range(8 + len(INDEXED)))


class ListedFile(NamedTuple):
    """A file in the list of its folder."""

    name: bytes
    size: int
    modified_ns: int


class Marks(NamedTuple):
    """Tags and note of a log, written by people."""

    tags: tuple[str, ...]
    note: str | None


class ReadLog(NamedTuple):
    """Result of reading one log."""

    entry: Entry
    digest: str | None


LogReaders = Callable[[list[tuple[Path, int]]], Iterable[ReadLog]]
"""Function that reads logs, given as paths with modification times (ns). It returns the results in
the same order."""


def read_log(log: tuple[Path, int]) -> ReadLog:
    """Read a log, given as its path and its modification time (ns)."""
    from bridge.library.entry import read_entry  # noqa: PLC0415 - only if a log has changed

    path, modified_ns = log
    entry = read_entry(path, modified_ns)
    return ReadLog(entry, _digest(path, entry.values or {}))


def read_here(logs: list[tuple[Path, int]]) -> Iterator[ReadLog]:
    """Read logs one after the other in this process."""
    return map(read_log, logs)


class FolderIndex:
    """Index of one folder; close it after use."""

    def __init__(self, folder: Path) -> None:
        """Open or create the index. If the folder is read-only, the index exists only in memory.

        Raises:
            LibraryError: the file is not an index, or cannot be used now.

        """
        self.folder = folder
        self.path = folder / FILE_NAME
        self.is_stored = os.access(self.path if self.path.exists() else folder, os.W_OK)
        """True if the index is a file. False if the folder is read-only, so that all logs are read
        each time."""
        try:
            self.database = sqlite3.connect(
                self.path if self.is_stored else self.uri,
                timeout=_WAIT_S,
                isolation_level=None,
                uri=not self.is_stored,
            )
            self._prepare()
        except sqlite3.DatabaseError as error:
            raise index_error(self.path, error) from None

    @property
    def uri(self) -> str:
        """Name under which another connection of this process reads the index."""
        if self.is_stored:
            return f"{self.path.absolute().as_uri()}?mode=ro"
        return f"file:sweepctl-runs-{id(self)}?mode=memory&cache=shared"

    def _prepare(self) -> None:
        (version,) = self.database.execute("PRAGMA user_version").fetchone()
        if version == _VERSION:
            return
        with self._transaction():
            self.database.execute("DROP TABLE IF EXISTS entries")
            for statement in _TABLES.split(";"):
                self.database.execute(statement)
            self.database.execute(f"PRAGMA user_version = {_VERSION}")

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self.database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self.database.execute("ROLLBACK")
            raise
        self.database.execute("COMMIT")

    def update(
        self,
        files: list[ListedFile],
        progress: Callable[[int, int], None],
        read: LogReaders = read_here,
    ) -> None:
        """Read the logs that are new or have changed, and remove logs that no longer exist.

        Args:
            files: All logs of the folder.
            progress: Called with the number of logs read so far and of logs to read.
            read: Reads the logs.

        Raises:
            LibraryError: the index cannot be read or written.

        """
        try:
            self._update(files, progress, read)
        except sqlite3.DatabaseError as error:
            raise index_error(self.path, error) from None

    def _update(
        self, files: list[ListedFile], progress: Callable[[int, int], None], read: LogReaders
    ) -> None:
        known = {
            name: (size, modified_ns)
            for name, size, modified_ns in self.database.execute(
                "SELECT name, size, modified_ns FROM entries"
            )
        }
        changed = [f for f in files if known.get(f.name) != (f.size, f.modified_ns)]
        gone = known.keys() - {file.name for file in files}
        if not changed and not gone:
            return
        # The entry of a run's first file has the values of all its files.
        present = {file.name: file for file in files}
        firsts = self._firsts(gone)
        for begin in range(0, len(changed), _BATCH):
            progress(begin, len(changed))
            batch = changed[begin : begin + _BATCH]
            logs = list(read([self._log(file) for file in batch]))
            with self._transaction():
                for file, log in zip(batch, logs, strict=True):
                    first = self._store(file, log)
                    if first is not None:
                        firsts.add(first)
        with self._transaction():
            self.database.executemany("DELETE FROM entries WHERE name = ?", [(n,) for n in gone])
            for name in sorted(firsts & present.keys()):
                self._store(present[name], read_log(self._log(present[name])))
        progress(len(changed), len(changed))

    def _firsts(self, names: set[bytes]) -> set[bytes]:
        """Return the first files of the runs to which these later files belong."""
        asked = "SELECT first FROM entries WHERE name = ? AND first IS NOT NULL"
        found = (self.database.execute(asked, (name,)).fetchone() for name in names)
        return {row[0] for row in found if row is not None}

    def _log(self, file: ListedFile) -> tuple[Path, int]:
        return self.folder / os.fsdecode(file.name), file.modified_ns

    def _store(self, file: ListedFile, log: ReadLog) -> bytes | None:
        """Store a log's row. If the log is a later file of a run, return the run's first file."""
        entry, digest = log
        values: dict[str, Any] = entry.values or {}
        first = None if entry.first is None else os.fsencode(entry.first)
        row = (
            *file,
            readable_name(os.fsdecode(file.name)),
            digest,
            int(entry.values is not None),
            first,
            entry.problem,
            *(values.get(column.name) for column in INDEXED),
        )
        self.database.execute(f"INSERT OR REPLACE INTO entries VALUES ({_VALUES})", row)  # noqa: S608 - our own names
        self.database.execute("UPDATE marks SET digest = ? WHERE name = ?", (digest, file.name))
        return first

    # ---- tags and notes

    def has_run(self, name: bytes) -> bool:
        """Return True if the index has a run whose first file has this name."""
        found = self.database.execute("SELECT is_run FROM entries WHERE name = ?", (name,))
        return bool((found.fetchone() or (0,))[0])

    def marks(self, name: bytes) -> Marks:
        """Return a log's tags and note."""
        found = self.database.execute(
            "SELECT tags, note FROM marks WHERE name = ?", (name,)
        ).fetchone()
        return Marks((), None) if found is None else Marks(tuple(found[0].split()), found[1])

    def mark(self, name: bytes, marks: Marks) -> None:
        """Set a log's tags and note.

        Raises:
            LibraryError: the folder cannot be written.

        """
        if not self.is_stored:
            raise LibraryError(f"cannot write the index {self.path}: access denied")
        tags = " ".join(("", *sorted(set(marks.tags)), "")) if marks.tags else " "
        found = self.database.execute(
            "SELECT digest FROM entries WHERE name = ?", (name,)
        ).fetchone()
        with self._transaction():
            self.database.execute(
                "INSERT OR REPLACE INTO marks VALUES (?, ?, ?, ?)",
                (name, found[0] if found else None, tags, marks.note or None),
            )

    def orphans(self) -> list[tuple[bytes, str, Marks]]:
        """Return the marks of files that no longer exist: name, digest and marks."""
        rows = self.database.execute(
            "SELECT name, digest, tags, note FROM marks WHERE digest IS NOT NULL "
            "AND name NOT IN (SELECT name FROM entries)"
        )
        return [
            (name, digest, Marks(tuple(tags.split()), note)) for name, digest, tags, note in rows
        ]

    def unmarked(self, digest: str) -> bytes | None:
        """Return a log with this digest and without marks; None: there is no such log."""
        found = self.database.execute(
            "SELECT name FROM entries WHERE digest = ? AND name NOT IN (SELECT name FROM marks)",
            (digest,),
        ).fetchone()
        return None if found is None else bytes(found[0])

    def forget_marks(self, name: bytes) -> None:
        """Remove the marks of a file that was moved."""
        self.database.execute("DELETE FROM marks WHERE name = ?", (name,))

    def close(self) -> None:
        """Close the index."""
        self.database.close()


def folders_with_logs(top: Path) -> Iterator[tuple[Path, list[ListedFile]]]:
    """Yield ``top`` and the folders below it that contain logs, without hidden folders.

    Raises:
        LibraryError: ``top`` is not a folder or cannot be read.

    """
    files, inner = logs_in(top)
    if files or (top / FILE_NAME).exists():
        yield top, files
    for folder in inner:
        if os.access(folder, os.R_OK | os.X_OK):
            yield from folders_with_logs(folder)


def logs_in(folder: Path) -> tuple[list[ListedFile], list[Path]]:
    """Return the logs and the folders in a folder, sorted by name.

    Raises:
        LibraryError: ``folder`` is not a folder or cannot be read.

    """
    files, inner = [], []
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError as error:
        raise LibraryError(f"cannot read the folder {folder}: {error.strerror}") from None
    for entry in entries:
        if entry.name.endswith(SUFFIX):
            try:
                found = entry.stat()
            except OSError:  # just deleted, or a broken symbolic link
                continue
            if stat.S_ISREG(found.st_mode):
                files.append(ListedFile(os.fsencode(entry.name), found.st_size, found.st_mtime_ns))
                continue
        if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False):
            inner.append(folder / entry.name)
    return files, inner


def _digest(path: Path, values: dict[str, Any]) -> str | None:
    """Return a digest of size, both ends and values, which identifies a log at any path."""
    figures = [value for name, value in values.items() if name != "date"]  # may be the file's time
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(0)
            hashed = hashlib.sha256(f"{size} {figures}\n".encode() + file.read(_END_BYTES))
            file.seek(max(0, size - _END_BYTES))
            hashed.update(file.read(_END_BYTES))
    except OSError:
        return None
    return hashed.hexdigest()[:32]

"""Runs of one or more folders: refresh, selection with SQL, names and tags."""

from __future__ import annotations

import os
import re
import sqlite3
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bridge.library.columns import COLUMNS, INDEXED, NAMES
from bridge.library.errors import LibraryError, index_error
from bridge.library.index import (
    FILE_NAME,
    FolderIndex,
    Marks,
    folders_with_logs,
    logs_in,
    read_here,
)
from bridge.library.latest import resolve_latest
from bridge.library.selection import Selection
from bridge.record.names import readable_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from bridge.library.index import LogReaders

_TAG = re.compile(r"[\w.+-]{1,64}")
_MAX_NOTE = 10_000
"""Maximum length of a note, characters."""
_OWN = tuple(column.name for column in INDEXED)


@dataclass(frozen=True, slots=True)
class Run:
    """A recorded run: its log and its row in the index."""

    path: Path
    values: dict[str, Any]
    """Values by column."""


class Library:
    """The runs in some folders and in the folders below them."""

    def __init__(self, folders: Iterable[Path]) -> None:
        """Use these folders; nothing is read before :meth:`refresh`."""
        self.folders = [*folders]
        self.unreadable: list[tuple[Path, str]] = []
        """Files that cannot be read, with the reason."""
        self.unstored: list[Path] = []
        """Folders without write access. Their logs are read at each refresh."""
        self._places: list[Path] = []
        """Folders by their number in the table."""
        self._database = sqlite3.connect("file::memory:", isolation_level=None, uri=True)
        columns = ", ".join(f'"{column.name}" {column.kind}' for column in COLUMNS)
        self._database.execute(
            f"CREATE TABLE runs ({columns}, name BLOB, place INTEGER, modified_ns INTEGER)"
        )

    def refresh(
        self,
        progress: Callable[[int, int], None] = lambda _done, _all: None,
        read: LogReaders = read_here,
    ) -> None:
        """Update the indexes and load them.

        Args:
            progress: Called with two numbers for a folder: logs read so far, and logs to read.
            read: Reads logs that are new or have changed.

        Raises:
            LibraryError: a folder does not exist or cannot be read, or an index cannot be used.

        """
        with ExitStack() as stack:
            indexes = {}
            for top in self.folders:
                for folder, files in folders_with_logs(top):
                    key = folder.resolve()
                    if key not in indexes:
                        index = indexes[key] = stack.enter_context(closing(FolderIndex(folder)))
                        index.update(files, progress, read)
            _follow_moved([*indexes.values()])
            for index in indexes.values():
                self._load(index)

    def _load(self, index: FolderIndex) -> None:
        """Copy the rows of an index, which is opened read-only, into the table of all runs."""
        folder, database = index.folder, self._database
        if not index.is_stored:
            self.unstored.append(folder)
        within = readable_name(str(folder))
        columns = ", ".join(f'"{name}"' for name in _OWN)
        try:
            database.execute("ATTACH ? AS source", (index.uri,))
            database.execute(
                f"INSERT INTO runs SELECT ? || shown, ?, {columns}, coalesce(tags, ' '), note, "  # noqa: S608 - our own names
                "entries.name, ?, modified_ns FROM source.entries "
                "LEFT JOIN source.marks ON marks.name = entries.name WHERE is_run",
                (readable_name(str(folder / "x"))[:-1], within, len(self._places)),
            )
            unreadable = database.execute(
                "SELECT name, unreadable FROM source.entries WHERE unreadable IS NOT NULL"
            ).fetchall()
            database.execute("DETACH source")
        except sqlite3.DatabaseError as error:
            raise index_error(index.path, error) from None
        self._places.append(folder)
        self.unreadable += [(folder / os.fsdecode(name), text) for name, text in unreadable]

    def select(self, selection: Selection) -> list[Run]:
        """Return the runs of a selection, in its order.

        Runs without a value in the sorted column are first in ascending order and last in
        descending order. Runs with equal values are in the order of the modification time of
        their files, in the same direction.

        Raises:
            LibraryError: the condition is not SQL over the columns, or a column does not exist.

        """
        rows = selection.rows(self._database)
        return [
            Run(self._places[place] / os.fsdecode(name), dict(zip(NAMES, values, strict=True)))
            for *values, name, place, _ in rows
        ]


def _follow_moved(indexes: Sequence[FolderIndex]) -> None:
    """Move the marks of a missing file to the same file with another name."""
    for index in indexes:
        for name, digest, marks in index.orphans():
            for other in indexes:
                found = other.unmarked(digest)
                if found is not None and other.is_stored:
                    other.mark(found, marks)
                    index.forget_marks(name)
                    break


def resolve(path: Path) -> Path:
    """Return the log for a path: ``latest`` is the newest run (:mod:`bridge.library.latest`).

    An emulator's logs of the true state do not count.

    Raises:
        NoRunError: there is no such run.
        LibraryError: the folder cannot be read.

    """
    return resolve_latest(path, _measured)


def _measured(folder: Path) -> list[Path]:
    """Return the logs of the runs in a folder and below it, the newest last, without truth logs."""
    library = Library([folder])
    library.refresh()
    return [run.path for run in library.select(Selection(where="kind <> 'truth'"))]


def mark_run(
    path: Path,
    *,
    add: Sequence[str] = (),
    remove: Sequence[str] = (),
    note: str | None = None,
) -> Marks:
    """Change the tags and the note of a log; return both.

    Args:
        path: The log, the first file of its run.
        add: Tags to add.
        remove: Tags to remove.
        note: New note; empty: remove the note; None: do not change the note.

    Raises:
        LibraryError: a tag or the note is invalid, the log does not exist, or its folder or its
            index cannot be used.

    """
    for tag in (*add, *remove):
        if not _TAG.fullmatch(tag):
            raise LibraryError(f"{tag!r} is no tag: use up to 64 letters, digits and _ . + -")
    if note is not None and len(note) > _MAX_NOTE:
        raise LibraryError(f"the note has {len(note)} characters, more than {_MAX_NOTE}")
    folder, name = path.parent, os.fsencode(path.name)
    files, _ = logs_in(folder)
    try:
        with closing(FolderIndex(folder)) as index:
            index.update(files, lambda _done, _all: None)
            if not index.has_run(name):
                raise LibraryError(f"{path} is not the log of a run, or not its first file")
            before = index.marks(name)
            tags = tuple(sorted({*before.tags, *add} - {*remove}))
            marks = Marks(tags, before.note if note is None else note.strip() or None)
            index.mark(name, marks)
            return marks
    except sqlite3.DatabaseError as error:
        raise index_error(folder / FILE_NAME, error) from None

"""Recording options: one file or several, durability, and the reaction to errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from bridge.errors import OutputExistsError
from bridge.record.family import stray_part
from bridge.record.log_writer import RunWriter
from bridge.record.rotation import RotatingWriter
from bridge.record.storage import open_log_file

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.record.chunked_file import ChunkTap
    from bridge.session.records import RunInfo


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Options of a recording."""

    fsync: bool = False
    """Sync every chunk to the disk. A power loss then loses at most 0.5 s."""
    rotate_bytes: int | None = None
    rotate_s: float | None = None
    stop_on_error: bool = True
    """End the run if its log cannot be written. If False, the run continues without a log."""


def open_log(
    path: Path,
    info: RunInfo,
    options: RecordOptions,
    *,
    force: bool = False,
    tap: ChunkTap | None = None,
) -> RunWriter | RotatingWriter:
    """Create a run's log. ``tap`` receives a copy of the chunks of every file.

    Raises:
        OutputExistsError: the file exists, and ``force`` is False.
        LogWriteError: the file cannot be opened or written, or the disk is full.

    """
    opener = partial(open_log_file, fsync=options.fsync)

    def make(part: Path, of_part: RunInfo) -> RunWriter:
        return RunWriter(part, of_part, force=force, opener=opener, tap=tap)

    if options.rotate_bytes is None and options.rotate_s is None:
        return make(path, info)
    stray = None if force else stray_part(path)
    if stray is not None:  # fail now instead of during the run
        raise OutputExistsError(stray)
    return RotatingWriter(
        path, info, make, rotate_bytes=options.rotate_bytes, rotate_s=options.rotate_s
    )

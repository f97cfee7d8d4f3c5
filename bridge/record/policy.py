"""How a run is to be recorded: one file or several, how safe, and what when it cannot be."""

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

    from bridge.session.records import RunInfo


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """What a person may ask of a recording."""

    fsync: bool = False
    """Every chunk is on the disk before the next: a loss of power takes half a second."""
    rotate_bytes: int | None = None
    rotate_s: float | None = None
    stop_on_error: bool = True
    """The run ends where its log can no longer be written; else it goes on without."""


def open_log(
    path: Path, info: RunInfo, options: RecordOptions, *, force: bool = False
) -> RunWriter | RotatingWriter:
    """Begin a run's log.

    Raises:
        OutputExistsError: the file exists and ``force`` is not set.
        LogWriteError: it cannot be opened or written, or there is no room for it.

    """
    opener = partial(open_log_file, fsync=options.fsync)

    def make(part: Path, of_part: RunInfo) -> RunWriter:
        return RunWriter(part, of_part, force=force, opener=opener)

    if options.rotate_bytes is None and options.rotate_s is None:
        return make(path, info)
    stray = None if force else stray_part(path)
    if stray is not None:  # better now than in the middle of the run
        raise OutputExistsError(stray)
    return RotatingWriter(
        path, info, make, rotate_bytes=options.rotate_bytes, rotate_s=options.rotate_s
    )

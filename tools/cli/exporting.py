"""Export of several logs, each in its own process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bridge.convert.export import Exported


@dataclass(frozen=True, slots=True)
class ExportJob:
    """One log and the folder of its tables."""

    path: Path
    out: Path
    file_format: str
    topics: tuple[str, ...]
    force: bool


def export_jobs(
    files: Sequence[Path], out: Path, file_format: str, topics: tuple[str, ...], *, force: bool
) -> list[ExportJob]:
    """Return a job for each log; with several logs, each has its own folder in ``out``."""
    if len(files) == 1:
        return [ExportJob(files[0], out, file_format, topics, force)]
    taken: set[str] = set()
    jobs = []
    for path in files:
        name, number = path.stem, 2
        while name in taken:
            name, number = f"{path.stem}-{number}", number + 1
        taken.add(name)
        jobs.append(ExportJob(path.absolute(), (out / name).absolute(), file_format, topics, force))
    return jobs


def export_file(job: ExportJob) -> Exported:
    """Export one log.

    Raises:
        BridgeError: as :func:`bridge.convert.export.export`.

    """
    from bridge.convert.export import export
    from bridge.convert.sources import readable

    with readable(job.path) as log:
        return export(log, job.out, file_format=job.file_format, topics=job.topics, force=job.force)


def export_or_error(job: ExportJob) -> Exported | tuple[str, int]:
    """Export one log in a worker process; return an error as its line and exit status."""
    from tools.cli.remedies import error_line

    try:
        return export_file(job)
    except BridgeError as error:
        return error_line(error), error.exit_status

"""Writing of pictures and pages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.files import write_whole
from bridge.record.errors import LogWriteError

if TYPE_CHECKING:
    from pathlib import Path


def write(path: Path, content: bytes) -> None:
    """Write a file; create its folder if it is missing.

    Raises:
        LogWriteError: the file cannot be written.

    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise LogWriteError.of(path, error) from None

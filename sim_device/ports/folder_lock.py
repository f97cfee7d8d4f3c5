"""Lock on a folder, held while an emulator claims or releases a name in it.

Two emulators that start at the same time cannot both get the name. The lock is on the folder
itself, so there is no lock file.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sim_device.ports.base import PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def folder_locked(path: Path) -> Iterator[None]:
    """Hold the lock on the folder of ``path``.

    Raises:
        PortUnavailableError: the folder does not exist.

    """
    import fcntl  # noqa: PLC0415 - not on every platform

    try:
        folder = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise PortUnavailableError(f"cannot make {path}: {error.strerror}") from None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)

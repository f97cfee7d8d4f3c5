"""Access to a user's files: only regular files, not pipes or devices."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from typing import BinaryIO

_PIPES_OF_SHELLS = ("/dev/fd/", "/dev/stdin", "/proc/self/fd/")
"""Paths that a shell uses for ``<(command)`` and for piped input."""
_READING = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOCTTY", 0)


def open_to_read(path: Path, *, takes_pipe: bool = False) -> BinaryIO:
    """Open a regular file or, with ``takes_pipe``, the pipe of a shell's ``<(command)``.

    Raises:
        OSError: the file cannot be opened, or is not a regular file (``IsADirectoryError`` for a
            folder).

    """
    waits = takes_pipe and str(path).startswith(_PIPES_OF_SHELLS)
    found = path.stat().st_mode  # checked first, because just opening a device may affect it
    if not waits:
        _check_regular(path, found)
    # A named pipe may have replaced the file since the check. Opening it would block until it has a
    # writer.
    number = os.open(path, _READING | (0 if waits else getattr(os, "O_NONBLOCK", 0)))
    try:
        opened = os.fstat(number).st_mode
        if not (waits and stat.S_ISFIFO(opened)):
            _check_regular(path, opened)
        return os.fdopen(number, "rb")
    except BaseException:
        os.close(number)
        raise


def check_target(path: Path) -> None:
    """Check that a path can be written. It must be free, a regular file, or like /dev/null.

    Raises:
        OSError: the path is another kind of file, which would block or act on the bytes.

    """
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    if not _keeps_nothing(found):
        _check_regular(path, found.st_mode)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file completely or not at all. A link stays a link.

    Raises:
        OSError: the file cannot be written; an existing file is then unchanged.

    """
    check_target(path)
    target = path.resolve()
    if target.exists() and not target.is_file():  # /dev/null
        target.write_bytes(content)
        return
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    draft = target.with_name(f".sweepctl-{os.getpid()}.part")
    try:
        draft.write_bytes(content)
        if target.exists():
            draft.chmod(stat.S_IMODE(target.stat().st_mode))
        draft.replace(target)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def writing_mode(path: Path, *, force: bool) -> Literal["wb", "xb"]:
    """Return the mode that creates a file, and replaces one only with ``force``.

    /dev/null always exists and has nothing to replace.

    Raises:
        OSError: as for :func:`check_target`.

    """
    check_target(path)
    return "wb" if force or path.is_char_device() else "xb"


def cause(path: Path, error: OSError) -> str:
    """Return the reason why a file could not be written, and the remedy if known."""
    if error.errno == errno.ENOENT and not path.parent.exists():
        return f"there is no folder {path.parent}; make it first"
    return error.strerror or str(error)


def _keeps_nothing(found: os.stat_result) -> bool:
    """Return True for /dev/null and related devices, which drop or reject all bytes."""
    try:
        null = Path(os.devnull).stat().st_rdev
        return stat.S_ISCHR(found.st_mode) and os.major(found.st_rdev) == os.major(null)
    except (OSError, AttributeError):  # Windows
        return False


def _check_regular(path: Path, mode: int) -> None:
    if stat.S_ISREG(mode):
        return
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    what = next((name for test, name in _KINDS if test(mode)), "something else")
    raise OSError(errno.EINVAL, f"it is {what}, not a file", str(path))


_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)

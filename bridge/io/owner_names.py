"""Where a port's owner listens: a folder of this user's alone, and a name made from the port.

The socket itself is named by its process, and links lead to it: one from the port's real path,
one from the path as it was given, and one more each time the port comes back under another.
So a link that a killed owner left behind is seen to lead nowhere, and is replaced.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from bridge.errors import BridgeError

_FOLDER = "sweepctl"
_SHOWN = 20
MAX_RUNTIME = 54
"""A Unix socket's path has at most 104 (macOS) or 108 (Linux) bytes, ours 48 after this."""


class NoFolderError(BridgeError):
    """There is no folder in which only this user can make a socket."""


def folder() -> Path:
    """The folder for sockets, made if need be, of mode 0700 and this user's own.

    ``$XDG_RUNTIME_DIR/sweepctl``, or ``sweepctl-<uid>`` in the system's folder for temporary
    files.

    Raises:
        NoFolderError: what is there is somebody else's, or open to others.

    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and _is_own(Path(runtime)) and len(runtime) <= MAX_RUNTIME:
        path = Path(runtime) / _FOLDER
    else:
        path = Path(tempfile.gettempdir()) / f"{_FOLDER}-{os.getuid()}"
    try:
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        if not _is_own(path):
            raise NoFolderError(f"{path} is not a folder of this user's alone (mode 0700)")
    except OSError as error:
        raise NoFolderError(f"cannot make {path}: {error.strerror}") from None
    return path


def _is_own(path: Path) -> bool:
    """Whether it is a folder that only this user may enter; a link to one is none."""
    try:
        found = path.lstat()
    except OSError:
        return False
    private = stat.S_IMODE(found.st_mode) & 0o077 == 0
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and private


def device_path(port: str) -> str | None:
    """The device file that a port's name holds; None for a socket, a network or a bus."""
    if port.startswith("can:"):
        _, interface, channel = (*port.split(":", 2), "", "")[:3]
        return channel.partition("@")[0] if interface == "slcan" else None
    return None if "://" in port else port


def link_names(port: str) -> list[str]:
    """Names of a port in the folder: by its real path, then as it was given."""
    path = device_path(port)
    keys = [port] if path is None else [os.path.realpath(path), str(Path(path).absolute())]
    return [_name(key) for key in dict.fromkeys(keys)]


def _name(key: str) -> str:
    shown = "".join(c if c.isalnum() or c in "-_." else "-" for c in Path(key).name)[-_SHOWN:]
    return f"{shown}-{hashlib.sha256(key.encode(errors='surrogateescape')).hexdigest()[:16]}"


def put_link(where: Path, name: str, target: Path) -> None:
    """Have ``name`` lead to ``target``, whatever it led to before."""
    fresh = where / f".{target.name}.new"
    with suppress(FileNotFoundError):
        fresh.unlink()
    fresh.symlink_to(target.name)
    fresh.replace(where / name)


def sweep(where: Path) -> None:
    """Remove what processes left behind that have ended."""
    for entry in where.iterdir():
        with suppress(OSError, ValueError):
            if entry.is_symlink():
                if not entry.exists():
                    entry.unlink()
            elif entry.suffix == ".sock" and not _lives(int(entry.name.split("-")[0])):
                entry.unlink()


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

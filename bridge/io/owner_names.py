"""Names of the owners' sockets: a private folder, and links with the port's name.

A socket's name contains its process id. Links point to the socket: one link for the port's real
path, one for the path as given, and one for each new path of a reopened port. A link of a killed
owner points to no file, so it is recognised and replaced.
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
"""Maximum number of characters of the port in a link's name."""
MAX_RUNTIME = 54
"""Maximum length of the runtime folder's path, bytes. A Unix socket's path has at most 104 bytes
(macOS) or 108 bytes (Linux). Our part of it needs 48 bytes."""


class NoFolderError(BridgeError):
    """There is no folder in which only this user can create a socket."""


def folder() -> Path:
    """Return the folder for sockets; create it with mode 0700 if it is missing.

    It is ``$XDG_RUNTIME_DIR/sweepctl``, or ``sweepctl-<uid>`` in the system's temporary folder.

    Raises:
        NoFolderError: the folder belongs to another user or is accessible to others.

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
            raise NoFolderError(f"{path} is not private to this user; set its mode to 0700")
    except OSError as error:
        raise NoFolderError(f"cannot create {path}: {error.strerror}") from None
    return path


def _is_own(path: Path) -> bool:
    """Return True for a real folder (no link) that only this user can enter."""
    try:
        found = path.lstat()
    except OSError:
        return False
    private = stat.S_IMODE(found.st_mode) & 0o077 == 0
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and private


def device_path(port: str) -> str | None:
    """Return the device file in a port's name; None for a network or a bus."""
    if port.startswith("can:"):
        _, interface, channel = (*port.split(":", 2), "", "")[:3]
        return channel.partition("@")[0] if interface == "slcan" else None
    return None if "://" in port else port


def link_names(port: str) -> list[str]:
    """Return the link names of a port: from its real path, then from the path as given."""
    path = device_path(port)
    keys = [port] if path is None else [os.path.realpath(path), str(Path(path).absolute())]
    return [_name(key) for key in dict.fromkeys(keys)]


def _name(key: str) -> str:
    shown = "".join(c if c.isalnum() or c in "-_." else "-" for c in Path(key).name)[-_SHOWN:]
    return f"{shown}-{hashlib.sha256(key.encode(errors='surrogateescape')).hexdigest()[:16]}"


def put_link(where: Path, name: str, target: Path) -> None:
    """Create or replace a link ``name`` to ``target``."""
    fresh = where / f".{target.name}.new"
    with suppress(FileNotFoundError):
        fresh.unlink()
    fresh.symlink_to(target.name)
    fresh.replace(where / name)


def sweep(where: Path) -> None:
    """Remove the sockets and links of processes that have ended."""
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

"""Key files for authenticated motion, which only their owner can read."""

from __future__ import annotations

import os
import secrets
import stat
from typing import TYPE_CHECKING

from bridge.errors import BridgeError, OutputExistsError
from bridge.files import open_to_read

if TYPE_CHECKING:
    from pathlib import Path

MAX_FILE = 256
"""Maximum number of bytes read from a key file: the 32 digits and white space."""


class KeyFileError(BridgeError):
    """A key file that cannot be used."""

    exit_status = 2


def read_key(path: Path | None) -> bytes | None:
    """Return the key in a file, 32 hexadecimal digits; None without a file.

    Raises:
        KeyFileError: the file cannot be read, other users can read it, or it contains no key.

    """
    if path is None:
        return None
    from protocol.authentication import KEY_SIZE

    try:
        with open_to_read(path, takes_pipe=True) as file:
            mode = os.fstat(file.fileno()).st_mode
            text = file.read(MAX_FILE)
    except OSError as error:
        raise KeyFileError(f"cannot read the key file {path}: {error.strerror}") from None
    if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
        raise KeyFileError(f"other users can read the key file {path}: run chmod 600 {path}")
    try:
        key = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_SIZE:
        raise KeyFileError(f"{path} holds no key: a key has {2 * KEY_SIZE} hexadecimal digits")
    return key


def make_key(path: Path) -> bytes:
    """Write a new random key to a new file of mode 0600 and return it.

    Raises:
        OutputExistsError: the file exists.
        KeyFileError: the file cannot be made.

    """
    from protocol.authentication import KEY_SIZE

    key = secrets.token_bytes(KEY_SIZE)
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise OutputExistsError(path, can_replace=False) from None
    except OSError as error:
        raise KeyFileError(f"cannot write the key file {path}: {error.strerror}") from None
    with os.fdopen(fd, "w", encoding="ascii") as file:
        file.write(key.hex() + "\n")
    return key

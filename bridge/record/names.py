"""Names of a log's metadata and attachments."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

METADATA = "sweepctl"
"""Name of the metadata of the run."""
DEVICE_METADATA = "device"
"""Name of the metadata record with the device of a session: boot id, uid, firmware."""
ROBOT_ATTACHMENT, ROOM_ATTACHMENT = "robot.toml", "room.json"
VIRTUAL_PORT, EMULATED_PORT = "virtual", "emulated"
"""Port names in metadata: of a log in virtual time, and of the truth log of an emulator."""
CATALOGUE_ATTACHMENT, SUMMARY_ATTACHMENT = "catalogue.json", "summary.json"


def readable_name(name: str) -> str:
    """Return a file name as valid text. Bytes that are not UTF-8 are replaced."""
    return os.fsencode(name).decode("utf-8", "replace")


def is_utf8(path: Path) -> bool:
    """Return True if the path is UTF-8. Some libraries cannot open other paths."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True

"""What a run's log calls the parts that are no messages."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

METADATA = "sweepctl"
"""Name of the metadata record that says what was run."""
DEVICE_METADATA = "device"
"""Of each session's device, as soon as it is known: boot id, uid, firmware."""
ROBOT_ATTACHMENT, ROOM_ATTACHMENT = "robot.toml", "room.json"
CATALOGUE_ATTACHMENT, SUMMARY_ATTACHMENT = "catalogue.json", "summary.json"


def readable_name(name: str) -> str:
    """A file's name as text that any program takes: bytes that are no UTF-8 are marked."""
    return os.fsencode(name).decode("utf-8", "replace")


def is_utf8(path: Path) -> bool:
    """Whether libraries that know no other names can open it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True

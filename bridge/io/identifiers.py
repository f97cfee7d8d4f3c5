"""Random identifiers, by which a device tells this program's sessions from others."""

from __future__ import annotations

import secrets


def new_session_id() -> int:
    """A session's id: 32 bits, not 0."""
    return secrets.randbelow(0xFFFF_FFFF) + 1


def new_command_id() -> int:
    """The id of a command without a session, which must not be that of a recent one: 16 bits."""
    return secrets.randbelow(0x1_0000)

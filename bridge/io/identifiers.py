"""Random identifiers of sessions and commands."""

from __future__ import annotations

import secrets


def new_session_id() -> int:
    """Return a random session id: 32 bits, not 0."""
    return secrets.randbelow(0xFFFF_FFFF) + 1


def new_command_id() -> int:
    """Return a random 16-bit command id, for a command without a session."""
    return secrets.randbelow(0x1_0000)
